"""Steps that are found on the way: few of them, and what they cost when nothing helps.

Every scene has one local tolerance, chosen once; errors are those at all points of the mesh.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from oracles.linear_response import match_scene

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.data import duffing, kepler
from fvi_cli.scenes.lagrangian import lagrangian_scene

Array = np.ndarray
Exact = Callable[[Array], Array]


def gauss(m: int, **more) -> Method:
    return Method(cq="gauss", degree=m, **more)


def damping(order: float, coefficient: float, d: int = 1) -> list[FractionalDamping]:
    return [FractionalDamping(order=order, coefficient=coefficient * np.eye(d))]


def run(scene: Scene, tolerance: float, m: int = 8, **more) -> Trajectory:
    found = integrate(scene, gauss(m), AdaptiveSteps(tolerance=tolerance, **more), with_steps=True)
    assert found.n_steps == found.steps.n_steps == found.time.size - 1
    return found


def exact(scene: Scene) -> Exact:
    found = match_scene(scene)
    return found.position


def error(found: Trajectory, position: Exact) -> float:
    assert found.status == "ok"
    return float(np.abs(found.position - position(found.time)).max())


def on_uniform_steps(found: Trajectory, scene: Scene, n_steps: int) -> float:
    """Distance from a run on a graded uniform mesh, on its grid."""
    other = integrate(scene, gauss(4, start="graded"), n_steps)
    assert other.status == "ok"
    return float(np.abs(found.steps(other.time) - other.position).max())


PENDULUM = swing(T=20.0, x=1.0, damping=damping(0.5, 0.3))
STEP_FORCED = spring(T=50.0, damping=damping(1.5, 0.5), forcing=in_pieces("1", 1.0, "0"))
PULSE = swing(
    T=100.0, x=1.0, damping=damping(0.5, 0.3), forcing=in_pieces("0", 10.0, "1000", 10.001, "0")
)


def test_a_pendulum():
    found = run(PENDULUM, 1e-6)
    assert found.n_steps <= 30
    finer = run(PENDULUM, 1e-10, m=11)
    assert error(found, finer.steps) < 1e-9
    assert on_uniform_steps(finer, PENDULUM, 2048) < 1e-10


def test_a_force_that_jumps():
    found = run(STEP_FORCED, 1e-6)
    assert found.n_steps <= 60
    assert 1.0 in found.time
    assert error(found, exact(STEP_FORCED)) < 1e-9


def test_a_jump_that_no_formula_tells_of():
    """The control: the same jump by a function costs accuracy and steps."""
    force = Forcing.from_functions(lambda t: np.where(t <= 1.0, 1.0, 0.0))
    hidden = replace(STEP_FORCED, forcing=force)
    found, told = run(hidden, 1e-6), run(STEP_FORCED, 1e-6)
    assert np.abs(found.time - 1.0).min() > 1e-12
    assert found.rejected > told.rejected
    assert error(found, exact(STEP_FORCED)) > 1e-7


@pytest.mark.parametrize(
    ("mu", "order", "stiffness"), [(50.0, 0.5, 100.0), (20.0, 1.5, 30.0), (50.0, 1.9, 1.0)]
)
def test_strong_damping(mu, order, stiffness):
    scene = spring(T=5.0, k=stiffness, x=1.0, v=0.5, damping=damping(order, mu))
    found = run(scene, 1e-6)
    assert found.n_steps <= 35
    assert error(found, exact(scene)) < 1e-9


def test_a_short_pulse():
    found = run(PULSE, 1e-6)
    assert found.n_steps <= 130
    assert {10.0, 10.001} <= set(found.time)
    finer = run(PULSE, 1e-10, m=11)
    assert error(found, finer.steps) < 1e-9
    # the momentum of the pulse is 1; with half of it the motion is another one
    half = replace(PULSE, forcing=in_pieces("0", 10.0, "500", 10.001, "0"))
    other = run(half, 1e-6)
    assert np.abs(found.steps(12.0) - other.steps(12.0)) > 0.1


def eccentric_orbit(eccentricity: float) -> Scene:
    speed = math.sqrt((1 + eccentricity) / (1 - eccentricity))
    return kepler(
        final_time=6 * math.pi,
        damping=damping(0.5, 1e-3, 2),
        initial_position=[1 - eccentricity, 0.0],
        initial_velocity=[0.0, speed],
    )


def test_an_orbit_of_eccentricity_95():
    scene = eccentric_orbit(0.95)
    found = run(scene, 1e-8, m=10)
    assert found.n_steps <= 160
    assert found.rejected < found.n_steps
    finer = run(scene, 1e-11, m=12)
    assert error(found, finer.steps) < 1e-8


@pytest.mark.slow
def test_an_orbit_of_eccentricity_95_against_equal_steps():
    found = run(eccentric_orbit(0.95), 1e-11, m=12)
    assert on_uniform_steps(found, eccentric_orbit(0.95), 16_384) < 1e-8


def test_a_tail_over_many_decades():
    scene = spring(T=1e6, k=2.0, x=1.0, v=0.5, damping=damping(0.5, 0.7))
    found = run(scene, 1e-11)
    assert found.n_steps <= 600
    assert error(found, exact(scene)) < 1e-9
    late = found.time > 1e3
    truth = exact(scene)(found.time[late])
    assert late.sum() > 20
    assert np.abs(found.position[late] / truth - 1).max() < 1e-9
    # the tail is (mu x0 / k) t^-gamma / Gamma(1 - gamma), a first term of an expansion
    leading = 0.35 * 1e6**-0.5 / math.gamma(0.5)
    assert found.position[-1, 0] == pytest.approx(leading, rel=1e-2)


def slope(tolerances: Sequence[float], counts: Sequence[int]) -> float:
    return float(-np.polyfit(np.log(tolerances), np.log(counts), 1)[0])


@pytest.mark.parametrize("m", [3, 6])
def test_the_number_of_steps_follows_the_tolerance(m):
    """The estimate is of order m + 1, so steps are as many as tol^(-1 / (m + 1))."""
    tolerances = [1e-3, 1e-4, 1e-5, 1e-6]
    scene = duffing(final_time=15.0, damping=damping(0.5, 0.05), initial_position=1.5)
    counts = [run(scene, tolerance, m=m).n_steps for tolerance in tolerances]
    assert slope(tolerances, counts) == pytest.approx(1 / (m + 1), rel=0.2)


@pytest.mark.parametrize("scene", [PENDULUM, STEP_FORCED, PULSE], ids=["pendulum", "step", "pulse"])
def test_sizes_are_rounded_so_that_tables_are_shared(scene):
    found = run(scene, 1e-9)
    sizes = found.steps.step_size
    parts = len(scene.break_points) + 1
    halves = 2 * math.log2(sizes.max() / sizes.min())
    # the last steps before a break point or the end share what is left
    assert len(set(sizes.tolist())) <= halves + 2 + 3 * parts
    assert found.newton.iterations < 12 * (found.n_steps + found.rejected)


def test_work_is_linear_in_the_number_of_steps():
    counts = []
    for tolerance in (1e-5, 1e-7):
        found = run(PENDULUM, tolerance, m=4)
        counts.append(found.history_operations / found.n_steps)
    assert counts[0] == counts[1]


@pytest.mark.parametrize("m", [4, 6])
def test_an_undamped_motion_begins_with_longer_steps(m):
    scene = spring(T=20.0, x=1.0)
    found = run(scene, 1e-8, m=m)
    assert found.time[1] > 10 * run(PENDULUM, 1e-8, m=m).time[1]
    assert error(found, lambda t: np.cos(t)[:, None]) < 1e-4
    assert error(run(scene, 1e-10, m=m), lambda t: np.cos(t)[:, None]) < 1e-7


def test_a_general_lagrangian():
    """A pendulum in another coordinate, q = x + x^3 / 3 with x = the angle."""
    scene = lagrangian_scene(
        coordinates=("x",),
        lagrangian="vx**2*(1 + x*x)**2/2 - (x + x**3/3)**2/2",
        final_time=10.0,
        initial_position=0.8,
        initial_velocity=0.2,
    )
    assert scene.lagrangian is not None
    found = run(scene, 1e-9)
    q = found.position[:, 0] + found.position[:, 0] ** 3 / 3
    q0, v0 = 0.8 + 0.8**3 / 3, 0.2 * (1 + 0.8**2)
    assert np.abs(q - q0 * np.cos(found.time) - v0 * np.sin(found.time)).max() < 1e-10


def test_a_motion_that_blows_up_ends_with_what_was_finished():
    scene = duffing(
        stiffness=-1.0,
        cubic_stiffness=-1.0,
        final_time=30.0,
        damping=damping(0.5, 0.1),
        initial_position=1.5,
    )
    found = run(scene, 1e-6)
    assert found.status in ("diverged", "failed")
    assert found.message
    assert found.time.size > 5
    assert np.isfinite(found.position).all()
    assert found.time[-1] < 30.0


def test_no_step_is_longer_than_asked_for():
    longest = [
        np.diff(integrate(PENDULUM, gauss(4), AdaptiveSteps(tolerance=1e-2, **more)).time).max()
        for more in ({"max_step": 0.1}, {})
    ]
    assert longest[0] <= 0.1 * (1 + 1e-12)
    assert longest[1] > 0.3


def test_the_most_steps():
    found = integrate(PENDULUM, gauss(4), AdaptiveSteps(tolerance=1e-9, most_steps=12))
    assert found.status == "failed"
    assert found.n_steps == 12
    assert found.time.size == 13
    assert "the largest number of steps is reached" in found.message
    assert found.message.startswith("step 12, t = ")
