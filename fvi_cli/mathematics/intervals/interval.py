"""Intervals as arrays of lower and upper ends, with the operations of formulas.

Every operation encloses the range of the exact one up to round-off (Moore, Kearfott, Cloud,
*Introduction to Interval Analysis*, SIAM 2009, chapter 2); ends are not rounded outwards, because
ranges are asked for where something large may have been missed, not for proofs to the last digit.
Floating-point errors are treated as the caller's ``np.errstate`` says; formulas ignore them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, eq=False)
class Interval:
    """Numbers between `low` and `high`, elementwise."""

    low: Array  # ends, of the same shape; an empty or undefined range is -inf to inf
    high: Array

    __array_ufunc__ = None

    @property
    def width(self) -> Array:
        """Length of the interval."""
        return np.asarray(self.high - self.low)

    def __neg__(self) -> Interval:
        return Interval(-self.high, -self.low)

    def __add__(self, other: Interval | float) -> Interval:
        if isinstance(other, Interval):
            return Interval(self.low + other.low, self.high + other.high)
        return Interval(self.low + other, self.high + other)

    __radd__ = __add__

    def __sub__(self, other: Interval | float) -> Interval:
        return self + (-other)

    def __rsub__(self, other: Interval | float) -> Interval:
        return -self + other

    def __mul__(self, other: Interval | float) -> Interval:
        if isinstance(other, Interval):
            return hull(
                self.low * other.low,
                self.low * other.high,
                self.high * other.low,
                self.high * other.high,
            )
        return hull(self.low * other, self.high * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Interval | float) -> Interval:
        if isinstance(other, Interval):
            return self * other.inverse()
        return hull(self.low / other, self.high / other)

    def __rtruediv__(self, other: float) -> Interval:
        return self.inverse() * other

    def inverse(self) -> Interval:
        """1 over the interval; everything where it holds zero."""
        holds_zero = (self.low <= 0) & (self.high >= 0)
        low = np.where(holds_zero, -math.inf, 1.0 / self.high)
        high = np.where(holds_zero, math.inf, 1.0 / self.low)
        return Interval(low, high)

    def __pow__(self, exponent: Interval | float) -> Interval:
        if isinstance(exponent, Interval):
            # a**b = exp(b log a)
            return monotone(np.exp, exponent * monotone(np.log, self, 0.0))
        if float(exponent).is_integer():
            return self._whole_power(int(exponent))
        base = Interval(np.maximum(self.low, 0.0), np.maximum(self.high, 0.0))
        return hull(base.low**exponent, base.high**exponent)

    def __rpow__(self, base: float) -> Interval:
        return monotone(np.exp, self * math.log(base)) if base > 0 else everything(self.low)

    def _whole_power(self, exponent: int) -> Interval:
        if exponent < 0:
            return self._whole_power(-exponent).inverse()
        ends = hull(self.low**exponent, self.high**exponent)
        if exponent % 2 == 0 and exponent > 0:
            holds_zero = (self.low <= 0) & (self.high >= 0)
            return Interval(np.where(holds_zero, 0.0, ends.low), ends.high)
        return ends


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
    """The range of a monotone function of an interval, as far as this lies in its domain."""
    return hull(
        function(np.clip(value.low, first, last)), function(np.clip(value.high, first, last))
    )
