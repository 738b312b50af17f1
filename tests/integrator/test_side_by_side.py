"""Members of a sweep side by side on one mesh give what each of them gives alone."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from unittest.mock import patch

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.laws.cole_cole import fractional_zener
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.laws.prony import prony
from fvi_cli.effects.laws.tempered import tempered
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.members import (
    block_in_batch,
    companions,
    integrate_batch,
    integrate_members,
)
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.planning.plan import plan_run
from fvi_cli.scenes.nonlinear import duffing

TOLERANCE = 1e-12
GAUSS2 = Method(cq="gauss", degree=2)
GRADED3 = Method(cq="gauss", degree=3, start="graded")
METHODS = [
    GAUSS2,
    GRADED3,
    Method(cq="gauss", degree=1),
    Method(cq="radau-iia", degree=2),
    Method(cq="lobatto-iiic", degree=2, forcing_quadrature="exact"),
]
FORCE = in_pieces("sin(3*t)", 1.7, "0.5")


def damping(rng: np.random.Generator, orders: Sequence[float]) -> list[FractionalDamping]:
    return [FractionalDamping(order=o, coefficient=rng.uniform(0.1, 0.8)) for o in orders]


def swings(count: int, *orders: float, forcing: Forcing | None = None) -> list[Scene]:
    rng = np.random.default_rng(5)
    return [
        swing(
            T=4.0,
            omega=rng.uniform(0.5, 3.0),
            damping=damping(rng, orders),
            x=rng.normal(),
            v=rng.normal(),
            forcing=forcing,
        )
        for _ in range(count)
    ]


def springs(count: int, *orders: float, forcing: Forcing | None = None) -> list[Scene]:
    rng = np.random.default_rng(6)
    return [
        spring(
            T=4.0,
            m=rng.uniform(0.5, 2.0),
            k=rng.uniform(0.5, 9.0),
            damping=damping(rng, orders),
            x=rng.normal(),
            v=rng.normal(),
            forcing=forcing,
        )
        for _ in range(count)
    ]


def positive(rng: np.random.Generator) -> np.ndarray:
    matrix = rng.normal(size=(2, 2))
    return matrix @ matrix.T + np.eye(2)


def coupled(count: int) -> list[Scene]:
    """Two components with two directions of damping; nothing is diagonal together."""
    rng = np.random.default_rng(7)

    def one() -> Scene:
        m, k, near, far = (positive(rng) for _ in range(4))
        start = {"x": rng.normal(size=2), "v": rng.normal(size=2)}
        force = Forcing.from_text("cos(t)", "t")
        return spring((0.4, 0.2 * near), (1.6, 0.1 * far), T=3.0, m=m, k=k, forcing=force, **start)

    return [one() for _ in range(count)]


def modal(count: int) -> list[Scene]:
    """The same with damping like mass and stiffness: two modes."""
    rng = np.random.default_rng(8)
    return [
        replace(
            scene,
            damping=(
                FractionalDamping(order=0.5, coefficient=0.1 * scene.inertia.mass),
                FractionalDamping(order=1.5, coefficient=rng.uniform() * scene.inertia.mass),
            ),
        )
        for scene in coupled(count)
    ]


def difference(one: Trajectory, other: Trajectory) -> float:
    """Of position, momentum and energy, each over the largest one."""
    assert (one.status, one.message, one.every) == (other.status, other.message, other.every)
    assert one.time == pytest.approx(other.time, rel=1e-15, abs=0)
    worst = 0.0
    for name in ("position", "momentum", "energy"):
        a, b = getattr(one, name), getattr(other, name)
        worst = max(worst, float(np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)))
    return worst


def assert_alike(scenes: list[Scene], method: Method, n_steps: int, every: int = 1) -> None:
    runs = integrate_members(scenes, method, n_steps, every=every)
    for scene, one in zip(scenes, runs, strict=True):
        assert difference(one, integrate(scene, method, n_steps, every=every)) <= TOLERANCE


KINDS = {
    "springs": lambda: springs(9, 0.5),
    "undamped": lambda: springs(5),
    "several terms": lambda: springs(5, 0.3, 1.0, 1.4, 0.3),
    "forced": lambda: springs(5, 0.5, forcing=FORCE),
    "swings": lambda: swings(17, 0.5),
    "swings above one": lambda: swings(16, 1.7),
    "forced swings": lambda: swings(16, 0.2, 1.2, forcing=FORCE),
    "coupled": lambda: coupled(5),
    "modes": lambda: modal(5),
}


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_dampers_without_memory_take_blocks_too(degree):
    for scenes in (springs(5, 1.0), [*springs(3), *springs(3, 1.0)]):
        assert_alike(scenes, Method(cq="gauss", degree=degree), 200)


@spread(kind=KINDS, method=METHODS[:2])
def test_each_is_what_it_is_alone(kind, method):
    scenes = KINDS[kind]()
    assert companions(scenes, method, 60) == [len(scenes)] * len(scenes)
    assert_alike(scenes, method, 60)


LINEAR = ["springs", "undamped", "several terms", "forced", "coupled", "modes"]


@pytest.mark.parametrize("kind", LINEAR)
def test_whole_blocks_of_linear_members(kind):
    scenes = KINDS[kind]()
    runs = integrate_members(scenes, GAUSS2, 330)
    assert block_in_batch(scenes[0], GAUSS2) > 1
    for scene, one in zip(scenes, runs, strict=True):
        assert difference(one, integrate(scene, GAUSS2, 330)) <= TOLERANCE
    packed = integrate_batch([scenes[3], scenes[1]], GAUSS2, 330)
    for one, other in zip(packed, (runs[3], runs[1]), strict=True):
        assert np.array_equal(one.position, other.position)


@pytest.mark.parametrize("method", METHODS[2:], ids=lambda method: method.case)
def test_other_methods(method):
    for scenes in (springs(4, 0.5, 1.5, forcing=FORCE), swings(16, 0.6)):
        assert_alike(scenes, method, 50)


def test_orders_of_their_own_share_the_states():
    scenes = [swings(1, order)[0] for order in np.linspace(0.05, 0.95, 20)]
    assert companions(scenes, GAUSS2, 40) == [20] * 20
    assert_alike(scenes, GAUSS2, 40)
    # another order begins with another power of t, and has another mesh
    assert companions(scenes, GRADED3, 40) == [1] * 20


def test_riemann_liouville():
    scenes = [
        replace(scene, derivative="riemann-liouville")
        for scene in (*springs(4, 0.5), *swings(16, 0.7))
    ]
    assert_alike(scenes, GRADED3, 40)


@pytest.mark.parametrize("scenes", [springs(11, 0.5, 1.5), swings(11, 0.5), modal(6)])
def test_who_stands_beside_changes_nothing(scenes):
    """To the last bit, in any company."""
    together = integrate_batch(scenes, GAUSS2, 50)
    for places in ([3], [5, 0, 4], [*range(1, 6)], [*range(6)] * 5):
        packed = integrate_batch([scenes[place] for place in places], GAUSS2, 50)
        for place, one in zip(places, packed, strict=True):
            assert np.array_equal(one.position, together[place].position)
            assert np.array_equal(one.momentum, together[place].momentum)
            assert asdict(one.newton) == asdict(together[place].newton)


def test_one_that_cannot_be_solved_tells_itself():
    """A midpoint step of length 2 / sqrt(-k) has a singular matrix."""
    method = Method(cq="gauss", degree=1)
    scenes = springs(6)
    scenes[2] = spring(T=4.0, k=-64.0, x=1.0)
    runs = integrate_members(scenes, method, 16)
    assert [run.status for run in runs] == ["ok", "ok", "failed", "ok", "ok", "ok"]
    assert "no unique solution" in runs[2].message
    for scene, run in zip(scenes, runs, strict=True):
        assert difference(run, integrate(scene, method, 16)) <= TOLERANCE


def falling(count: int) -> list[Scene]:
    """Beyond the hills of the potential a motion runs away in a finite time."""
    return [
        duffing(
            cubic_stiffness=-0.4,
            final_time=8.0,
            damping=[FractionalDamping(order=0.5, coefficient=0.1)],
            initial_position=0.1 + 0.15 * place,
        )
        for place in range(count)
    ]


def test_some_that_run_away_do_not_disturb_the_others():
    scenes = falling(18)
    runs = integrate_members(scenes, GAUSS2, 100)
    statuses = [run.status for run in runs]
    assert "ok" in statuses
    assert statuses[-1] != "ok"
    for scene, run in zip(scenes, runs, strict=True):
        assert difference(run, integrate(scene, GAUSS2, 100)) <= TOLERANCE
    calm = [scene for scene, run in zip(scenes, runs, strict=True) if run.status == "ok"]
    for one, other in zip(
        integrate_batch(calm, GAUSS2, 100),
        [run for run in runs if run.status == "ok"],
        strict=True,
    ):
        assert np.array_equal(one.position, other.position)


def test_thinned():
    for scenes in (springs(4, 0.5), swings(16, 0.5)):
        assert_alike(scenes, GRADED3, 50, every=7)


def test_work_is_that_of_one_loop():
    """No step is done for a member alone, and a member takes what the plan says."""
    scenes = swings(24, 0.5)
    solved = patch.object(Engine, "solve", autospec=True, side_effect=Engine.solve)
    with solved as calls:
        runs = integrate_members(scenes, GAUSS2, 100)
    assert calls.call_count <= 100
    assert all(call.args[0].q == 24 for call in calls.call_args_list)
    planned = plan_run(scenes[0], GAUSS2, 100, members=24).history_operations
    assert [run.history_operations for run in runs] == 24 * [planned]
    assert all(50 < run.newton.iterations < 1000 for run in runs)


def test_a_wrong_member_would_be_seen():
    """The control: one weight of ten thousand in one coefficient."""
    scenes = swings(16, 0.5)
    runs = integrate_members(scenes, GAUSS2, 40)
    (term,) = scenes[3].damping
    moved = FractionalDamping(order=0.5, coefficient=1.0001 * term.coefficient)
    alone = integrate(replace(scenes[3], damping=(moved,)), GAUSS2, 40)
    assert difference(runs[3], alone) > 1e3 * TOLERANCE


def test_who_goes_together():
    few = [*springs(3, 0.5), *swings(15, 0.5)]
    assert companions(few, GAUSS2, 40) == [1] * 18
    many = [*springs(4, 0.5), *swings(16, 0.5), springs(1, 0.5, forcing=FORCE)[0]]
    assert companions(many, GAUSS2, 40) == [4] * 4 + [16] * 16 + [1]
    # on many steps it takes more nonlinear ones
    assert companions(many, GAUSS2, 4096) == [4] * 4 + [1] * 17
    # a break point on the grid or not: the mesh is the same for all that have it
    forced = springs(4, 0.5, forcing=FORCE)
    assert companions(forced, GAUSS2, 41) == [4] * 4


def with_laws(count: int, make: Callable[[float], Law], *orders: float) -> list[Scene]:
    rng = np.random.default_rng(9)
    return [replace(one, laws=(make(rng.uniform(0.2, 2.0)),)) for one in springs(count, *orders)]


LAWS: dict[str, Callable[[float], Law]] = {
    "zener": lambda c: fractional_zener(
        order=0.6, time=0.2 + 0.1 * c, relaxed=0.5, unrelaxed=2.0, coefficient=c
    ),
    "narrow": lambda c: fractional_zener(
        order=0.9, time=0.3, relaxed=0.5, unrelaxed=2.0, coefficient=c
    ),
    "prony": lambda c: prony(moduli=[1.0, c], times=[0.2, 2.0], coefficient=1.0),
    "tempered": lambda c: tempered(order=0.4, rate=1.5, coefficient=c),
}


@spread(name=["zener", "narrow", "prony", "tempered"], orders=[(), (0.5, 1.5)])
def test_laws_stand_side_by_side(name, orders):
    scenes = with_laws(6, LAWS[name], *orders)
    assert companions(scenes, GRADED3, 24) == [6] * 6
    found = integrate_members(scenes, GRADED3, 24)
    for one, scene in zip(found, scenes, strict=True):
        alone = integrate(scene, GRADED3, 24)
        assert np.abs(one.position - alone.position).max() < 1e-12
    # to the last bit, whatever others are beside it
    fewer = integrate_members(scenes[:4], GRADED3, 24)
    assert np.array_equal(fewer[1].position, found[1].position)


def test_laws_side_by_side_with_nonlinear_springs():
    scenes = [replace(one, laws=(LAWS["zener"](1.0),)) for one in swings(17, 0.5)]
    assert companions(scenes, GRADED3, 24) == [17] * 17
    found = integrate_members(scenes, GRADED3, 24)
    for one, scene in list(zip(found, scenes, strict=True))[:3]:
        assert np.abs(one.position - integrate(scene, GRADED3, 24).position).max() < 1e-12


def test_laws_with_rates_of_their_own_stand_apart():
    scenes = [
        *with_laws(4, LAWS["prony"]),
        *with_laws(4, lambda c: prony(moduli=[1.0], times=[0.7], coefficient=c)),
    ]
    assert companions(scenes, GRADED3, 24) == [4] * 8
