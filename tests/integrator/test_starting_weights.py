"""Starting weights: exact on powers, and what they do to the order."""

from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from letters import spring, swing
from oracles.linear_response import match_scene
from scipy.special import gamma as gamma_function
from spread import spread

from fvi_cli.integrator import starting_weights as starting_weights_module
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.starting_weights import starting_weights
from fvi_cli.mathematics.bdf import convolution_weights


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
    powers = tuple(float(power) for power in range(1, bdf_order))
    corrected = Method(cq=f"bdf{bdf_order}", degree=degree, start="weights", start_exponents=powers)
    ladder = (32, 64, 128)
    tolerance = 0.15 if bdf_order < 6 else 0.35  # near round-off
    assert last_order(scene, exact, corrected, ladder) == pytest.approx(bdf_order, abs=tolerance)
    # without them the first steps hold the order at 2
    plain = Method(cq=f"bdf{bdf_order}", degree=degree)
    assert last_order(scene, exact, plain) == pytest.approx(2, abs=0.1)


CROWDED = (1.0, *(round(2.0 + 0.1 * k, 1) for k in range(9)))
"""Powers of a motion with order 1.9, too close to each other."""


def test_the_limit_of_the_condition_keeps_digits():
    """The control: beyond it the errors are above those without weights."""
    scene = swing((1.9, 0.3), T=4.0, x=1.0, v=0.3)
    plain = Method(cq="bdf2", degree=1)
    with patch.object(starting_weights_module, "CONDITION_LIMIT", np.inf):
        ruined = integrate(scene, replace(plain, start="weights", start_exponents=CROWDED), 100)
    exact = integrate(scene, Method(cq="gauss", degree=4, start="graded"), 100).position
    without = integrate(scene, plain, 100).position
    assert np.abs(ruined.position - exact).max() > 10 * np.abs(without - exact).max()
