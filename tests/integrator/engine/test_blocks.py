"""Blocks and structures give what one step after the other gives, on scenes drawn at random."""

from collections.abc import Callable

import numpy as np
import pytest
from drawn_scenes import RNG, chain, oscillator, pendulum, two_joints
from scipy.sparse import csr_array

import fvi_cli.api as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import integrate_scenes, mesh_for
from fvi_cli.integrator.trajectory import Trajectory

GAUSS = [Method(cq="gauss", degree=s) for s in range(1, 9)]
OTHERS = [Method(cq=name, degree=s) for name in ("radau-iia", "lobatto-iiic") for s in (2, 3, 4)]
BDF = [
    Method(cq=f"bdf{p}", degree=d, sampling=sampling)
    for p in range(1, 7)
    for d, sampling in ((1, "nodes"), (2, "points"))
]


def integrated(scene: Scene, method: Method, steps: int | Mesh, most: int | None) -> Trajectory:
    """A scene by blocks of at most so many steps; None: as long as it chooses."""
    mesh = mesh_for(scene, method, steps) if isinstance(steps, int) else steps
    (found,) = integrate_scenes([scene], method, mesh, most=most)
    return found


def difference(one: Trajectory, other: Trajectory) -> float:
    """Largest difference of positions and momenta, relative."""
    assert one.status == other.status
    pairs = ((one.position, other.position), (one.momentum, other.momentum))
    return max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)


def of_blocks(scene: Scene, method: Method, steps: int | Mesh) -> float:
    """The largest difference of blocks of any length to single steps."""
    known = integrated(scene, method, steps, 1)
    # where errors are amplified without a bound there is nothing to compare
    if known.status != "ok":
        return 0.0
    return max(difference(integrated(scene, method, steps, most), known) for most in (None, 8))


@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (1.0,), (0.3, 1.0, 1.6), ()])
@pytest.mark.parametrize("method", [*GAUSS, *OTHERS], ids=lambda one: one.case)
def test_linear_scenes_by_runge_kutta_methods(method: Method, orders: tuple[float, ...]) -> None:
    scene = oscillator(method.degree, orders)
    for steps in (7, 700):
        assert of_blocks(scene, method, steps) < 1e-13


@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (1.0,), (0.3, 1.0, 1.6)])
@pytest.mark.parametrize("method", BDF, ids=lambda one: one.case)
def test_linear_scenes_by_backward_differences(method: Method, orders: tuple[float, ...]) -> None:
    scene = oscillator(method.degree, orders)
    for steps in (7, 700):
        assert of_blocks(scene, method, steps) < 1e-11


@pytest.mark.parametrize("method", [GAUSS[2], OTHERS[0], *BDF[2:4]], ids=lambda m: m.case)
def test_riemann_liouville_and_forces_with_break_points(method: Method) -> None:
    scene = oscillator(3, (0.3, 0.7), derivative="riemann-liouville")
    assert of_blocks(scene, method, 300) < 1e-12
    forcing = fvi.Forcing.from_functions(
        lambda t: np.where(t < 3.0, np.sin(2 * t), 1.0), break_points=(3.0,)
    )
    assert of_blocks(oscillator(2, (0.5, 1.5), forcing=forcing), method, 640) < 1e-13


@pytest.mark.parametrize("method", [*GAUSS[:6], OTHERS[1], *BDF[2:6]], ids=lambda m: m.case)
def test_pendulums(method: Method) -> None:
    for seed, orders in enumerate([(0.5,), (0.3, 1.5)]):
        assert of_blocks(pendulum(seed, orders), method, 600) < 1e-11


@pytest.mark.parametrize("decouples", [False, True])
def test_chains(decouples: bool) -> None:
    for method in (GAUSS[1], BDF[3]):
        for steps in (50, 600):
            assert of_blocks(chain(7, 7, decouples=decouples), method, steps) < 3e-13


@pytest.mark.parametrize("order", [0.5, 1.0, 1.5])
def test_general_lagrangians(order: float) -> None:
    for method in (GAUSS[2], OTHERS[1], BDF[3]):
        assert of_blocks(two_joints(1, order), method, 1000) < 1e-11


def test_a_wrong_table_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, made = oscillator(3, (0.5,)), Operator.__init__

    def make(self: Operator, *given: object, **more: object) -> None:
        made(self, *given, **more)
        if self.frame.count > 1:
            self.by_load[:, -1, 0] *= 1 + 1e-6

    monkeypatch.setattr(Operator, "__init__", make)
    assert of_blocks(scene, GAUSS[2], 200) > 1e-11


@pytest.mark.parametrize("kind", ["few dampers", "everywhere", "undamped"])
def test_structures(kind: str) -> None:
    """The same matrices sparse and dense: by a factorisation, and as one member or modes."""
    n, rng = 90, RNG(4)
    laplace = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    few = np.diag([1.0 if place in (5, 70) else 0.0 for place in range(n)])
    matrix = {"few dampers": few, "everywhere": 0.01 * laplace, "undamped": 0 * few}[kind]
    position, velocity = rng.normal(size=(2, n))

    def scene(form: Callable[[np.ndarray], object]) -> Scene:
        return fvi.linear_oscillator(
            mass=form(np.eye(n)),
            stiffness=form(100 * laplace),
            damping=tuple(
                fvi.FractionalDamping(order=order, coefficient=form(matrix)) for order in (0.5, 1.5)
            ),
            initial_position=position,
            initial_velocity=velocity,
            final_time=2.0,
        )

    for method, steps in ((GAUSS[1], 37), (BDF[3], 37), (GAUSS[2], fvi.graded_mesh(2.0, 9, 2.0))):
        sparse = integrated(scene(csr_array), method, steps, None)
        dense = integrated(scene(np.asarray), method, steps, 1)
        assert difference(sparse, dense) < 3e-14
