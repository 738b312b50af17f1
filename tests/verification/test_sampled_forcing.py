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


def slope(scene: Scene, degree: int) -> float:
    """Against a run on a grid that contains every knot and every grid of the ladder."""
    finest = 3 * 2**11
    fine = integrate(scene, Method(cq="gauss", degree=4, start="graded"), finest).position
    method = Method(cq="gauss", degree=degree, start="graded")
    errors = [
        np.abs(integrate(scene, method, n).position - fine[:: finest // n]).max() for n in STEPS
    ]
    return -float(np.polyfit(np.log(STEPS), np.log(errors), 1)[0])


@spread(
    order=[None, 0.5, 1.0, 1.5],
    **{"interpolation, degree, limit": [("linear", 2, 2.0), ("linear", 3, 2.0), ("cubic", 3, 4.0)]},
)
def test_knots_inside_of_steps_cost_the_order_of_the_interpolation(
    interpolation, degree, limit, order
):
    scene = shaken(interpolation, BETWEEN, order)
    assert slope(scene, degree) == pytest.approx(limit, abs=0.1)
    assert math.isnan(order_on(scene, Method(cq="gauss", degree=degree, start="graded")))


@pytest.mark.few(3)
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
    assert slope(shaken(interpolation, ON_GRID, order), degree) == pytest.approx(limit, abs=0.1)
