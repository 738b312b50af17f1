"""What the interpolation of a sampled force costs: measured orders against the stated ones.

Knots at thirds of the steps of every grid of the ladder, so that each of them lies at the same
place of a step, or of its mirror image, on every grid; and knots on all grids.
"""

import math

import numpy as np
import pytest
from letters import spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import Interpolation, SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import order_on
from fvi_cli.integrator.method import Method

BETWEEN, ON_GRID = 6, 8
"""Numbers of intervals between samples on [0, 3]."""
STEPS = (32, 64, 128, 256)


def shaken(interpolation: Interpolation, intervals: int, order: float | None) -> Scene:
    values = np.random.default_rng(1).standard_normal(intervals + 1)
    time = np.linspace(0.0, 3.0, intervals + 1)
    force = SampledForce.through(time, values, interpolation, source="a of quake.csv")
    damping = [] if order is None else [FractionalDamping(order=order, coefficient=1.0)]
    return spring(
        T=3.0, damping=damping, forcing=Forcing(pieces=(ForcingPiece(components=(force,)),))
    )


def motion_between_corners(scene: Scene, n_steps: int) -> np.ndarray:
    """Exact motion of x'' + x = f from rest, f straight between the knots, on a grid.

    On every interval x = a + b s + (x0 - a) cos s + (v0 - b) sin s.
    """
    (force,) = scene.forcing.samples
    grid = 3.0 / n_steps * np.arange(n_steps + 1)
    result = np.zeros(n_steps + 1)
    x, v = 0.0, 0.0
    for index, (left, right) in enumerate(zip(force.knots[:-1], force.knots[1:], strict=True)):
        slope, value = force.coefficients[:, index]
        inside = (grid > left) & (grid <= right + 1e-12)
        s = np.append(grid[inside] - left, right - left)
        path = value + slope * s + (x - value) * np.cos(s) + (v - slope) * np.sin(s)
        result[inside] = path[:-1]
        width = right - left
        x, v = path[-1], slope - (x - value) * np.sin(width) + (v - slope) * np.cos(width)
    return result


def slope_and_errors(scene: Scene, method: Method, reference) -> tuple[float, list[float]]:
    errors = []
    for n_steps in STEPS:
        trajectory = integrate(scene, method, n_steps)
        errors.append(float(np.abs(trajectory.position[:, 0] - reference(n_steps)).max()))
    return -float(np.polyfit(np.log(STEPS), np.log(errors), 1)[0]), errors


def refined(scene: Scene):
    """A run on a grid that contains every knot and every grid of the ladder."""
    finest = 3 * 2**11
    method = Method(cq="gauss", degree=4, start="graded")
    path = integrate(scene, method, finest).position[:, 0]
    return lambda n_steps: path[:: finest // n_steps]


@spread(
    order=[None, 0.5, 1.0, 1.5],
    **{"interpolation, degree, limit": [("linear", 2, 2.0), ("linear", 3, 2.0), ("cubic", 3, 4.0)]},
)
def test_knots_inside_of_steps_cost_the_order_of_the_interpolation(
    interpolation, degree, limit, order
):
    scene = shaken(interpolation, BETWEEN, order)
    method = Method(cq="gauss", degree=degree, start="graded")
    measured, errors = slope_and_errors(scene, method, refined(scene))
    assert math.isnan(order_on(scene, method))
    assert measured == pytest.approx(limit, abs=0.1), errors


@pytest.mark.parametrize(
    ("interpolation", "degree", "order", "limit"),
    [
        ("linear", 2, None, 4.0),
        ("linear", 2, 1.0, 4.0),
        ("linear", 3, 0.5, 4.5),
        ("linear", 3, 1.5, 3.5),
        ("cubic", 2, None, 4.0),
    ],
)
def test_knots_on_the_grid_are_seen_by_the_memory_only(interpolation, degree, order, limit):
    scene = shaken(interpolation, ON_GRID, order)
    method = Method(cq="gauss", degree=degree, start="graded")
    measured, errors = slope_and_errors(scene, method, refined(scene))
    assert measured == pytest.approx(limit, abs=0.1), errors


def test_the_reference_is_the_motion_between_corners():
    scene = shaken("linear", BETWEEN, None)
    reference = refined(scene)
    np.testing.assert_allclose(reference(96), motion_between_corners(scene, 96), atol=2e-13)
    # the control: the spline through the same samples is another motion
    other = shaken("cubic", BETWEEN, None)
    assert np.abs(refined(other)(96) - motion_between_corners(scene, 96)).max() > 1e-2
