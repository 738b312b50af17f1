r"""Orders that a singular start leaves, on graded meshes and with starting weights of any powers.

What is drawn: orders of damping, gradings, powers of the weights. Every slope is held from both
sides, where the part of the error that falls most slowly is the largest one.
"""

import math
import os
import random

import numpy as np
import pytest
from letters import spring
from oracles.linear_response import match_scene
from spread import SEED

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import order_on
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.studies.order import fit_slope

NUMBERS = (24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
ROUND_OFF = 1e-12


def drawn(name: str) -> random.Random:
    return random.Random(f"{os.environ[SEED]} {name}")


def measured(scene: Scene, method: Method, grading: float) -> float:
    """Slope through the last four errors above round-off."""
    found = match_scene(scene)
    assert found is not None
    kept = []
    for n in NUMBERS:
        steps = n if grading == 1.0 else graded_mesh(scene.final_time, n, grading)
        run = integrate(scene, method, steps)
        error = float(np.abs(run.position - found.position(run.time)).max())
        if error > ROUND_OFF:
            kept.append((n, error))
    assert len(kept) >= 3
    return fit_slope(*zip(*kept[-4:], strict=True))


@pytest.mark.few(2)
@pytest.mark.parametrize("derivative", ["caputo", "riemann-liouville"])
@pytest.mark.parametrize("place", range(3))
def test_gradings_multiply_the_order_of_a_singular_start(derivative, place):
    chance = drawn(f"gradings {derivative} {place}")
    order = chance.uniform(0.2, 0.8) if place == 0 else chance.uniform(1.2, 1.8)
    is_reduced = order > 1 and derivative == "caputo"
    start = {"x": 1.0} if is_reduced else {"v": 0.5}
    scene = spring((order, 0.7), T=4.0, k=2.0, derivative=derivative, **start)
    least = (4.0 if is_reduced else 3.0) - order
    grading = chance.uniform(1.0, 4.5 / least)
    method = Method(cq="gauss", degree=5)
    stated = grading * least
    assert math.isnan(order_on(scene, method, grading))
    slope = measured(scene, method, grading)
    assert slope == pytest.approx(stated, abs=0.12), (order, grading)
    # the control: the order on equal steps
    assert grading < 1.2 or abs(slope - least) > 0.12


def late_weights(chance: random.Random) -> tuple[float, int, float]:
    """Order of damping, p and a power whose weights do not sum up, at least by a little."""
    order, bdf_order = chance.uniform(0.15, 0.85), chance.choice([2, 3])
    growth = chance.uniform(0.3, 1.2)
    return order, bdf_order, bdf_order + order - 1.0 + growth


@pytest.mark.parametrize("place", range(5))
def test_weights_on_a_single_power_that_is_too_high(place):
    """They spoil what they do not correct, v0 t: h^(1 - sigma + p), which may grow."""
    order, bdf_order, power = late_weights(drawn(f"weights {place}"))
    scene = spring((order, 0.7), T=2.0, k=2.0, v=0.5)
    method = Method(
        cq=f"bdf{bdf_order}",
        degree=(bdf_order + 1) // 2,
        start="weights",
        start_exponents=(round(power, 3),),
    )
    stated = 1.0 - power + bdf_order
    slope = measured(scene, method, 1.0)
    assert slope == pytest.approx(stated, abs=0.1), (order, power)
    # the control: what the exact force of a corrected v0 t would leave
    assert abs(slope - (2.0 - order)) > 0.2


def test_weights_whose_sum_vanishes_cost_one_order_less():
    """Order 1.5 and weights on t^2.5: the derivative of t^2.5 is whole, and t^2 costs h^2.5."""
    scene = spring((1.5, 0.7), T=2.0, k=2.0, x=1.0)
    slopes = []
    for powers in ((2.5,), (3.0,)):
        method = Method(cq="bdf4", degree=2, start="weights", start_exponents=powers)
        slopes.append(measured(scene, method, 1.0))
    assert slopes == pytest.approx([2.5, 1.5], abs=0.15)
    assert not math.isclose(*slopes, abs_tol=0.5)
