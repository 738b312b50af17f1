"""Terms of series with real exponents: merging and cutting off terms, and the power rule."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array

SAME_EXPONENT: Final = 1e-9  # exponents closer than this are equal
MOST_TERMS: Final = 512  # of a series
CANCELLED: Final = 16.0 * float(np.finfo(float).eps)
"""A sum counts as 0 below this share of the sum of the absolute values of its terms."""


class SeriesError(ValueError):
    """Something that has no expansion in powers of t, or one with too many terms."""


def merged_terms(exponents: Array, coefficients: Array, cutoff: float) -> tuple[Array, Array]:
    r"""Sort terms, add up terms of equal exponent, drop zeros and terms from the cutoff on.

    Exponents ``(n,)`` in any order, with repetitions, and coefficients ``(n, ...)``. Terms with an
    exponent of at least the cutoff less 1e-9 are dropped. A sum below 16 units of round-off of its
    own terms counts as 0.

    Raises
    ------
    SeriesError
        If a coefficient is not finite, or more than 512 terms remain.
    """
    exponents = np.array(exponents, dtype=float)
    coefficients = np.array(coefficients, dtype=float)
    kept = exponents < cutoff - SAME_EXPONENT
    if not kept.all():
        exponents, coefficients = exponents[kept], coefficients[kept]
    if not np.isfinite(coefficients).all():
        raise SeriesError("a coefficient is not finite; no expansion in powers of t was found")
    if exponents.size == 0:
        return exponents, coefficients
    # most often all exponents are different and in order already
    if not (exponents[1:] - exponents[:-1] > SAME_EXPONENT).all():
        order = exponents.argsort(kind="stable")
        exponents, coefficients = exponents[order], coefficients[order]
        steps = exponents[1:] - exponents[:-1]
        starts = np.concatenate(([0], (steps > SAME_EXPONENT).nonzero()[0] + 1))
        exponents = exponents[starts]
        sizes = np.add.reduceat(np.abs(coefficients), starts, axis=0)
        coefficients = np.add.reduceat(coefficients, starts, axis=0)
        coefficients[np.abs(coefficients) <= CANCELLED * sizes] = 0.0
    whole = np.rint(exponents)
    near = np.abs(exponents - whole) <= SAME_EXPONENT
    exponents[near] = whole[near]
    present = coefficients != 0
    if present.ndim > 1:
        present = present.reshape(exponents.size, -1).any(axis=1)
    if np.count_nonzero(present) > MOST_TERMS:
        raise SeriesError(f"more than {MOST_TERMS} exponents below {cutoff:g}")
    if present.all():
        return exponents, coefficients
    return exponents[present], coefficients[present]


def power_rule(exponents: Array, order: float) -> Array:
    r"""The factors :math:`\Gamma(\sigma+1)/\Gamma(\sigma+1-\gamma)`, for :math:`\sigma > -1`."""
    return np.array([gamma_ratio(float(sigma) + 1.0, order) for sigma in exponents])


def gamma_ratio(argument: float, order: float) -> float:
    r"""The quotient :math:`\Gamma(x) / \Gamma(x - \gamma)` for x > 0; 0 at its zeros."""
    below = argument - order
    if below <= 0 and abs(below - round(below)) <= SAME_EXPONENT:
        return 0.0
    if max(argument, below) < 150.0:
        return math.gamma(argument) / math.gamma(below)
    return math.exp(math.lgamma(argument) - math.lgamma(below))


def initial_terms(exponents: Array, order: float) -> NDArray[np.bool_]:
    """Which exponents are the integers 0, 1, ... below `order`."""
    below = (exponents >= 0) & (exponents < order)
    return np.asarray(below & (exponents == np.round(exponents)))


def power_coefficients(exponent: float, count: int) -> list[float]:
    """Taylor coefficients of x**exponent at 1."""
    result = [1.0]
    for k in range(1, count):
        result.append(result[-1] * (exponent - k + 1) / k)
    return result
