"""Taylor coefficients of the elementary functions at a point of the real line.

Those of tan and tanh come from their Riccati equation, those of the inverse functions from
integrating a power of a quadratic polynomial by J.C.P. Miller's recurrence (Henrici, *Applied and
Computational Complex Analysis* 1, Wiley 1974, section 1.6).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

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
