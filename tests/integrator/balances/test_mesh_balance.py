"""Energy with what the damper stores: it falls at every step of every mesh."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory

Array = np.ndarray
ASKED = True


def mesh_times(rng: np.random.Generator, kind: str, final_time: float, n: int) -> Array:
    sizes = {
        "uniform": np.ones(n),
        "random": 10.0 ** rng.uniform(-4, 0, n),
        "alternating": np.tile([1.0, 0.01], -(-n // 2))[:n],
    }[kind]
    times = np.concatenate([[0.0], np.cumsum(sizes)])
    times *= final_time / times[-1]
    times[-1] = final_time
    return times


def extended(found: Trajectory) -> Array:
    """H plus what is stored."""
    assert found.status == "ok"
    assert (found.diagnostics.stored_energy >= 0).all()
    return found.energy + found.diagnostics.stored_energy


def rise(energy: Array) -> float:
    """Largest increase over a step, relative to the start."""
    return float(np.diff(energy).max() / energy[0])


@dataclass(frozen=True)
class Drawn:
    """A random linear scene of the design, with its mesh and number of stages."""

    scene: Scene
    times: Array
    stages: int
    bound: float

    def run(self) -> Trajectory:
        method = Method(cq="gauss", degree=self.stages)
        return integrate(self.scene, method, mesh_of(self.times), diagnostics=ASKED)


def drawn(seed: int) -> Drawn:
    """Orders .05 to 1.95, damping 1e-3 to 1e4, stiffness 1e-2 to 1e8, 1 to 6 stages."""
    rng = np.random.default_rng(seed)
    order = float(rng.uniform(0.05, 1.95))
    stiffness = float(10 ** rng.uniform(-2, 8))
    velocity = float(rng.normal()) if order < 1 else 0.0
    kind = ("uniform", "random", "alternating")[seed % 3]
    final_time, coefficient = float(10 ** rng.uniform(-1, 2)), float(10 ** rng.uniform(-3, 4))
    scene = spring((order, coefficient), T=final_time, k=stiffness, x=1.0, v=velocity)
    return Drawn(
        scene=scene,
        times=mesh_times(rng, kind, scene.final_time, int(rng.integers(20, 120))),
        stages=int(rng.integers(1, 7)),
        bound=float(np.sqrt(1.0 + velocity**2 / stiffness)),
    )


def check(seed: int) -> None:
    case = drawn(seed)
    found = case.run()
    energy = extended(found)
    assert rise(energy) < 1e-12, seed
    assert np.abs(found.position).max() <= case.bound * (1 + 1e-12), seed


@pytest.mark.few(1)
@pytest.mark.parametrize("first", range(0, 60, 15))
def test_the_extended_energy_of_random_scenes_falls(first):
    for seed in range(first, first + 15):
        check(seed)


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 2000, 100))
def test_the_extended_energy_of_many_random_scenes_falls(first):
    for seed in range(first, first + 100):
        check(seed)


def test_negative_damping_raises_it():
    """The control."""
    rises = []
    for seed in range(12):
        case = drawn(seed)
        (term,) = case.scene.damping
        negative = FractionalDamping(order=term.order, coefficient=-1e-2 * np.eye(1))
        scene = replace(case.scene, damping=(negative,))
        found = replace(case, scene=scene).run()
        rises.append(rise(found.energy + found.diagnostics.stored_energy))
    assert min(rises) > 1e-9


def test_the_mechanical_energy_alone_rises():
    """What is stored comes back: without it the law would not hold."""
    scene = spring((0.3, 2.0), T=20.0, k=2.0, x=1.0)
    found = integrate(scene, Method(cq="gauss", degree=3), 200, diagnostics=ASKED)
    assert rise(found.energy) > 1e-4
    assert rise(extended(found)) < 1e-14


@spread(
    orders=[(0.5,), (1.5,), (0.2, 0.9, 1.4), (1.0, 0.6)], kind=["uniform", "random", "alternating"]
)
def test_several_terms_and_degrees_of_freedom(orders, kind):
    rng = np.random.default_rng(7)
    matrices = []
    for _ in range(len(orders) + 2):
        random = rng.normal(size=(3, 3))
        matrices.append(random @ random.T + 0.2 * np.eye(3))
    scene = spring(
        *((order, matrix) for order, matrix in zip(orders, matrices, strict=False)),
        T=12.0,
        m=matrices[-1],
        k=matrices[-2],
        x=[1.0, -0.5, 0.3],
        v=[0.4, 0.0, -1.0] if max(orders) <= 1 else 0.0,
    )
    mesh = mesh_of(mesh_times(rng, kind, 12.0, 90))
    found = integrate(scene, Method(cq="gauss", degree=2), mesh, diagnostics=ASKED)
    assert rise(extended(found)) < 1e-12
    defect = found.diagnostics.energy_defect
    assert np.abs(defect).max() < 1e-11 * extended(found)[0]


@spread(order=[0.4, 1.6], forced=[False, True])
def test_the_balance_of_works_is_exact_for_quadratic_potentials(order, forced):
    scene = spring(
        (order, 0.7),
        T=10.0,
        k=3.0,
        x=1.0,
        v=0.5,
        forcing=Forcing.from_text("cos(2*t)") if forced else None,
    )
    rng = np.random.default_rng(1)
    for steps in (100, mesh_of(mesh_times(rng, "random", 10.0, 60)), AdaptiveSteps(tolerance=1e-6)):
        found = integrate(scene, Method(cq="gauss", degree=4), steps, diagnostics=ASKED)
        assert np.abs(found.diagnostics.energy_defect).max() < 1e-11
        assert np.abs(found.diagnostics.dissipated_work).max() > 0.1
    # a control: without as many Gauss points as the degree it is an approximation
    other = integrate(scene, Method(cq="lobatto-iiic", degree=4), 100, diagnostics=ASKED)
    assert 1e-13 < np.abs(other.diagnostics.energy_defect).max() < 1e-2
