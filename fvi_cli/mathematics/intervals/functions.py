"""Intervals as arrays of lower and upper ends, with the operations and functions of formulas.

Every operation encloses the range of the exact one up to round-off (Moore, Kearfott, Cloud,
*Introduction to Interval Analysis*, SIAM 2009, chapter 2); ends are not rounded outwards, because
ranges serve to find large values that samples miss, not for proofs to the last digit.
Floating-point errors are treated as the caller's ``np.errstate`` says; formulas ignore them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, Algebra
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, eq=False)
class Interval(Algebra):
    """Numbers between `low` and `high`, elementwise."""

    low: Array  # ends, of the same shape; an empty or undefined range is -inf to inf
    high: Array

    @property
    def width(self) -> Array:
        """Length of the interval."""
        return np.asarray(self.high - self.low)

    def inverse(self) -> Interval:
        """1 over the interval; everything where it holds zero."""
        holds_zero = (self.low <= 0) & (self.high >= 0)
        low = np.where(holds_zero, -math.inf, 1.0 / self.high)
        high = np.where(holds_zero, math.inf, 1.0 / self.low)
        return Interval(low, high)


def hull(*values: Array) -> Interval:
    """The least interval with all these numbers; everything where one is not a number."""
    low, high = values[0], values[0]
    for value in values[1:]:
        low, high = np.minimum(low, value), np.maximum(high, value)
    unknown = np.isnan(low) | np.isnan(high)
    if unknown.any():
        low, high = np.where(unknown, -math.inf, low), np.where(unknown, math.inf, high)
    return Interval(np.asarray(low), np.asarray(high))


def everything(like: Array) -> Interval:
    """All numbers, in the shape of `like`."""
    return Interval(np.full_like(like, -math.inf), np.full_like(like, math.inf))


def monotone(
    function: Callable[[Array], Array],
    value: Interval,
    first: float = -math.inf,
    last: float = math.inf,
) -> Interval:
    """The range of a monotone function on the part of an interval in its domain [first, last]."""
    return hull(
        function(np.clip(value.low, first, last)), function(np.clip(value.high, first, last))
    )


def _ends(value: Interval | float) -> tuple[Array, Array]:
    if isinstance(value, Interval):
        return value.low, value.high
    return np.asarray(value), np.asarray(value)


def _sum(a: Interval | float, b: Interval | float) -> Interval:
    (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
    return Interval(a_low + b_low, a_high + b_high)


def _difference(a: Interval | float, b: Interval | float) -> Interval:
    (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
    return Interval(a_low - b_high, a_high - b_low)


def _product(a: Interval | float, b: Interval | float) -> Interval:
    return hull(*(one * other for one in _ends(a) for other in _ends(b)))


def _quotient(a: Interval | float, b: Interval | float) -> Interval:
    if isinstance(b, Interval):
        return _product(a, b.inverse())
    low, high = _ends(a)
    return hull(low / b, high / b)


def _power(base: Interval | float, exponent: Interval | float) -> Interval:
    if not isinstance(base, Interval):
        exponents = Interval(*_ends(exponent))
        if not base > 0:
            return everything(exponents.low)
        return monotone(np.exp, _product(exponents, math.log(base)))
    if isinstance(exponent, Interval):
        # a**b = exp(b log a)
        return monotone(np.exp, _product(exponent, monotone(np.log, base, 0.0)))
    if float(exponent).is_integer():
        return _whole_power(base, int(exponent))
    low, high = np.maximum(base.low, 0.0), np.maximum(base.high, 0.0)
    return hull(low**exponent, high**exponent)


def _whole_power(base: Interval, exponent: int) -> Interval:
    if exponent < 0:
        return _whole_power(base, -exponent).inverse()
    ends = hull(base.low**exponent, base.high**exponent)
    if exponent % 2 == 0 and exponent > 0:
        holds_zero = (base.low <= 0) & (base.high >= 0)
        return Interval(np.where(holds_zero, 0.0, ends.low), ends.high)
    return ends


_DOMAINS: Final[Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        "sqrt": (0.0, math.inf),
        "log": (0.0, math.inf),
        "log1p": (-1.0, math.inf),
        "arcsin": (-1.0, 1.0),
        "arccos": (-1.0, 1.0),
        "arccosh": (1.0, math.inf),
        "arctanh": (-1.0, 1.0),
    }
)
_MONOTONE: Final = (
    *_DOMAINS,
    *("cbrt", "exp", "expm1", "sinh", "tanh", "arctan", "arcsinh", "sign"),
)
GAMMA_TURNS_AT: Final = 1.4616321449683622
"""Where the gamma function of positive numbers is least."""
LEAST_GAMMA: Final = 0.8856031944108886  # its value there


def _monotone(name: str) -> Callable[[Interval], Interval]:
    function, domain = NUMPY_FUNCTIONS[name], _DOMAINS.get(name, ())
    return lambda value: monotone(function, value, *domain)


def _even(function: Callable[[Array], Array]) -> Callable[[Interval], Interval]:
    """A function that is even and increases with the size of its argument."""

    def on_interval(value: Interval) -> Interval:
        holds_zero = (value.low <= 0) & (value.high >= 0)
        ends = monotone(function, value)
        return Interval(np.where(holds_zero, function(np.zeros(())), ends.low), ends.high)

    return on_interval


def _holds(value: Interval, first: float, period: float) -> NDArray[np.bool_]:
    """Whether the interval holds a point ``first + k period``."""
    following = first + period * np.ceil((value.low - first) / period)
    return np.asarray((following <= value.high) | ~np.isfinite(following))


def _wave(value: Interval, function: Callable[[Array], Array], top: float) -> Interval:
    """Sine or cosine; `top` is the place of its first maximum."""
    ends = monotone(function, value)
    at_top = _holds(value, top, 2 * math.pi)
    at_bottom = _holds(value, top + math.pi, 2 * math.pi)
    return Interval(
        np.where(at_bottom, -1.0, np.maximum(ends.low, -1.0)),
        np.where(at_top, 1.0, np.minimum(ends.high, 1.0)),
    )


def _tan(value: Interval) -> Interval:
    ends = monotone(np.tan, value)
    pole = _holds(value, 0.5 * math.pi, math.pi)
    return Interval(np.where(pole, -math.inf, ends.low), np.where(pole, math.inf, ends.high))


def _gamma(value: Interval) -> Interval:
    ends = monotone(NUMPY_FUNCTIONS["gamma"], value)
    turns = (value.low <= GAMMA_TURNS_AT) & (value.high >= GAMMA_TURNS_AT)
    all_numbers, sound = everything(value.low), value.low > 0
    return Interval(
        np.where(sound, np.where(turns, LEAST_GAMMA, ends.low), all_numbers.low),
        np.where(sound, ends.high, all_numbers.high),
    )


def _extremum(function: Callable[..., Array]) -> Callable[..., Interval]:

    def on_intervals(a: Interval | float, b: Interval | float) -> Interval:
        (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
        return hull(function(a_low, b_low), function(a_high, b_high))

    return on_intervals


def _select(
    a: Interval | float, b: Interval | float, below: Interval | float, above: Interval | float
) -> Interval:
    """The range of the value that is taken; of both values where the choice is not known."""
    (a_low, a_high), (b_low, b_high) = _ends(a), _ends(b)
    first, second = _ends(below), _ends(above)
    low = np.where(a_low > b_high, second[0], first[0])
    high = np.where(a_low > b_high, second[1], first[1])
    unknown = ~((a_low > b_high) | (a_high < b_low))
    return hull(
        np.where(unknown, np.minimum(first[0], second[0]), low),
        np.where(unknown, np.maximum(first[1], second[1]), high),
    )


Interval.rules = MappingProxyType(
    {
        "negative": lambda value: Interval(-value.high, -value.low),
        "add": _sum,
        "subtract": _difference,
        "multiply": _product,
        "divide": _quotient,
        "power": _power,
        "square": lambda value: _whole_power(value, 2),
        **{name: _monotone(name) for name in _MONOTONE},
        "absolute": _even(np.abs),
        "cosh": _even(np.cosh),
        "sin": lambda value: _wave(value, np.sin, 0.5 * math.pi),
        "cos": lambda value: _wave(value, np.cos, 0.0),
        "tan": _tan,
        "gamma": _gamma,
        "minimum": _extremum(np.minimum),
        "maximum": _extremum(np.maximum),
        "select": _select,
    }
)
