"""Every pair of routes to one discrete motion, on scenes drawn at random.

One mesh, one method: blocks of equal steps, single steps, the sums written out, batches, thinned
runs, runs in parts and runs with diagnostics must end with the same status, and
differ by less than 1e-11 of the largest position while that is below 1e3 times the first.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from letters import spring, swing
from written_out import integrate_written_out

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loop.checkpoint import Checkpoint
from fvi_cli.integrator.members import integrate_members
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.parts import integrate_part
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene
from fvi_cli.scenes.nonlinear import duffing

Array = np.ndarray

ORDERS = (0.07, 0.3, 0.5, 0.8, 0.95, 1.0, 1.1, 1.25, 1.5, 1.75, 1.9)
GENERAL = ("chain of five", "double pendulum", "rider")
KINDS = ("coupled", "modes", "oscillator", "growing", "pendulum", "duffing", *GENERAL)


@dataclass(frozen=True)
class Case:
    """A scene, a method and a number of steps."""

    scene: Scene
    method: Method
    n_steps: int


def positive(rng: np.random.Generator, d: int, least: float, most: float) -> Array:
    rotation = np.linalg.qr(rng.normal(size=(d, d)))[0]
    matrix = rotation @ np.diag(rng.uniform(least, most, d)) @ rotation.T
    return 0.5 * (matrix + matrix.T)


def force(rng: np.random.Generator, d: int, n_steps: int, h: float, *, broken: bool) -> Forcing:
    def components(amplitude: float) -> tuple:
        texts = [f"{amplitude * rng.uniform(-1, 1):.3f}*cos({k + 1}*t)" for k in range(d)]
        return Forcing.from_text(*texts).pieces[0].components

    pieces = [ForcingPiece(components=components(0.6))]
    if broken:
        end = h * int(rng.integers(1, n_steps))
        pieces = [replace(pieces[0], until=end), ForcingPiece(components=components(1.0))]
    return Forcing(pieces=tuple(pieces))


def scene_of(rng: np.random.Generator, kind: str, n_steps: int, n_terms: int) -> Scene:
    """A scene of a kind, with `n_terms` terms of damping on both sides of 1."""
    d = {"chain of five": 5, "double pendulum": 2}.get(kind, 1)
    if kind in ("coupled", "modes"):
        d = int(rng.integers(2, 6))
    final_time = float(rng.uniform(1.0, 8.0))
    orders = rng.choice(ORDERS, n_terms, replace=False)
    size = 0.3 if kind == "growing" else float(rng.choice([0.02, 0.4, 3.0]))
    damping = [
        FractionalDamping(
            order=float(order),
            coefficient=size
            * (np.eye(d) if kind in ("modes", "double pendulum") else positive(rng, d, 0.1, 1.0)),
        )
        for order in orders
    ]
    riemann = rng.random() < 0.3
    still = riemann and any(order > 1 for order in orders)
    data = {
        "final_time": final_time,
        "damping": damping,
        "initial_position": np.zeros(d) if still else 0.7 * rng.normal(size=d),
        "initial_velocity": rng.normal(size=d),
        "derivative": "riemann-liouville" if riemann else "caputo",
    }
    forced = rng.integers(3)
    if forced:
        data["forcing"] = force(rng, d, n_steps, final_time / n_steps, broken=forced == 2)
    if kind == "coupled":
        mass, stiffness = positive(rng, d, 0.5, 2.0), positive(rng, d, 0.2, 30.0)
        return spring(m=mass, k=stiffness, **data)
    if kind == "modes":
        stiffness = positive(rng, d, 0.2, 30.0)
        return spring(m=np.eye(d), k=stiffness, **data)
    if kind == "growing":
        return spring(k=-float(rng.uniform(0.1, 4.0)), **data)
    if kind == "oscillator":
        return spring(k=float(10 ** rng.uniform(-1, 3)), **data)
    if kind == "pendulum":
        return swing(omega=2.0, **data)
    if kind == "duffing":
        return duffing(stiffness=float(rng.choice([-1.0, 1.0])), **data)
    if kind == "chain of five":
        return hard_springs(d, data)
    if kind == "double pendulum":
        return double_pendulum(**data)
    return lagrangian_scene(
        coordinates=("x",), lagrangian="vx**2*(1 + x*x)/2 - x**2/2 - x**4/8", **data
    )


def hard_springs(d: int, data: dict) -> Scene:
    """Hard springs between unit masses."""
    names = [f"q{k}" for k in range(d)]
    kinetic = " + ".join(f"v{name}**2/2" for name in names)
    springs = " + ".join(
        f"(({a})-({b}))**2/2 + (({a})-({b}))**4/4"
        for a, b in zip(["0", *names], [*names, "0"], strict=True)
    )
    return lagrangian_scene(coordinates=names, lagrangian=f"{kinetic} - ({springs})", **data)


def case_of(seed: int, kind: str) -> Case:
    rng = np.random.default_rng(seed)
    # on steps as long as half a turn the equations have several solutions, and each route finds one
    choice = [33, 70, 128] if kind in GENERAL else [5, 33, 70, 128, 300]
    n_steps = int(rng.choice(choice))
    scene = scene_of(rng, kind, n_steps, int(rng.integers(0, 4)))
    family = str(rng.choice(["gauss", "gauss", "gauss", "radau-iia", "lobatto-iiic"]))
    method = Method(cq=family, degree=int(rng.integers(1, 5)))
    # unstable runs of a double pendulum come to steps whose equations have several solutions
    if rng.random() < 0.3 and kind != "double pendulum":
        order, sampling = int(rng.choice([1, 2, 3, 4, 6])), str(rng.choice(["nodes", "points"]))
        method = Method(cq=f"bdf{order}", degree=int(rng.integers(1, 4)), sampling=sampling)
    return Case(scene, method, n_steps)


def sound(found: Trajectory) -> int:
    """Points up to which positions are below 1e3 times the first."""
    size = np.abs(found.position).max(axis=1)
    first = size[0] + 1e-3 * size[: min(20, size.size)].max()
    outside = np.flatnonzero(~(size < 1e3 * first))
    return int(outside[0]) if outside.size else size.size


def check_same(one: Trajectory, other: Trajectory, tolerance: float = 1e-11) -> None:
    assert one.status == other.status, (one.message, other.message)
    count = min(sound(one), other.time.size)
    if one.status == "ok":
        assert one.time.size == other.time.size
    assert np.allclose(one.time[:count], other.time[:count], rtol=1e-13, atol=1e-14)
    for name in ("position", "momentum"):
        a, b = getattr(one, name)[:count], getattr(other, name)[:count]
        assert np.abs(a - b).max() <= tolerance * np.abs(a).max(), name


def check_identical(
    one: Trajectory, other: Trajectory, picked: slice | Array = slice(None)
) -> None:
    assert one.status == other.status
    for name in ("time", "position", "momentum", "energy"):
        assert np.array_equal(getattr(one, name)[picked], getattr(other, name)), name


def single_steps(case: Case) -> Trajectory:
    """The same steps on a mesh through given points, or with sums written out, one by one."""
    scene = case.scene
    if not case.method.is_runge_kutta:
        return integrate(scene, replace(case.method, history="direct"), case.n_steps)
    times = scene.final_time / case.n_steps * np.arange(case.n_steps + 1)
    times[-1] = scene.final_time
    return integrate(scene, case.method, mesh_of(times, scene.break_points))


def check_written_out(case: Case, usual: Trajectory) -> None:
    if usual.status != "ok" or not case.method.is_runge_kutta:
        return
    other = integrate_written_out(case.scene, case.method, case.n_steps)
    count = sound(usual)
    for name in ("position", "momentum"):
        a, b = getattr(usual, name)[:count], getattr(other, name)[:count]
        assert np.abs(a - b).max() <= 1e-11 * np.abs(a).max(), name


def check_single(case: Case, usual: Trajectory) -> None:
    check_same(usual, single_steps(case))


def check_members(case: Case, usual: Trajectory) -> None:
    softer = replace(case.scene, initial_velocity=0.5 * case.scene.initial_velocity)
    batch = integrate_members([case.scene, softer, case.scene], case.method, case.n_steps)
    for one in (batch[0], batch[2]):
        check_same(usual, one)
    check_same(integrate(softer, case.method, case.n_steps), batch[1])


def check_thinned(case: Case, usual: Trajectory) -> None:
    every = 7
    last = usual.time.size - 1
    kept = np.array(sorted({*range(0, last + 1, every), last}))
    check_identical(usual, integrate(case.scene, case.method, case.n_steps, every=every), kept)


def check_watched(case: Case, usual: Trajectory) -> None:
    asked, with_steps = DiagnosticsRequest(energy_balance=True), case.method.is_runge_kutta
    found = integrate(
        case.scene, case.method, case.n_steps, diagnostics=asked, with_steps=with_steps
    )
    check_identical(usual, found)


def check_parts(case: Case, usual: Trajectory) -> None:
    first = integrate_part(case.scene, case.method, case.n_steps, until=1)
    parts = [first]
    if first.checkpoint is not None:
        loaded = Checkpoint.from_bytes(first.checkpoint.to_bytes())
        parts.append(integrate_part(case.scene, case.method, case.n_steps, checkpoint=loaded))
    for name in ("time", "position", "momentum", "energy"):
        joined = np.concatenate([getattr(part.trajectory, name) for part in parts])
        assert np.array_equal(joined[: usual.time.size], getattr(usual, name)), name


CHECKS: tuple[Callable[[Case, Trajectory], None], ...] = (
    check_written_out,
    check_single,
    check_members,
    check_thinned,
    check_watched,
    check_parts,
)

QUIET = {
    "deadline": None,
    "database": None,
    "suppress_health_check": list(HealthCheck),
    "phases": (Phase.explicit, Phase.generate, Phase.shrink),
    "derandomize": True,
}
SEEDS = st.integers(0, 2**32 - 1)


def check_all(seed: int, kind: str) -> None:
    case = case_of(seed, kind)
    usual = integrate(case.scene, case.method, case.n_steps)
    for check in CHECKS:
        check(case, usual)


@pytest.mark.parametrize("kind", KINDS)
def test_all_routes_agree(kind):
    few = 1 if kind in GENERAL else 2
    settings(max_examples=few, **QUIET)(given(seed=SEEDS)(lambda seed: check_all(seed, kind)))()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_all_routes_agree_on_many_scenes(kind):
    settings(max_examples=150, **QUIET)(given(seed=SEEDS)(lambda seed: check_all(seed, kind)))()
