"""What a step is believed for: walls that its stages do not see."""

import math
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from letters import in_pieces, spring, swing
from spread import SEED

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.local_error.forces import SceneForces
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.lagrangian import lagrangian_scene


def run(scene: Scene, tolerance: float, m: int = 6) -> Trajectory:
    found = integrate(
        scene, Method(cq="gauss", degree=m), AdaptiveSteps(tolerance=tolerance), with_steps=True
    )
    assert found.status == "ok"
    return found


def one_coordinate(lagrangian: str, position: float, velocity: float, final_time: float) -> Scene:
    return lagrangian_scene(
        coordinates=["x"],
        lagrangian=lagrangian,
        initial_position=position,
        initial_velocity=velocity,
        final_time=final_time,
    )


@pytest.mark.parametrize("width", [0.03, 0.003])
def test_a_narrow_wall_is_met(width):
    wall = f"0.5*vx**2 - 5*exp(-((x - 2)/{width})**2)"
    found = run(one_coordinate(wall, 0.0, 1.0, 4.0), 1e-6)
    # from the exact turning point a time of flight back: the ball stands where V = 1/2
    turn = width * math.sqrt(math.log(10.0))
    nodes, weights = np.polynomial.legendre.leggauss(400)
    u = 0.5 * (nodes + 1.0)
    # x = x0 - (distance) u^2 takes the root out of the integrand
    top, bottom = 2.0 - turn, 0.0
    x = top - (top - bottom) * u**2
    energy = 0.5 - 5.0 * np.exp(-(((x - 2.0) / width) ** 2))
    speed = np.sqrt(2.0 * np.maximum(energy, 1e-300))
    one_way = float((0.5 * weights * 2.0 * (top - bottom) * u / speed).sum())
    assert found.position[-1, 0] == pytest.approx(2.0 * one_way - 4.0, abs=3e-6)


def test_no_more_steps_on_smooth_scenes():
    """Steps that the Legendre tail alone took."""
    scene = swing((0.5, np.array([[0.3]])), T=20.0, x=1.0)
    assert [run(scene, tol).n_steps for tol in (1e-4, 1e-6, 1e-8)] <= [25, 41, 68]


def test_what_may_hide_something():
    def hides(potential: str) -> bool:
        return SceneForces(one_coordinate(f"0.5*vx**2 - ({potential})", 1.0, 0.0, 1.0)).may_hide

    assert not hides("x**4/4 - x**2/2")
    assert not hides("1 - cos(x)")
    assert hides("exp(-x**2)")
    assert hides("1/x")
    assert not SceneForces(spring(T=1.0)).may_hide
    assert SceneForces(spring(T=1.0)).are_zero_at(0.5)
    stepped = SceneForces(spring(T=2.0, forcing=in_pieces("1", 1.0, "0")))
    assert [stepped.are_zero_at(time) for time in (0.5, 1.5)] == [False, True]


@settings(max_examples=3, deadline=None)
@given(origin=st.floats(30.0, 300.0), is_left=st.booleans())
def test_steps_do_not_depend_on_where_the_origin_lies(origin, is_left):
    """The mass grows with the velocity, and not with the place."""
    lagrangian = "0.5*vx**2 + 0.25*vx**4 - 0.5*(x - {!r})**2"
    origin = -origin if is_left else origin
    here, there = (
        run(one_coordinate(lagrangian.format(at), at + 1.0, 0.3, 9.0), 1e-6) for at in (0.0, origin)
    )
    assert there.time == pytest.approx(here.time, rel=1e-6)
    assert there.position - origin == pytest.approx(here.position, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_what_acts_behind_a_break_point_changes_no_step_before_it(seed):
    rng = np.random.default_rng([int(os.environ[SEED]), seed])
    cut, rate, order = rng.uniform(1.0, 4.0), rng.uniform(2.0, 9.0), rng.uniform(0.2, 1.4)
    make = (spring, swing)[seed % 2]
    ways = []
    for later in (f"sin({rate}*t)", "0", f"{rng.uniform(2.0, 9.0)} - t"):
        force = in_pieces(f"sin({rate}*t)", cut, later)
        found = run(make((order, 0.3), T=5.0, x=1.0, v=0.0, forcing=force), 1e-6)
        before = found.time <= cut
        assert found.time[before][-1] == cut
        ways.append((found.time[before], found.position[before], found.position[-1]))
    same, quiet, _ = ways
    assert not np.allclose(same[2], quiet[2], atol=1e-3)
    for time, position, _ in ways[1:]:
        assert np.array_equal(time, same[0])
        assert np.array_equal(position, same[1])
