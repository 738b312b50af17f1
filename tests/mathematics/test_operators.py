"""Discrete fractional operators on a grid."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from spread import spread

from fvi_cli.mathematics.bdf import convolution_weights, left_operator

Array = NDArray[np.float64]
BDF_ORDERS = range(1, 7)
STEP = 0.125


def random_sequence(n: int, *shape: int) -> Array:
    return np.random.default_rng(n).standard_normal((n, *shape))


def right_operator(bdf_order: int, exponent: float, step_size: float, values: Array) -> Array:
    """The advanced operator: the retarded one with time reversed."""
    return left_operator(bdf_order, exponent, step_size, values[::-1])[::-1]


def semigroup_defect(bdf_order: int, a: float, b: float, total: float, n: int) -> float:
    """Largest difference of J^a J^b and J^total, relative to what the weights can amplify."""
    defect = 0.0
    for operator in (left_operator, right_operator):
        values = random_sequence(n)
        twice = operator(bdf_order, a, STEP, operator(bdf_order, b, STEP, values))
        once = operator(bdf_order, total, STEP, values)
        bound = (
            STEP**-total
            * np.abs(convolution_weights(bdf_order, a, n)).sum()
            * np.abs(convolution_weights(bdf_order, b, n)).sum()
        )
        defect = max(defect, float(np.abs(twice - once).max() / bound))
    return defect


SEMIGROUP_PAIRS = [(0.25, 0.25), (0.75, 0.75), (0.3, 1.2), (1.5, -1.5), (-0.4, -0.6), (1.9, -0.9)]


@spread(**{"a, b": SEMIGROUP_PAIRS}, n=[200, 2000], bdf_order=BDF_ORDERS)
def test_semigroup_to_round_off(bdf_order, n, a, b):
    assert semigroup_defect(bdf_order, a, b, a + b, n) < 1e-14


@pytest.mark.parametrize("bdf_order", BDF_ORDERS)
def test_semigroup_needs_the_sum_of_the_exponents(bdf_order):
    """Control: a total order that is wrong by 1e-9 is seen."""
    assert semigroup_defect(bdf_order, 0.25, 0.25, 0.5 + 1e-9, 200) > 1e-12


@spread(exponent=[-0.5, 0.25, 0.75, 1.0, 1.5], n=[200, 2000], bdf_order=BDF_ORDERS)
def test_asymmetric_integration_by_parts(bdf_order, n, exponent):
    x, y = random_sequence(n), random_sequence(n + 1)[:n]
    left = left_operator(bdf_order, exponent, STEP, x)
    right = right_operator(bdf_order, exponent, STEP, y)
    scale = np.abs(left) @ np.abs(y) + np.abs(x) @ np.abs(right)
    assert abs(left @ y - x @ right) < 1e-14 * scale
    # Control: with the retarded operator on both sides it does not hold.
    wrong = left_operator(bdf_order, exponent, STEP, y)
    assert abs(left @ y - x @ wrong) > 1e-5 * scale


LADDER = 2 ** np.arange(5, 12)


def power_orders(bdf_order: int, order: float, beta: float, order_used: float) -> list[float]:
    """Orders of D^order t^beta on [0, 1] at t = 1 and in the maximum norm over the grid."""
    errors = np.empty((LADDER.size, 2))
    for row, n_steps in enumerate(LADDER):
        t = np.arange(n_steps + 1) / n_steps
        exact = np.zeros_like(t)
        factor = math.gamma(beta + 1) / math.gamma(beta + 1 - order)
        exact[1:] = factor * t[1:] ** (beta - order)
        error = np.abs(left_operator(bdf_order, order_used, 1 / n_steps, t**beta) - exact)
        errors[row] = error[-1], error.max()
    slopes = []
    for column in errors.T:
        above = column > 300 * np.finfo(float).eps * LADDER**order
        assert above.sum() >= 4
        slopes.append(float(-np.polyfit(np.log(LADDER[above]), np.log(column[above]), 1)[0]))
    return slopes


@pytest.mark.parametrize(
    ("bdf_order", "order", "beta"),
    [
        # Exponents well apart from each other and coefficients zeta(-beta) that are not small, so
        # that no mixture of two orders shows on this ladder.
        (1, 0.5, 2.7), (2, 0.5, 3.7), (3, 0.5, 1.2), (4, 0.5, 1.2), (5, 0.5, 1.2), (6, 0.5, 1.2),
        (3, 0.3, 0.9), (4, 0.3, 5.6), (6, 0.3, 0.9), (1, 1.5, 3.7), (2, 1.5, 4.7), (3, 1.5, 5.2),
        (5, 1.5, 1.7),
    ],
)  # fmt: skip
def test_order_on_powers_depends_on_the_norm(bdf_order, order, beta):
    """Lubich 1986: h^p + h^(beta+1) at fixed t, h^(beta-order) at the first grid points."""
    at_one, in_maximum = power_orders(bdf_order, order, beta, order)
    assert at_one == pytest.approx(min(bdf_order, beta + 1), abs=0.1)
    assert in_maximum == pytest.approx(min(bdf_order, beta - order), abs=0.1)


def test_order_is_lost_with_a_wrong_exponent():
    """Control for the test above."""
    at_one, in_maximum = power_orders(2, 0.5, 3.7, 0.5 + 1e-3)
    assert abs(at_one - 2) > 0.5
    assert abs(in_maximum - 2) > 0.5
