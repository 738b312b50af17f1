"""Steps that are found on the way: few of them, and what they cost when nothing helps.

Errors are those at all points of the mesh.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from oracles.linear_response import match_scene
from oracles.volterra import solve_volterra

from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import duffing, kepler

Array = np.ndarray
Exact = Callable[[Array], Array]


def run(scene: Scene, tolerance: float, m: int = 8, **more: float) -> Trajectory:
    method = Method(cq="gauss", degree=m)
    found = integrate(scene, method, AdaptiveSteps(tolerance=tolerance, **more), with_steps=True)
    assert found.n_steps >= found.steps.n_steps == found.time.size - 1
    return found


def error(found: Trajectory, position: Exact) -> float:
    assert found.status == "ok"
    return float(np.abs(found.position - position(found.time)).max())


PENDULUM = swing((0.5, 0.3), T=20.0, x=1.0)
STEP_FORCED = spring((1.5, 0.5), T=50.0, forcing=in_pieces("1", 1.0, "0"))
PULSE = in_pieces("0", 10.0, "1000", 10.001, "0")
PUSHED = swing((0.5, 0.3), T=100.0, x=1.0, forcing=PULSE)
TAIL = spring((0.5, 0.7), T=1e6, k=2.0, x=1.0, v=0.5)
ORBIT = kepler(
    final_time=6 * math.pi,
    damping=spring((0.5, 1e-3 * np.eye(2)), T=1.0, m=np.eye(2), k=np.eye(2)).damping,
    initial_position=[0.05, 0.0],
    initial_velocity=[0.0, math.sqrt(39.0)],
)
"""Of eccentricity 0.95."""


def by_collocation() -> Exact:
    hessian = lambda x: np.cos(x)[:, :, None]  # noqa: E731
    return solve_volterra(1.0, [(0.5, 0.3)], np.sin, hessian, None, 1.0, 0.0, 20.0).position


CASES: dict[str, tuple[Scene, float, int, int, Callable[[], Exact]]] = {
    "pendulum": (PENDULUM, 1e-6, 8, 30, by_collocation),
    "a force that jumps": (STEP_FORCED, 1e-6, 8, 60, lambda: match_scene(STEP_FORCED).position),
    "a short pulse": (PUSHED, 1e-6, 8, 130, lambda: run(PUSHED, 1e-10, m=11).steps),
    "an orbit": (ORBIT, 1e-8, 10, 160, lambda: run(ORBIT, 1e-11, m=12).steps),
    "a tail over many decades": (TAIL, 1e-11, 8, 600, lambda: match_scene(TAIL).position),
}
for mu, order, stiffness in [(50.0, 0.5, 100.0), (20.0, 1.5, 30.0), (50.0, 1.9, 1.0)]:
    one = spring((order, mu), T=5.0, k=stiffness, x=1.0, v=0.5)
    strong = match_scene(one).position
    CASES[f"strong damping, order {order}"] = (one, 1e-6, 8, 35, lambda strong=strong: strong)


@pytest.mark.parametrize("name", CASES)
def test_few_steps_lead_to_small_errors(name):
    scene, tolerance, m, most_steps, exact = CASES[name]
    found = run(scene, tolerance, m)
    assert found.n_steps <= most_steps
    assert error(found, exact()) < (1e-8 if name == "an orbit" else 1e-9)
    assert set(scene.break_points) <= set(found.time)


def test_a_jump_that_no_formula_tells_of():
    """The control: the same jump by a function costs accuracy."""
    force = Forcing.from_functions(lambda t: np.where(t <= 1.0, 1.0, 0.0))
    found = run(replace(STEP_FORCED, forcing=force), 1e-6)
    assert np.abs(found.time - 1.0).min() > 1e-12
    assert error(found, match_scene(STEP_FORCED).position) > 1e-7


@pytest.mark.parametrize("m", [3, 6])
def test_the_number_of_steps_follows_the_tolerance(m):
    """The estimate is of order m + 1, so steps are as many as tol^(-1 / (m + 1))."""
    tolerances = [1e-3, 1e-4, 1e-5, 1e-6]
    damping = spring((0.5, 0.05), T=1.0).damping
    scene = duffing(final_time=15.0, damping=damping, initial_position=1.5)
    counts = [run(scene, tolerance, m=m).n_steps for tolerance in tolerances]
    slope = -np.polyfit(np.log(tolerances), np.log(counts), 1)[0]
    assert slope == pytest.approx(1 / (m + 1), rel=0.2)


def test_a_motion_that_blows_up_ends_with_what_was_finished():
    scene = duffing(
        stiffness=-1.0,
        cubic_stiffness=-1.0,
        final_time=30.0,
        damping=spring((0.5, 0.1), T=1.0).damping,
        initial_position=1.5,
    )
    found = run(scene, 1e-6)
    assert found.status in ("diverged", "failed")
    assert found.message
    assert found.time.size > 5
    assert np.isfinite(found.position).all()
    assert found.time[-1] < 30.0


def test_no_step_is_longer_than_asked_for_and_no_more_than_the_most():
    longest = [
        np.diff(run(PENDULUM, 1e-2, m=4, **more).time).max() for more in ({"max_step": 0.1}, {})
    ]
    assert longest[0] <= 0.1 * (1 + 1e-12)
    assert longest[1] > 0.3
    found = run(PENDULUM, 1e-9, m=4, most_steps=12)
    assert (found.status, found.n_steps) == ("failed", 12)
    assert "the largest number of steps is reached" in found.message
