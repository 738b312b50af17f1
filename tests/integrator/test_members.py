"""Who is stepped together, and what becomes of members that end early.

That a member is what it is by itself, in any company, is in
:mod:`test_every_route`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.laws import prony
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import batch_kind, integrate, integrate_members
from fvi_cli.integrator.memory.damping import pattern_of
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch, uniform_mesh
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.run.on_mesh import integrate_scenes
from fvi_cli.scenes.data import duffing

BDF2 = Method(cq="bdf2", degree=1)
NODES = Method(cq="bdf2", sampling="nodes", degree=1)
GAUSS2 = Method(cq="gauss", degree=2)
GRADED3 = Method(cq="gauss", degree=3, start="graded")
FORCE = in_pieces("sin(3*t)", 1.7, "0.5")


def springs(count: int, *orders: float, **more: object) -> list[Scene]:
    rng = np.random.default_rng(6)
    return [
        spring(
            *((order, rng.uniform(0.1, 0.8)) for order in orders),
            T=4.0,
            k=rng.uniform(0.5, 9.0),
            x=rng.normal(),
            v=rng.normal(),
            **more,
        )
        for _ in range(count)
    ]


def swings(count: int, *orders: float) -> list[Scene]:
    rng = np.random.default_rng(5)
    return [
        swing(*((order, 0.3) for order in orders), T=4.0, omega=rng.uniform(0.5, 3), x=rng.normal())
        for _ in range(count)
    ]


def check_alone(scenes: list[Scene], method: AnyMethod, n_steps: int) -> list[str]:
    """That every member ends as it does alone; returns how."""
    runs = integrate_members(scenes, method, n_steps)
    for scene, run in zip(scenes, runs, strict=True):
        alone = integrate(scene, method, n_steps)
        assert (run.status, run.message) == (alone.status, alone.message)
        limit = 1e-9 * np.abs(alone.position).max()
        assert np.abs(run.position - alone.position).max() <= limit
    return [run.status for run in runs]


def companions(scenes, method, n_steps):
    """How many scenes the batch of each scene has."""
    kinds = [batch_kind(scene, method, n_steps) for scene in scenes]
    return [1 if kind is None else kinds.count(kind) for kind in kinds]


def test_who_goes_together():
    many = [*springs(4, 0.5), *swings(16, 0.5), *springs(1, 0.5, forcing=FORCE)]
    assert companions(many, GAUSS2, 40) == [4] * 4 + [16] * 16 + [1]
    # a break point on the grid or not: the mesh is the same for all that have it
    assert companions(springs(4, 0.5, forcing=FORCE), GAUSS2, 41) == [4] * 4
    plain = springs(4, 0.5)
    mixed = [*plain, *springs(5, 0.7), replace(plain[0], final_time=5.0)]
    assert companions(mixed, BDF2, 64) == [4] * 4 + [5] * 5 + [1]
    other = [*plain[:3], replace(plain[3], derivative="riemann-liouville")]
    assert companions(other, BDF2, 64) == [3] * 3 + [1]


def test_orders_of_their_own_share_the_states_but_not_a_graded_start():
    scenes = [swings(1, order)[0] for order in np.linspace(0.05, 0.95, 20)]
    assert companions(scenes, GAUSS2, 40) == [20] * 20
    check_alone(scenes, GAUSS2, 40)
    # another order begins with another power of t, and has another mesh
    assert companions(scenes, GRADED3, 40) == [1] * 20


def test_laws_with_rates_of_their_own_stand_apart():
    laws = [prony(moduli=[1.0, 0.3 + c], times=[0.2, 2.0], coefficient=1.0) for c in range(4)]
    laws += [prony(moduli=[1.0], times=[0.7], coefficient=1.0 + c) for c in range(4)]
    scenes = [replace(one, laws=(law,)) for one, law in zip(springs(8), laws, strict=True)]
    assert companions(scenes, GRADED3, 24) == [4] * 8


def falling(count: int) -> list[Scene]:
    """Beyond the hills of the potential a motion runs away in a finite time."""
    damping = [FractionalDamping(order=0.5, coefficient=0.1)]
    return [
        duffing(
            cubic_stiffness=-0.4,
            final_time=8.0,
            damping=damping,
            initial_position=0.1 + 0.15 * place,
        )
        for place in range(count)
    ]


def explosive(count: int) -> list[Scene]:
    """Explicit in the damping: the second is unstable."""
    scenes = springs(count, 1.5)
    scenes[1] = replace(scenes[1], damping=(FractionalDamping(order=1.5, coefficient=400.0),))
    return scenes


def singular(count: int) -> list[Scene]:
    """A midpoint step of length 2 / sqrt(-k) has a singular matrix."""
    scenes = springs(count)
    scenes[2] = spring(T=4.0, k=-64.0, x=1.0)
    return scenes


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("scenes", "method", "n_steps"),
    [
        (falling(18), GAUSS2, 100),
        (explosive(6), NODES, 3000),
        (singular(6), Method(cq="gauss", degree=1), 16),
    ],
    ids=["falling", "explosive", "singular"],
)
def test_those_that_end_early_do_not_disturb_the_others(scenes, method, n_steps):
    found = check_alone(scenes, method, n_steps)
    assert {"ok"} < set(found) <= {"ok", "failed"}
    calm = [scene for scene, status in zip(scenes, found, strict=True) if status == "ok"]
    runs = [one for one in integrate_members(scenes, method, n_steps) if one.status == "ok"]
    for one, other in zip(integrate_members(calm, method, n_steps), runs, strict=True):
        assert np.abs(one.position - other.position).max() <= 1e-12


# --- steps without a solution ---------------------------------------------------------------------


@pytest.mark.parametrize("n_steps", [3, 32, 33])
def test_singular_steps_end_a_run_wherever_they_begin(n_steps):
    """On a mesh of its own, singly and in blocks: what was done before them is kept."""
    scene = spring(T=1.0 + 0.25 * n_steps, k=-64.0, x=1.0)
    mesh = Mesh(
        stretches=(
            Stretch(begin=0.0, end=1.0, n_steps=10, step_size=0.1),
            Stretch(begin=1.0, end=scene.final_time, n_steps=n_steps, step_size=0.25),
        )
    )
    run = integrate(scene, Method(cq="gauss", degree=1), mesh)
    assert run.status == "failed"
    assert "the equations of a step of length 0.25 have no unique solution" in run.message
    assert run.time == pytest.approx(0.1 * np.arange(11))
    assert run.energy.size == 11


def test_a_singular_frozen_response_is_no_failure():
    """A pendulum that begins upside down: its linear scene there has no unique step, it has."""
    run = integrate(swing(T=128.0, x=math.pi, v=1e-3), Method(cq="gauss", degree=1), 64)
    assert run.status in ("ok", "failed")
    assert "unique" not in run.message


COUPLING = np.array([[1.0, 0.2, 0.0], [0.2, 0.5, 0.1], [0.0, 0.1, 0.3]])


def chain(*terms: tuple[float, float | np.ndarray], v: float = 0.4, **more: object) -> Scene:
    stiffness = 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    start = {"x": [1.0, 0.0, -0.3], "v": [v, 0.0, -v]}
    return spring(*terms, T=8.0, m=np.eye(3), k=stiffness, **start, **more)


def pendulum(*terms: tuple[float, float], v: float = 0.4) -> Scene:
    return swing(*terms, T=8.0, x=1.0, v=v)


def number(*terms: tuple[float, float], v: float = 0.4) -> Scene:
    return spring(*terms, T=8.0, k=2.0, x=1.0, v=v)


BUILDERS = {"number": number, "pendulum": pendulum, "chain": chain}
SWEEPS = {
    "orders below 1": [((order, 0.3), (0.5, 0.1)) for order in (0.05, 0.77, 1.0)],
    "orders above 1": [((order, 0.3), (1.5, 0.1)) for order in (1.02, 1.6, 1.97)],
    "orders on both sides": [((order, 0.3), (1.5, 0.1)) for order in (0.3, 0.9, 1.0)],
    "coefficients": [((0.5, 0.3), (1.0, size)) for size in (0.1, 0.2, -0.05)],
}


def scenes_of(kind: str, sweep: str, v: float) -> list[Scene]:
    members = SWEEPS[sweep]
    if kind == "chain":
        members = [tuple((order, size * COUPLING) for order, size in one) for one in members]
    return [BUILDERS[kind](*terms, v=v) for terms in members]


@spread(kind=BUILDERS, sweep=SWEEPS, v=[0.0, 0.4], degree=[1, 3])
def test_members_of_different_orders_are_the_runs_of_their_own(kind, sweep, v, degree):
    scenes, method = scenes_of(kind, sweep, v), Method(cq="gauss", degree=degree)
    assert len({pattern_of(one) for one in scenes}) == 1
    mesh = uniform_mesh(8.0, 100)
    together = integrate_scenes(scenes, method, mesh)
    for scene, own in zip(scenes, together, strict=True):
        (alone,) = integrate_scenes([scene], method, mesh)
        assert np.abs(alone.position - own.position).max() <= 1e-12
    assert np.abs(together[0].position - together[1].position).max() > 1e-4


@pytest.mark.parametrize("method", [Method(cq="bdf2", degree=1), Method(cq="gauss", degree=2)])
def test_terms_in_any_order_make_the_same_motion(method):
    terms = (1.5, 0.3), (0.5, 0.1)
    scenes = [number(*(terms if k % 2 else terms[::-1])) for k in range(8)]
    runs = integrate_members(scenes, method, 64)
    assert np.abs(runs[0].position - runs[1].position).max() < 1e-13
    np.testing.assert_array_equal(runs[0].position, runs[2].position)
