"""Starting weights: exact on powers, and what they do to the order."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from letters import spring, swing
from scipy.special import gamma as gamma_function
from spread import spread

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.starts import starting_weights as starting_weights_module
from fvi_cli.integrator.starts.starting_weights import starting_weights
from fvi_cli.mathematics.bdf import convolution_weights
from fvi_cli.scenes.linear_response import match_scene


@spread(offset=[0.0, 0.21], order=[0.5, 1.0, 1.5], bdf_order=[1, 3, 6])
def test_the_corrected_quadrature_is_exact_on_the_powers(bdf_order, order, offset):
    exponents = (2.0, 2.5, 3.0)
    n = 200
    weights, condition = starting_weights(bdf_order, order, exponents, n, offset=offset)
    first = 1 if offset == 0 else 0
    times = offset + np.arange(n)
    for exponent in exponents:
        plain = np.convolve(convolution_weights(bdf_order, order, n), times**exponent)[:n]
        corrected = plain + weights @ times[first : first + 3] ** exponent
        exact = gamma_function(exponent + 1) / gamma_function(exponent + 1 - order)
        exact = exact * times ** (exponent - order)
        scale = 1e-11 * n**exponent
        assert np.abs(corrected - exact)[1:].max() < scale
        assert np.abs(plain - exact)[1:].max() > 10 * scale or bdf_order > 3
    assert condition > 1
    # the control: a power that is not among them is not integrated exactly
    other = np.convolve(convolution_weights(bdf_order, order, n), times**1.5)[:n]
    other = other + weights @ times[first : first + 3] ** 1.5
    exact = gamma_function(2.5) / gamma_function(2.5 - order) * times[5] ** (1.5 - order)
    assert abs(other[5] - exact) > 1e-6


def oscillator(order: float, v0: float = 1.0, x0: float = 0.0):
    scene = spring((order, 0.4), T=8.0, x=x0, v=v0)
    solution = match_scene(scene)
    return scene, solution.position


def last_order(scene, exact, method: Method, ladder=(64, 128, 256)) -> float:
    values = []
    for n_steps in ladder:
        trajectory = integrate(scene, method, n_steps)
        values.append(np.abs(trajectory.position - exact(trajectory.time)).max())
    return float(np.log2(values[-2] / values[-1]))


@pytest.mark.parametrize("bdf_order", [3, 4, 5, 6])
def test_classical_damping_at_the_points_reaches_order_p(bdf_order):
    scene, exact = oscillator(1.0)
    degree = (bdf_order + 1) // 2
    corrected = Method(cq=f"bdf{bdf_order}", degree=degree, start="weights")
    ladder = (32, 64, 128)
    tolerance = 0.15 if bdf_order < 6 else 0.35  # near round-off
    assert last_order(scene, exact, corrected, ladder) == pytest.approx(bdf_order, abs=tolerance)
    # without them the first steps hold the order at 2
    plain = Method(cq=f"bdf{bdf_order}", degree=degree)
    assert last_order(scene, exact, plain) == pytest.approx(2, abs=0.1)


def test_an_exact_singular_force_is_seen_wrong_by_the_points():
    """Order 1.5 with weights, 2.5 without: plain quadrature hides what exact values show."""
    scene, exact = oscillator(0.5)
    ladder = (256, 512, 1024)
    corrected = Method(cq="bdf4", degree=2, start="weights")
    plain = Method(cq="bdf4", degree=2)
    assert last_order(scene, exact, corrected, ladder) == pytest.approx(1.5, abs=0.1)
    assert last_order(scene, exact, plain, ladder) == pytest.approx(2.5, abs=0.1)


def test_ill_conditioned_weights_are_reported():
    scene, _ = oscillator(0.5, x0=1.0)
    good = integrate(scene, Method(cq="bdf2", degree=1, start="weights"), 64)
    bad = integrate(scene, Method(cq="bdf6", degree=3, start="weights"), 64)
    assert "ill conditioned" not in good.remarks[0]
    assert "ill conditioned" in bad.remarks[0]


def test_weights_are_left_out_where_there_are_too_few_steps():
    scene, _ = oscillator(0.5)
    trajectory = integrate(scene, Method(cq="bdf6", degree=3, start="weights"), 4)
    assert "too few" in trajectory.remarks[0]


@spread(few=3, order=[0.4, 1.5, 1.7, 1.8, 1.9, 1.95, 1.99], bdf_order=[2, 3])
def test_weights_never_cost_the_first_digit(order, bdf_order):
    """Near order 2 the powers are too close to each other: they are left out, which is said."""
    scene = swing((order, 0.3), T=4.0, x=1.0, v=0.3)
    degree = (bdf_order + 1) // 2
    method = Method(cq=f"bdf{bdf_order}", degree=degree, start="weights")
    exact = integrate(scene, Method(cq="gauss", degree=4, start="graded"), 100).position
    found = integrate(scene, method, 100)
    assert np.abs(found.position - exact).max() < 2e-2
    plain = replace(method, start="none")
    if "left out" in found.remarks[0]:
        assert "condition" in found.remarks[0]
        assert np.array_equal(found.position, integrate(scene, plain, 100).position)
    else:
        assert order < 1.9


def test_without_the_limit_the_weights_ruin_the_motion():
    scene = swing((1.9, 0.3), T=4.0, x=1.0, v=0.3)
    method = Method(cq="bdf2", degree=1, start="weights")
    with patch.object(starting_weights_module, "CONDITION_LIMIT", np.inf):
        ruined = integrate(scene, method, 100)
    assert np.abs(ruined.position).max() > 10
