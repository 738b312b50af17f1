"""Taylor coefficients of the elementary functions at a point of the real line.

Every public function takes a point and a number n and returns the first n Taylor coefficients
there. Those of tan and tanh come from their Riccati equation, those of the inverse functions from
integrating a power of a quadratic polynomial by J.C.P. Miller's recurrence (Henrici, *Applied and
Computational Complex Analysis* 1, Wiley 1974, section 1.6).
"""

from __future__ import annotations

import math
from collections.abc import Callable


class SeriesError(ValueError):
    """Something that has no expansion in powers of t, or one with too many terms."""


def power(value: float, exponent: float, count: int) -> list[float]:
    """Taylor coefficients of x**exponent at `value` > 0."""
    result = [value**exponent]
    for k in range(1, count):
        result.append(result[-1] * (exponent - k + 1) / (k * value))
    return result


def exp(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of exp at `value`."""
    return _divided_by_factorials([_overflowing(math.exp, value)], count)


def expm1(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of expm1 at `value`."""
    return [_overflowing(math.expm1, value), *exp(value, count)[1:]]


def sin(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of sin at `value`."""
    s, c = math.sin(value), math.cos(value)
    return _divided_by_factorials([s, c, -s, -c], count)


def cos(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of cos at `value`."""
    s, c = math.sin(value), math.cos(value)
    return _divided_by_factorials([c, -s, -c, s], count)


def sinh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of sinh at `value`."""
    s, c = _overflowing(math.sinh, value), _overflowing(math.cosh, value)
    return _divided_by_factorials([s, c], count)


def cosh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of cosh at `value`."""
    s, c = _overflowing(math.sinh, value), _overflowing(math.cosh, value)
    return _divided_by_factorials([c, s], count)


def tan(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of tan at `value`."""
    return _riccati(math.tan(value), 1.0, count)


def tanh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of tanh at `value`."""
    return _riccati(math.tanh(value), -1.0, count)


def log(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of log at `value`."""
    if not value > 0:
        raise SeriesError("log at or below 0 has no expansion in powers of t")
    return [math.log(value), *(-((-1 / value) ** k) / k for k in range(1, count))]


def arctan(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arctan at `value`."""
    return _integrated_power(math.atan(value), [1 + value**2, 2 * value, 1.0], -1.0, count)


def arcsin(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arcsin at `value`."""
    quadratic = [1 - value**2, -2 * value, -1.0]
    first = math.asin(value) if abs(value) < 1 else 0.0
    return _integrated_power(first, quadratic, -0.5, count)


def arccos(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arccos at `value`."""
    first, *rest = arcsin(value, count)
    return [math.pi / 2 - first, *(-r for r in rest)]


def arcsinh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arcsinh at `value`."""
    quadratic = [1 + value**2, 2 * value, 1.0]
    return _integrated_power(math.asinh(value), quadratic, -0.5, count)


def arccosh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arccosh at `value`."""
    first = math.acosh(value) if value > 1 else 0.0
    quadratic = [value**2 - 1 if value > 1 else 0.0, 2 * value, 1.0]
    return _integrated_power(first, quadratic, -0.5, count)


def arctanh(value: float, count: int) -> list[float]:
    """First `count` Taylor coefficients of arctanh at `value`."""
    first = math.atanh(value) if abs(value) < 1 else 0.0
    return _integrated_power(first, [1 - value**2, -2 * value, -1.0], -1.0, count)


def _divided_by_factorials(cycle: list[float], count: int) -> list[float]:
    return [cycle[k % len(cycle)] / math.factorial(min(k, 170)) for k in range(count)]


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
