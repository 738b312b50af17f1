"""Taylor coefficients of the elementary functions, and terms of series with real exponents.

Those of tan and tanh come from their Riccati equation, those of the inverse functions from
integrating a power of a quadratic polynomial by J.C.P. Miller's recurrence (Henrici, *Applied and
Computational Complex Analysis* 1, Wiley 1974, section 1.6).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array

Taylor = Callable[[float, int], list[float]]
"""From a point and a number n to the first n Taylor coefficients of a function there."""


class SeriesError(ValueError):
    """Something that has no expansion in powers of t, or one with too many terms."""


def power_coefficients(value: float, exponent: float, count: int) -> list[float]:
    """Taylor coefficients of x**exponent at `value` > 0."""
    result = [value**exponent]
    for k in range(1, count):
        result.append(result[-1] * (exponent - k + 1) / (k * value))
    return result


def _log(value: float, count: int) -> list[float]:
    if not value > 0:
        raise SeriesError("log at or below 0 has no expansion in powers of t")
    return [math.log(value), *(-((-1 / value) ** k) / k for k in range(1, count))]


def _arcsin(value: float, count: int) -> list[float]:
    first = math.asin(value) if abs(value) < 1 else 0.0
    return _integrated_power(first, [1 - value**2, -2 * value, -1.0], -0.5, count)


def _arccos(value: float, count: int) -> list[float]:
    first, *rest = _arcsin(value, count)
    return [math.pi / 2 - first, *(-one for one in rest)]


def _arccosh(value: float, count: int) -> list[float]:
    first = math.acosh(value) if value > 1 else 0.0
    quadratic = [value**2 - 1 if value > 1 else 0.0, 2 * value, 1.0]
    return _integrated_power(first, quadratic, -0.5, count)


def _arctanh(value: float, count: int) -> list[float]:
    first = math.atanh(value) if abs(value) < 1 else 0.0
    return _integrated_power(first, [1 - value**2, -2 * value, -1.0], -1.0, count)


def _overflowing(function: Callable[[float], float], value: float) -> float:
    try:
        return function(value)
    except OverflowError:
        return math.inf


def _riccati(first: float, sign: float, count: int) -> list[float]:
    """Solve y' = 1 + sign y**2 from y(0) = first: tan for 1, tanh for -1."""
    result = [first]
    for k in range(count - 1):
        square = sum(result[i] * result[k - i] for i in range(k + 1))
        result.append(((k == 0) + sign * square) / (k + 1))
    return result


def _integrated_power(
    first: float, quadratic: list[float], power: float, count: int
) -> list[float]:
    """Integrate (q0 + q1 u + q2 u**2)**power from the value `first` at u = 0.

    The power of the polynomial comes from J.C.P. Miller's recurrence.
    """
    q0, q1, q2 = quadratic
    if not q0 > 0:
        raise SeriesError("an inverse function at the edge of its domain has no such expansion")
    derivative = [q0**power]
    for k in range(1, count - 1):
        total = (power * 1 - (k - 1)) * q1 * derivative[k - 1]
        if k >= 2:
            total += (power * 2 - (k - 2)) * q2 * derivative[k - 2]
        derivative.append(total / (k * q0))
    return [first, *(d / (k + 1) for k, d in enumerate(derivative[: count - 1]))]


def _cycle(*functions: Callable[[float], float]) -> Taylor:
    """A function whose derivatives come round: the first of these, its derivative, and so on."""

    def coefficients(value: float, count: int) -> list[float]:
        sizes = [_overflowing(one, value) for one in functions]
        return [sizes[k % len(sizes)] / math.factorial(min(k, 170)) for k in range(count)]

    return coefficients


_exp = _cycle(math.exp)

TAYLOR: Final[Mapping[str, Taylor]] = MappingProxyType(
    {
        "exp": _exp,
        "expm1": lambda x, n: [_overflowing(math.expm1, x), *_exp(x, n)[1:]],
        "sin": _cycle(math.sin, math.cos, lambda x: -math.sin(x), lambda x: -math.cos(x)),
        "cos": _cycle(math.cos, lambda x: -math.sin(x), lambda x: -math.cos(x), math.sin),
        "sinh": _cycle(math.sinh, math.cosh),
        "cosh": _cycle(math.cosh, math.sinh),
        "tan": lambda x, n: _riccati(math.tan(x), 1.0, n),
        "tanh": lambda x, n: _riccati(math.tanh(x), -1.0, n),
        "log": _log,
        "arctan": lambda x, n: _integrated_power(math.atan(x), [1 + x**2, 2 * x, 1.0], -1.0, n),
        "arcsin": _arcsin,
        "arccos": _arccos,
        "arcsinh": lambda x, n: _integrated_power(math.asinh(x), [1 + x**2, 2 * x, 1.0], -0.5, n),
        "arccosh": _arccosh,
        "arctanh": _arctanh,
    }
)
"""The first n Taylor coefficients of functions at x."""


SAME_EXPONENT: Final = 1e-9
MOST_TERMS: Final = 512
CANCELLED: Final = 16.0 * float(np.finfo(float).eps)
"""Sums below, relative to their own terms, count as 0."""


def merged_terms(exponents: Array, coefficients: Array, cutoff: float) -> tuple[Array, Array]:
    r"""Sort terms, add up those of one exponent, drop zeros and all from the cutoff on.

    Exponents ``(n,)`` in any order, with repetitions, and coefficients ``(n, ...)``; those from the
    cutoff on, less 1e-9, are dropped. A sum below 16 units of round-off of its own terms counts as
    0.

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
    # most sums are of series that are in order already: there is nothing to add up
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
