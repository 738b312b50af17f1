"""Generating polynomials and convolution-quadrature weights."""

import math
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
from numpy.typing import NDArray
from spread import spread

from fvi_cli.mathematics.bdf import (
    convolution_weights,
    difference_weights,
    quotient_polynomial,
    symbol_at,
)

Array = NDArray[np.float64]
BDF_ORDERS = range(1, 7)
ORDERS = (0.3, 0.5, 1.0, 1.5, 1.9)
WEIGHTS = {"convolution": convolution_weights, "difference": difference_weights}
BITS = 400


def exact_polynomial(bdf_order: int) -> list[Fraction]:
    """gamma_p from its definition, expanded by hand."""
    result = [Fraction(0)] * (bdf_order + 1)
    for k in range(1, bdf_order + 1):
        for m in range(k + 1):
            result[m] += Fraction((-1) ** m * math.comb(k, m), k)
    return result


def fixed_point_power(polynomial: list[Fraction], order: float, n_terms: int) -> list[int]:
    """Coefficients of a power of a polynomial times 2**400, by Miller's recurrence in integers.

    Applied to gamma_p as a whole, not to its factors as the library does.
    """
    scale = math.lcm(*(c.denominator for c in polynomial))
    whole = [int(c * scale) for c in polynomial]
    top, bottom = Fraction(order).as_integer_ratio()
    with mp.workprec(BITS + 60):
        first = (mp.mpf(whole[0]) / scale) ** (mp.mpf(top) / bottom)
        series = [int(mp.floor(mp.ldexp(first, BITS)))]
    for n in range(1, n_terms):
        total = 0
        for k in range(1, min(n, len(whole) - 1) + 1):
            total += (k * top - (n - k) * bottom) * whole[k] * series[n - k]
        series.append(total // (n * whole[0] * bottom))
    return series


def reference(kind: str, bdf_order: int, order: float, n_terms: int) -> list[int]:
    series = fixed_point_power(exact_polynomial(bdf_order), order, n_terms)
    if kind == "difference":
        for n in range(1, n_terms):
            series[n] += series[n - 1]
    return series


def budget_used(weights: Array, exact: list[int]) -> float:
    """Largest error in units of 1e-13 |w_n| + 1e-15 max |w|."""
    rounded = np.array([float(Fraction(w, 1 << BITS)) for w in exact])
    residual = [
        float(Fraction((Fraction(float(w)) * (1 << BITS)) - e) / (1 << BITS))
        for w, e in zip(weights, exact, strict=True)
    ]
    allowed = 1e-13 * np.abs(rounded) + 1e-15 * np.abs(rounded).max()
    return float((np.abs(residual) / allowed).max())


@pytest.mark.parametrize("bdf_order", BDF_ORDERS)
def test_quotient_polynomial_is_its_definition_rounded_once(bdf_order):
    exact = exact_polynomial(bdf_order)
    quotient = [sum(exact[: m + 1], start=Fraction(0)) for m in range(bdf_order)]
    assert quotient_polynomial(bdf_order).tolist() == [float(c) for c in quotient]


@pytest.mark.parametrize("bdf_order", BDF_ORDERS)
def test_symbol_is_the_polynomial(bdf_order):
    z = 0.9 * np.exp(1j * np.linspace(0, 6, 17))
    by_powers = np.polynomial.polynomial.polyval(z, [float(c) for c in exact_polynomial(bdf_order)])
    np.testing.assert_allclose(symbol_at(bdf_order, z), by_powers, rtol=0, atol=2e-14)
    at_minus_one = [2, 4, 20 / 3, 32 / 3, 256 / 15, 416 / 15][bdf_order - 1]
    assert symbol_at(bdf_order, -1) == pytest.approx(at_minus_one, rel=1e-15)
    # Near 1 the value keeps its relative accuracy, as powers of z do not.
    assert symbol_at(bdf_order, 1 - 2.0**-40).real == pytest.approx(2.0**-40, rel=1e-11)


def rounding(bdf_order: int, order: float) -> float:
    """Bound of the relative error of a weight: the terms of its sum cancel each other."""
    quotient = [Fraction(c).limit_denominator(100) for c in quotient_polynomial(bdf_order)]
    short = np.array(
        [float(Fraction(u, 1 << BITS)) for u in fixed_point_power(quotient, order, 700)]
    )
    return 1e-15 + 5e-16 * float(np.abs(short).sum() / abs(short.sum()))


@pytest.mark.few(5)
@spread(
    bdf_order=BDF_ORDERS,
    order=[*ORDERS, -1.7, -1.0, -0.5, 0.01, 1.99, 1 + 1e-9],
    kind=sorted(WEIGHTS),
)
def test_weights_against_integer_arithmetic(kind, bdf_order, order):
    exact = reference(kind, bdf_order, order, 4096)
    weights = WEIGHTS[kind](bdf_order, order, 4096)
    assert budget_used(weights, exact) < 0.1
    if order in ORDERS and order != 1:
        tail = np.array([float(Fraction(w, 1 << BITS)) for w in exact[1024:]])
        np.testing.assert_allclose(weights[1024:], tail, rtol=rounding(bdf_order, order))


@pytest.mark.parametrize("kind", sorted(WEIGHTS))
def test_the_comparison_notices_a_small_error(kind):
    """Control: a change of order by 1e-12, or of one weight by 2e-13 of itself, is refused."""
    exact = reference(kind, 3, 0.5, 4096)
    assert budget_used(WEIGHTS[kind](3, 0.5 + 1e-12, 4096), exact) > 1
    spoilt = WEIGHTS[kind](3, 0.5, 4096)
    spoilt[1] *= 1 + 2e-13
    assert budget_used(spoilt, exact) > 1


@pytest.mark.parametrize("bdf_order", BDF_ORDERS)
def test_integer_orders_are_exact_stencils(bdf_order):
    first = exact_polynomial(bdf_order)
    second = [Fraction(0)] * (2 * bdf_order + 1)
    for i, a in enumerate(first):
        for j, b in enumerate(first):
            second[i + j] += a * b
    for order, stencil in ((0, [Fraction(1)]), (1, first), (2, second)):
        weights = convolution_weights(bdf_order, order, 3000)
        assert weights[: len(stencil)].tolist() == [float(c) for c in stencil]
        assert not weights[len(stencil) :].any()
        sums = np.cumsum(np.array(stencil, dtype=object))
        increments = difference_weights(bdf_order, order, 3000)
        assert increments[: len(stencil)].tolist() == [float(c) for c in sums]
        assert np.all(increments[len(stencil) :] == (1 if order == 0 else 0))
    assert convolution_weights(bdf_order, 2, 3).shape == (3,)


@spread(few=2, bdf_order=[1, 2, 4, 6], order=[0.3, 1.5, 1.9, -0.5], kind=sorted(WEIGHTS))
def test_no_drift_at_a_million_weights(kind, order, bdf_order):
    """The sum over q_p**order times gamma-function ratios, in 50 digits."""
    shift = 1 if kind == "difference" else 0
    weights = WEIGHTS[kind](bdf_order, order, 2**20)
    quotient = [Fraction(c).limit_denominator(100) for c in quotient_polynomial(bdf_order)]
    short = fixed_point_power(quotient, order, 1000)
    with mp.workdps(50):
        exponent = mp.mpf(order) - shift
        for n in (1024, 5000, 2**17, 2**20 - 1):
            binomial = mp.gammaprod([n - exponent], [-exponent, n + 1])
            total = mp.mpf(0)
            for j, u in enumerate(short):
                total += u * binomial
                binomial *= (n - j) / (n - j - 1 - exponent)
            exact = mp.ldexp(total, -BITS)
            assert abs(weights[n] / exact - 1) < rounding(bdf_order, order)
