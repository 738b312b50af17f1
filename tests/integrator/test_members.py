"""Who is stepped together, and what becomes of members that end early.

That a member is what it is by itself, in any company, is in
:mod:`test_every_route`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring, swing

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate, integrate_members
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.method import AnyMethod, Method
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


@pytest.mark.parametrize("method", [Method(cq="bdf2", degree=1), Method(cq="gauss", degree=2)])
def test_terms_in_any_order_make_the_same_motion(method):
    terms = (1.5, 0.3), (0.5, 0.1)
    scenes = [spring(*(terms if k % 2 else terms[::-1]), T=8.0, k=2.0, x=1.0) for k in range(8)]
    runs = integrate_members(scenes, method, 64)
    assert np.abs(runs[0].position - runs[1].position).max() < 1e-13
    np.testing.assert_array_equal(runs[0].position, runs[2].position)
