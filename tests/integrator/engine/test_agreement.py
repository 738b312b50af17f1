"""The engine beside the older loops of the package: scenes drawn at random, every method."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array, eye_array

import fvi_cli.api as fvi
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.loop import integrate
from fvi_cli.integrator.integrate import integrate as integrate_as_before
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import mesh_for
from fvi_cli.scenes.lagrangian import double_pendulum

GAUSS = [Method(cq="gauss", degree=s) for s in range(1, 9)]
OTHERS = [Method(cq=name, degree=s) for name in ("radau-iia", "lobatto-iiic") for s in (2, 3, 4)]
BDF = [
    Method(cq=f"bdf{p}", degree=d, sampling=sampling)
    for p in range(1, 7)
    for d, sampling in ((1, "nodes"), (2, "points"))
]
RNG = np.random.default_rng


def differences(scenes: Sequence[Scene], method: Method, steps: int | Mesh) -> np.ndarray:
    """Largest difference of positions and momenta to the older loops, relative, per scene."""
    mesh = mesh_for(scenes[0], method, steps) if isinstance(steps, int) else steps
    t, x, p = integrate(scenes, method, mesh)
    found = []
    for scene, own_x, own_p in zip(scenes, x, p, strict=True):
        known = integrate_as_before(scene, method, steps)
        if known.status == "diverged":
            continue
        assert known.status == "ok"
        reported = np.abs(t[:, None] - known.time).argmin(axis=0)
        np.testing.assert_allclose(t[reported], known.time, rtol=1e-13)
        found.append(
            max(
                np.abs(a[reported] - b).max() / np.abs(b).max()
                for a, b in ((own_x, known.position), (own_p, known.momentum))
            )
        )
    return np.array(found or [0.0])


def oscillator(seed: int, orders: tuple[float, ...], **more: object) -> Scene:
    rng = RNG(seed)
    size = 10.0 ** rng.uniform(-3, 3)
    omega = rng.uniform(0.3, 3.0)
    given = {
        "stiffness": omega**2,
        "initial_position": size * rng.uniform(0.5, 1.0),
        "initial_velocity": size * rng.uniform(-1.0, 1.0),
        "final_time": 8.0,
        "damping": tuple(
            fvi.FractionalDamping(order=one, coefficient=rng.uniform(0.1, 0.7)) for one in orders
        ),
    }
    return fvi.linear_oscillator(**{**given, **more})


def pendulum(seed: int, orders: tuple[float, ...] = (0.5,)) -> Scene:
    rng = RNG(seed)
    return fvi.pendulum(
        omega=rng.uniform(0.5, 2.0),
        damping=tuple(
            fvi.FractionalDamping(order=one, coefficient=rng.uniform(0.1, 0.5)) for one in orders
        ),
        initial_position=rng.uniform(-2.5, 2.5),
        initial_velocity=rng.uniform(-1.0, 1.0),
        final_time=20.0,
    )


def chain(seed: int, d: int, *, decouples: bool, orders: tuple[float, ...] = (0.5, 1.5)) -> Scene:
    rng = RNG(seed)
    laplace = 2 * np.eye(d) - np.eye(d, k=1) - np.eye(d, k=-1)
    rows = rng.normal(size=(d, d))
    damping = (laplace, laplace) if decouples else (laplace, rows @ rows.T / d)
    return fvi.linear_oscillator(
        mass=np.eye(d) if decouples else np.diag(rng.uniform(0.5, 2.0, d)),
        stiffness=10 * laplace,
        damping=tuple(
            fvi.FractionalDamping(order=order, coefficient=0.1 * matrix)
            for order, matrix in zip(orders, damping, strict=True)
        ),
        initial_position=rng.normal(size=d),
        initial_velocity=rng.normal(size=d),
        final_time=10.0,
    )


def two_joints(seed: int, order: float = 0.5) -> Scene:
    rng = RNG(seed)
    matrix = rng.uniform(0.1, 0.3) * np.array([[2.0, -1.0], [-1.0, 1.0]])
    return double_pendulum(
        initial_position=rng.uniform(-1.0, 1.0, 2),
        initial_velocity=rng.uniform(-0.3, 0.3, 2),
        final_time=4.0,
        damping=(fvi.FractionalDamping(order=order, coefficient=matrix),),
    )


@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (1.0,), (0.3, 1.0, 1.6), ()])
@pytest.mark.parametrize("method", [*GAUSS, *OTHERS], ids=lambda one: one.case)
def test_linear_scenes_by_runge_kutta_methods(method: Method, orders: tuple[float, ...]) -> None:
    scene = oscillator(method.degree, orders)
    for steps in (7, 200, 1500):
        assert differences([scene], method, steps).max() < 1e-13


@pytest.mark.parametrize("orders", [(0.5,), (1.5,), (1.0,), (0.3, 1.0, 1.6)])
@pytest.mark.parametrize("method", BDF, ids=lambda one: one.case)
def test_linear_scenes_by_backward_differences(method: Method, orders: tuple[float, ...]) -> None:
    scene = oscillator(method.degree, orders)
    for steps in (7, 200, 1500):
        assert differences([scene], method, steps).max() < 1e-12


@pytest.mark.parametrize("method", [GAUSS[1], GAUSS[2], OTHERS[0], *BDF[:6]], ids=lambda m: m.case)
@pytest.mark.parametrize("order", [0.3, 0.7])
def test_riemann_liouville(method: Method, order: float) -> None:
    scene = oscillator(3, (order,), derivative="riemann-liouville")
    for steps in (40, 700):
        assert differences([scene], method, steps).max() < 1e-12


def test_graded_meshes() -> None:
    mesh = fvi.graded_mesh(8.0, 150, 2.0)
    for orders in ((0.5,), (0.4, 1.4)):
        for method in (GAUSS[0], GAUSS[2], OTHERS[1]):
            assert differences([oscillator(5, orders)], method, mesh).max() < 1e-14
    pendulum_mesh = fvi.graded_mesh(20.0, 150, 2.0)
    assert differences([pendulum(5, (0.5, 1.5))], GAUSS[2], pendulum_mesh).max() < 1e-13


def test_forces_with_break_points() -> None:
    forcing = fvi.Forcing.from_functions(
        lambda t: np.where(t < 3.0, np.sin(2 * t), 1.0), break_points=(3.0,)
    )
    scene = oscillator(2, (0.5, 1.5), forcing=forcing)
    for method in (GAUSS[2], Method(cq="gauss", degree=3, start="graded")):
        for steps in (64, 640):
            assert differences([scene], method, steps).max() < 1e-13


@pytest.mark.parametrize(
    "method", [*GAUSS[:6], OTHERS[1], OTHERS[4], *BDF[2:8]], ids=lambda m: m.case
)
def test_pendulums(method: Method) -> None:
    for seed, orders in enumerate([(0.5,), (0.3, 1.5)]):
        for steps in (60, 1100):
            assert differences([pendulum(seed, orders)], method, steps).max() < 1e-11


@pytest.mark.parametrize("decouples", [False, True])
def test_chains(decouples: bool) -> None:
    for d in (2, 7):
        scene = chain(d, d, decouples=decouples)
        for method in (GAUSS[1], GAUSS[2], BDF[3]):
            for steps in (50, 600):
                assert differences([scene], method, steps).max() < 3e-13


@pytest.mark.parametrize("order", [0.5, 1.0, 1.5])
def test_general_lagrangians(order: float) -> None:
    for method in (GAUSS[0], GAUSS[2], OTHERS[1], BDF[3]):
        for steps in (100, 1000):
            assert differences([two_joints(1, order)], method, steps).max() < 1e-11


@pytest.mark.parametrize("kind", ["few dampers", "everywhere", "dense", "undamped"])
def test_large_structures(kind: str) -> None:
    n, rng = (300 if kind == "dense" else 600), RNG(4)
    laplace = diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1])
    few = np.zeros(n)
    few[[5, 90]] = 1.0, 2.0
    rows = rng.normal(size=(n, n))
    matrix = {
        "few dampers": csr_array(diags_array(few)),
        "everywhere": csr_array(0.01 * laplace),
        "dense": rows @ rows.T / n,
        "undamped": np.zeros((n, n)),
    }[kind]
    scene = fvi.linear_oscillator(
        mass=csr_array(eye_array(n)),
        stiffness=csr_array(100 * laplace),
        damping=tuple(fvi.FractionalDamping(order=g, coefficient=matrix) for g in (0.5, 1.5)),
        initial_position=rng.normal(size=n),
        initial_velocity=rng.normal(size=n),
        final_time=5.0,
    )
    for method, steps in ((GAUSS[1], 37), (BDF[3], 37), (GAUSS[2], fvi.graded_mesh(5.0, 9, 2.0))):
        assert differences([scene], method, steps).max() < 3e-14


BATCHES = {
    "linear": [oscillator(seed, (0.5, 1.5)) for seed in range(11)],
    "pendulums": [pendulum(seed) for seed in range(11)],
    "chains": [chain(seed, 4, decouples=False) for seed in range(11)],
    "general": [two_joints(seed) for seed in range(11)],
}


@pytest.mark.parametrize("name", BATCHES)
@pytest.mark.parametrize("method", [GAUSS[2], BDF[3]], ids=lambda one: one.case)
def test_batches(name: str, method: Method) -> None:
    assert differences(BATCHES[name], method, 300).max() < 1e-11


@pytest.mark.parametrize("name", BATCHES)
@pytest.mark.parametrize("method", [GAUSS[2], BDF[3]], ids=lambda one: one.case)
@pytest.mark.parametrize("most", [1, 8])
def test_a_member_has_the_same_bits_alone_and_among_others(
    name: str, method: Method, most: int
) -> None:
    scenes, steps = BATCHES[name], 300
    mesh = mesh_for(scenes[0], method, steps)
    _, together, _ = integrate(scenes, method, mesh, most=most)
    for group in ([0], [3, 7], list(range(5, 11))):
        _, own, _ = integrate([scenes[one] for one in group], method, mesh, most=most)
        for position, place in zip(own, group, strict=True):
            assert np.array_equal(position, together[place])


@pytest.mark.parametrize("ratio", [1e-6, 1.0, 7e6])
@pytest.mark.parametrize("most", [None, 1, 8])
def test_a_component_is_as_accurate_beside_a_large_one(ratio: float, most: int | None) -> None:
    """V = x^2/2 + 1 - cos y: the pendulum does not know how far the oscillator swings."""
    pair = _uncoupled(ratio)
    single = fvi.pendulum(
        damping=(fvi.FractionalDamping(order=0.5, coefficient=0.1),),
        initial_position=2.5,
        final_time=20.0,
    )
    method = GAUSS[2]
    for steps in (200, 1000):
        mesh = mesh_for(pair, method, steps)
        _, x, _ = integrate([pair], method, mesh, most=most)
        known = integrate_as_before(single, method, mesh)
        assert np.abs(x[0, :, 1] - known.position[:, 0]).max() < 1e-12


def _uncoupled(first: float) -> Scene:
    from fvi_cli.mathematics.expressions import Expression
    from fvi_cli.scenes.data import make_scene

    energy = Expression.parse("x*x/2 + 1 - cos(y)", variables=("x", "y"))
    potential = fvi.ExpressionPotential(coordinates=("x", "y"), energy_expression=energy)
    damping = (fvi.FractionalDamping(order=0.5, coefficient=0.1 * np.eye(2)),)
    return make_scene(
        np.eye(2), potential, damping=damping, initial_position=[first, 2.5], final_time=20.0
    )
