"""Backward difference formulas: generating polynomials and convolution-quadrature weights.

The symbol of the formula of order p is ``gamma_p(z) = sum_{k=1..p} (1-z)^k / k``, and the weights
of convolution quadrature are the power series coefficients of ``gamma_p(z)**order`` (Lubich,
*Discretized fractional calculus*, SIAM J. Math. Anal. 17, 1986, section 2).
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import comb
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.mathematics.arrays import Array, ComplexArray

# From this index on the binomial coefficients come from their asymptotic series: n - 1 - e rounds
# the same way for many n, and a running product drifts, to 3e-11 at n = 2**20 for e = 1.9.
_BINOMIAL_TAIL_START = 24
_BINOMIAL_TAIL_TERMS = 10  # of that series
# Coefficients of q_p**order decay geometrically and are cut where they are this small.
_NEGLIGIBLE = 1e-40


def quotient_polynomial(bdf_order: int) -> Array:
    """The coefficients of ``q_p(z) = gamma_p(z) / (1-z)`` in powers of z, shape ``(p,)``.

    Exact rationals, rounded once.
    """
    return _quotient(bdf_order).astype(float)


def symbol_at(bdf_order: int, z: ComplexArray) -> ComplexArray:
    """``gamma_p(z)`` at complex numbers of any shape, accurately near z = 1 as well."""
    difference = 1.0 - np.asarray(z, dtype=np.complex128)
    value: ComplexArray = np.zeros_like(difference)
    for k in range(bdf_order, 0, -1):
        value = (value + 1.0 / k) * difference
    return value


def convolution_weights(bdf_order: int, order: float, n_weights: int) -> Array:
    """The first N coefficients of ``gamma_p(z)**order`` in powers of z, shape ``(N,)``.

    With step size h, ``h**-order * sum_{n=0..k} w_n f_{k-n}`` approximates the derivative of
    that order at ``t_k`` (the integral, for negative order). Orders lie in (-2, 2]; for 0, 1 and 2
    the weights are finite stencils: exact rationals, rounded once, then zeros. Small weights of
    the tail have a small relative error as well.

    Notes
    -----
    ``gamma_p(z)**e = (1-z)**e q_p(z)**e``: the convolution of the binomial series with the power
    of ``q_p`` (J.C.P. Miller's recurrence, Henrici, *Applied and Computational Complex Analysis* 1,
    section 1.6), which is short: the zeros of ``q_p`` are at abs(z) >= 1.158 (p = 6).
    """
    exact = Fraction(order)
    return _power_weights(bdf_order, exact, exact, n_weights)


def difference_weights(bdf_order: int, order: float, n_weights: int) -> Array:
    """The first N coefficients of ``gamma_p(z)**order / (1-z)`` in powers of z, shape ``(N,)``.

    They act on increments: ``sum_n w_n f_{k-n} = sum_n v_n (f_{k-n} - f_{k-n-1})`` with
    ``f_{-1} = 0``, w the convolution weights and v these. They are computed from the binomial
    series of ``(1-z)**(order-1)``; running sums of w would lose the tail. Range and errors: those
    of :func:`convolution_weights`.
    """
    exact = Fraction(order)
    return _power_weights(bdf_order, exact - 1, exact, n_weights)


def left_operator(bdf_order: int, exponent: float, step_size: float, values: ArrayLike) -> Array:
    """The retarded operator, which acts on the past, of values ``(N + 1,)`` or ``(N + 1, d)``.

    ``(J_- X)_k = h**-e sum_{n=0..k} w_n X_{k-n}``: for e in (0, 2] the left Riemann-Liouville
    derivative of order e at ``t_k = k h``, for e in (-2, 0) the integral of order -e. Operators of
    one formula and one step obey ``J^a J^b = J^(a+b)`` exactly, as their symbols are powers of one
    series (Lubich 1986; Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv 2403.18362).
    """
    from scipy.linalg import matmul_toeplitz

    samples = np.asarray(values, dtype=np.float64)
    weights = convolution_weights(bdf_order, exponent, samples.shape[0])
    above = np.zeros_like(weights)
    return np.asarray(step_size**-exponent * matmul_toeplitz((weights, above), samples))


def _quotient(bdf_order: int) -> NDArray[np.object_]:
    """Exact coefficients of q_p(z) = sum_{k=1..p} (1-z)^(k-1) / k."""
    quotient = np.zeros(bdf_order, dtype=object)
    for k in range(1, bdf_order + 1):
        quotient[:k] += [Fraction((-1) ** m * comb(k - 1, m), k) for m in range(k)]
    return quotient


def _power_weights(
    bdf_order: int, binomial_exponent: Fraction, quotient_exponent: Fraction, n_weights: int
) -> Array:
    """Coefficients of ``(1-z)**binomial_exponent * q_p(z)**quotient_exponent``."""
    if binomial_exponent >= 0 and binomial_exponent.denominator == 1:
        # exact: NumPy computes with arrays of fractions by the operators of the fractions
        stencil = np.array([Fraction(1)])
        for _ in range(int(quotient_exponent)):
            stencil = np.convolve(stencil, _quotient(bdf_order))
        for _ in range(int(binomial_exponent)):
            stencil = np.convolve(stencil, np.array([Fraction(1), Fraction(-1)]))
        weights = np.zeros(n_weights)
        n_stencil = min(stencil.size, n_weights)
        weights[:n_stencil] = stencil[:n_stencil].astype(float)
        return weights
    binomial = _binomial_series(binomial_exponent, n_weights)
    if bdf_order == 1 or quotient_exponent == 0:
        return binomial
    quotient, exponent = quotient_polynomial(bdf_order).tolist(), float(quotient_exponent)
    short = _power_series(quotient, exponent, quotient[0] ** exponent, n_weights)
    return np.convolve(binomial, short)[:n_weights]


def _power_series(coefficients: list[Any], exponent: Any, first: Any, n_terms: int) -> list[Any]:
    """Power of a polynomial by J.C.P. Miller's recurrence, cut where it is negligible.

    `first` is the first coefficient of the polynomial to this exponent; all numbers have one type.
    """
    series, largest, reach = [first], abs(first), len(coefficients) - 1
    for n in range(1, n_terms):
        terms = (
            (k * exponent - (n - k)) * coefficients[k] * series[n - k]
            for k in range(1, min(n, reach) + 1)
        )
        series.append(sum(terms) / (n * coefficients[0]))
        largest = max(largest, abs(series[n]))
        # As many negligible terms in a row as the recurrence looks back: all others are, too.
        if n >= reach and max(map(abs, series[-reach:])) < _NEGLIGIBLE * largest:
            break
    return series


def _binomial_series(exponent: Fraction, n_terms: int) -> Array:
    """Coefficients of ``(1-z)**exponent``, each with relative accuracy.

    The first ones are exact, rounded once. Beyond, with m = n - e/2,
    ``Gamma(n-e) / Gamma(n+1) ~ m^(-e-1) sum_k c_k m^(-2k)``,
    ``c_k = (-e-1)(-e-2)..(-e-2k) [t^(2k)] (2 sinh(t/2) / t)^e`` (Tricomi and Erdelyi 1951; the
    form in even powers by Fields 1966; NIST Handbook, 5.11.14), scaled to meet the exact ones.
    """
    start = _BINOMIAL_TAIL_START
    exact = [Fraction(1)]
    for n in range(1, start + 1):
        exact.append(exact[-1] * (n - 1 - exponent) / n)
    head = np.array([float(c) for c in exact])
    if n_terms <= start:
        return head[:n_terms].copy()
    coefficients = _gamma_ratio_coefficients(exponent)
    centred = np.arange(start, n_terms, dtype=np.float64) - float(exponent) / 2
    inverse_square = 1.0 / centred**2
    tail = np.full_like(centred, coefficients[-1])
    for c in coefficients[-2::-1]:
        tail *= inverse_square
        tail += c
    tail *= centred ** float(-exponent - 1)
    tail *= head[start] / tail[0]
    return np.concatenate([head[:start], tail])


@lru_cache(maxsize=128)
def _gamma_ratio_coefficients(exponent: Fraction) -> tuple[float, ...]:
    """Coefficients c_k of :func:`_binomial_series`, exact, rounded once."""
    # 2 sinh(t/2) / t = sum_j x^j / (4^j (2j+1)!) with x = t^2.
    sinh = [Fraction(1)]
    for j in range(1, _BINOMIAL_TAIL_TERMS):
        sinh.append(sinh[-1] / (4 * 2 * j * (2 * j + 1)))
    power = _power_series(sinh, exponent, Fraction(1), _BINOMIAL_TAIL_TERMS)
    falling = Fraction(1)
    coefficients = [1.0]
    for k in range(1, _BINOMIAL_TAIL_TERMS):
        falling *= (-exponent - 2 * k + 1) * (-exponent - 2 * k)
        coefficients.append(float(falling * power[k]))
    return tuple(coefficients)
