r"""Kummer's function :math:`{}_1F_1(a; b; -z)` for z >= 0, many parameters at a time."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_SUMMED: Final = 250.0
"""Arguments up to here may be summed term by term; the first of them is still a normal number."""

CHUNK: Final = 1024
"""Arguments that are summed at a time: their probabilities stay in the cache."""

_NEGLIGIBLE: Final = 1e-18


def kummer_functions(first: Array, second: Array, argument: Array) -> Array:
    r"""Values of :math:`{}_1F_1(a_i; b_i; -z_j)`.

    Kummer's transformation turns the series into a mean over a Poisson distribution,

    .. math:: {}_1F_1(a; b; -z) = e^{-z} {}_1F_1(b - a; b; z)
              = \sum_n \frac{(b-a)_n}{(b)_n} \frac{z^n e^{-z}}{n!},

    whose terms do not cancel for large z (DLMF 13.2.39); the probabilities serve all parameters,
    and the sums are one matrix product. Large arguments are left to the asymptotic series (DLMF
    13.7.2), where its terms fall below round-off.

    Parameters
    ----------
    first, second
        a and b, shape ``(k,)``; b is not 0, -1, -2, ...
    argument
        z >= 0, shape ``(n,)``.

    Returns
    -------
    Array
        Shape ``(k, n)``.
    """
    result = np.empty((first.size, argument.size))
    if result.size == 0:
        return result
    border = _border(first, second)
    near = argument <= border
    places = np.flatnonzero(near)
    for begin in range(0, places.size, CHUNK):
        some = places[begin : begin + CHUNK]
        result[:, some] = _summed(first, second, argument[some])
    if not near.all():
        result[:, ~near] = _asymptotic(first, second, argument[~near], border)
    return result


def _border(first: Array, second: Array) -> float:
    """Least of a few arguments from which all the asymptotic series reach round-off."""
    for border in (40.0, 60.0, 90.0, 140.0):
        if _number_of_terms(first, second, border):
            return border
    return MOST_SUMMED


def _number_of_terms(first: Array, second: Array, argument: float) -> int:
    """Terms of the asymptotic series that count at `argument`; 0 where it does not get there."""
    n = np.arange(int(argument), dtype=float)
    ratios = np.abs((first[:, None] + n) * ((first - second + 1)[:, None] + n))
    ratios /= (n + 1) * argument
    with np.errstate(over="ignore", invalid="ignore"):
        small = np.all(np.multiply.accumulate(ratios, axis=1) < _NEGLIGIBLE, axis=0)
    growing = np.any((ratios > 1) & (n > 2 * first.max() + 2), axis=0)
    if not small.any():
        return 0
    count = int(small.argmax())
    return 0 if growing[:count].any() else count + 1


def _summed(first: Array, second: Array, argument: Array) -> Array:
    largest = float(argument.max())
    # beyond nine deviations from the mean probabilities are below round-off
    count = int(largest + 9.0 * math.sqrt(largest) + 30.0)
    n = np.arange(1, count, dtype=float)
    probabilities = np.empty((count, argument.size))
    probabilities[0] = np.exp(-argument)
    probabilities[1:] = argument / n[:, None]
    np.multiply.accumulate(probabilities, axis=0, out=probabilities)
    ratios = np.ones((first.size, count))
    ratios[:, 1:] = ((second - first)[:, None] + n - 1) / (second[:, None] + n - 1)
    np.multiply.accumulate(ratios, axis=1, out=ratios)
    return np.asarray(ratios @ probabilities)


def _asymptotic(first: Array, second: Array, argument: Array, border: float) -> Array:
    count = _number_of_terms(first, second, border)
    if not count:
        # large parameters at arguments where neither series is of use
        from scipy.special import hyp1f1

        return np.asarray(hyp1f1(first[:, None], second[:, None], -argument))
    n = np.arange(1, count, dtype=float)
    coefficients = np.ones((first.size, count))
    coefficients[:, 1:] = (first[:, None] + n - 1) * ((first - second + 1)[:, None] + n - 1) / n
    np.multiply.accumulate(coefficients, axis=1, out=coefficients)
    powers = np.empty((count, argument.size))
    powers[0] = 1.0
    powers[1:] = 1.0 / argument
    np.multiply.accumulate(powers, axis=0, out=powers)
    scales = np.array(
        [_gamma_ratio(b, b - a) for a, b in zip(first.tolist(), second.tolist(), strict=True)]
    )
    leading = argument ** -first[:, None]
    return np.asarray(scales[:, None] * leading * (coefficients @ powers))


def _gamma_ratio(above: float, below: float) -> float:
    """Gamma(above) / Gamma(below); 0 at the poles of the denominator."""
    if below <= 0 and below == round(below):
        return 0.0
    if max(above, below) < 150.0 and min(above, below) > -150.0:
        return math.gamma(above) / math.gamma(below)
    from scipy.special import gammaln, gammasgn

    sign = float(gammasgn(above) * gammasgn(below))
    return sign * math.exp(float(gammaln(above) - gammaln(below)))
