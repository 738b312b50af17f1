"""Works, stored energy and balance: exact where promised, of the method's order elsewhere."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from letters import spring, swing
from oracles.linear_response import match_scene
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.registry import build_problem

GAUSS2 = Method(cq="gauss", degree=2, start="none")
GAUSS2_GRADED = Method(cq="gauss", degree=2, start="graded")
GAUSS3_GRADED = Method(cq="gauss", degree=3, start="graded")
MIDPOINT_NODES = Method(cq="bdf2", degree=1, sampling="nodes")
NODES = Method(cq="bdf3", degree=2, sampling="nodes")
POINTS = Method(cq="bdf4", degree=2, sampling="points", start="none")


def scene_of(**specification):
    return build_problem(specification).scene


def oscillator(order, forcing="cos(t)"):
    return spring((order, 0.7), T=8.0, k=2.0, x=1.0, v=0.5, forcing=forcing)


def two_masses():
    return scene_of(
        kind="bagley-torvik",
        mass=[[2.0, 0.5], [0.5, 1.0]],
        stiffness=[[2.0, -1.0], [-1.0, 2.0]],
        damping=[
            {"order": 0.5, "coefficient": [[0.7, 0.2], [0.2, 0.3]]},
            {"order": 0.8, "coefficient": 0.1},
        ],
        forcing={"pieces": [{"until": 1.0, "value": ["8", "t"]}, {"value": ["0", "1"]}]},
        initial={"position": [1.0, 0.0], "velocity": [0.0, 0.5]},
        final_time=4.0,
    )


def changing_lagrangian():
    return scene_of(
        kind="lagrangian",
        coordinates=["x"],
        parameters={},
        lagrangian="(1 + x**2)*vx**2/2*(1 + t/10) - x**2*(2 + sin(t))",
        damping=[{"order": 0.5, "coefficient": 0.3}],
        initial={"position": 1.0, "velocity": 0.0},
        final_time=4.0,
    )


def pendulum():
    return swing((0.5, 0.3), T=10.0, x=1.0)


def diagnosed(scene, method, n_steps):
    return integrate(scene, method, n_steps, diagnostics=True).diagnostics


@spread(method=[GAUSS2, MIDPOINT_NODES, NODES, POINTS], order=[0.5, 1.0, 1.5])
def test_energy_balance_is_exact_on_linear_scenes(method, order):
    found = diagnosed(oscillator(order), method, 64)
    assert np.abs(found.energy_defect).max() < 1e-14
    # the works themselves are large, and leaving one out does not balance
    assert found.dissipated_work[-1] > 0.5
    without = found.energy_defect - found.dissipated_work
    assert np.abs(without).max() > 0.5


@spread(
    method=[GAUSS2_GRADED, GAUSS3_GRADED],
    scene=[
        oscillator(0.5),
        oscillator(1.5),
        two_masses(),
        oscillator(0.5, forcing="sqrt(t)"),
    ],
)
def test_energy_balance_is_exact_on_graded_meshes(scene, method):
    found = diagnosed(scene, method, 64)
    assert np.abs(found.energy_defect).max() < 1e-13 * max(1.0, np.abs(found.forcing_work).max())
    assert found.dissipated_work[-1] > 1e-3


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("name", "scene", "method", "steps", "order"),
    [
        ("pendulum", pendulum(), GAUSS2_GRADED, 128, 4),
        ("pendulum", pendulum(), GAUSS3_GRADED, 64, 6),
        ("pendulum", pendulum(), MIDPOINT_NODES, 64, 2),
        ("dL/dt", changing_lagrangian(), GAUSS2_GRADED, 64, 4),
        ("dL/dt", changing_lagrangian(), GAUSS3_GRADED, 64, 6),
    ],
    ids=lambda value: getattr(value, "case", str(value))[:40] if value is not None else "",
)
def test_energy_defect_falls_with_the_order_of_the_method(name, scene, method, steps, order):
    coarse, fine = (
        np.abs(diagnosed(scene, method, n).energy_defect).max() for n in (steps, 2 * steps)
    )
    assert abs(np.log2(coarse / fine) - order) < 0.2, name


@pytest.mark.parametrize("order", [0.5, 1.5])
def test_works_are_those_of_the_exact_motion(order):
    """Against the closed form: W_f by quadrature of x' f, W_d from the exact energy."""
    specification = {
        "kind": "damped-oscillator",
        "stiffness": 2.0,
        "damping": [{"order": order, "coefficient": 0.7}],
        "forcing": "t - t**2/10",
        "initial": {"position": 1.0, "velocity": 0.5},
        "final_time": 8.0,
    }
    problem = build_problem(specification)
    # x' by integration by parts: W_f = [x f] - int x f'
    time = np.linspace(0.0, 8.0, 4097)
    position = match_scene(problem.scene).position(time)[:, 0]
    pulled = position * (1 - time / 5)
    simpson = (time[1] / 3) * (
        pulled[0] + pulled[-1] + 4 * pulled[1:-1:2].sum() + 2 * pulled[2:-1:2].sum()
    )
    exact_work = position[-1] * 1.6 - simpson
    trajectory = integrate(problem.scene, GAUSS3_GRADED, 256, diagnostics=True)
    found = trajectory.diagnostics
    assert found.forcing_work[-1] == pytest.approx(exact_work, abs=1e-9)
    energies = trajectory.energy
    assert found.dissipated_work[-1] == pytest.approx(
        exact_work + energies[0] - energies[-1], abs=1e-9
    )


Array = np.ndarray


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
        return integrate(self.scene, method, mesh_of(self.times), diagnostics=True)


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
    found = integrate(scene, Method(cq="gauss", degree=3), 200, diagnostics=True)
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
    found = integrate(scene, Method(cq="gauss", degree=2), mesh, diagnostics=True)
    assert rise(extended(found)) < 1e-12
    defect = found.diagnostics.energy_defect
    assert np.abs(defect).max() < 1e-11 * extended(found)[0]
