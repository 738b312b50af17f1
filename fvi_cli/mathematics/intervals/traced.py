"""Formulas on intervals and on samples inside of them at once: where samples see too little.

The range of a function over an interval holds all that its samples there span. Where it is many
times as large, a wall or a pulse may stand between the samples. Functions are looked at one by one,
so that a pulse is not lost in the range of a larger term beside it.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import INTERVAL_FUNCTIONS, Interval

BEYOND_SEEN = 4.0
"""Ranges up to so many times what samples span are their overestimate."""
STEEPEST = 0.25
"""Samples that lie farther from their neighbours' mean, relative to their span, are not smooth."""
MARGIN = 0.25
"""How far values may go beyond few or smooth samples, relative to their span."""
LARGEST, LEAST = 1e300, 1e-290
ROUND_OFF = 1e-13
"""Ranges below this share of their values are round-off."""


@dataclass(frozen=True, eq=False)
class Traced:
    """A value over n intervals of the time."""

    box: Interval  # its range on each, shape (n,)
    seen: Array  # samples, shape (n, k)
    # where the range of any function so far is far beyond its samples, (n,); shared
    doubtful: NDArray[np.bool_] = field(repr=False)

    __array_ufunc__ = None

    @property
    def hull(self) -> Interval:
        """What the samples span."""
        return Interval(self.seen.min(axis=1), self.seen.max(axis=1))

    def _with(self, box: Interval, seen: Array) -> Traced:
        return Traced(box, seen, self.doubtful)

    def _compared(
        self, box: Interval, seen: Array, spanned: Interval, *, of: object = 0.0
    ) -> Traced:
        """A value whose range is believed, and tightened, where samples of it are smooth.

        `spanned`: the range if the operands were no larger than their samples; `of`: the other one.
        """
        # where all have overflowed nothing hides
        low, high = np.clip(box.low, -LARGEST, LARGEST), np.clip(box.high, -LARGEST, LARGEST)
        values = np.clip(seen, -LARGEST, LARGEST)
        least, most = values.min(axis=1), values.max(axis=1)
        span = most - least
        noise = ROUND_OFF * np.maximum(np.abs(least), np.abs(most)) + LEAST
        usual = np.clip(spanned.high, -LARGEST, LARGEST) - np.clip(spanned.low, -LARGEST, LARGEST)
        between = 0.5 * (values[:, :-2:2] + values[:, 2::2])
        turns = np.abs(values[:, 1:-1:2] - between).max(axis=1)
        believed = (high - low <= BEYOND_SEEN * np.maximum(usual, span) + noise) & (
            turns <= STEEPEST * span + noise
        )
        self.doubtful[~believed] = True
        if not isinstance(of, Traced):
            return self._with(box, seen)
        # ranges of two operands that depend on each other are larger than need be
        believed = ~self.doubtful
        low = np.where(believed, np.maximum(low, least - MARGIN * span - noise), box.low)
        high = np.where(believed, np.minimum(high, most + MARGIN * span + noise), box.high)
        return self._with(Interval(low, high), seen)

    def __neg__(self) -> Traced:
        return self._with(-self.box, -self.seen)

    def _combined(
        self, operation: Callable[[Any, Any], Any], other: Traced | float, *, turned: bool = False
    ) -> Traced:
        """An operation on ranges, on samples and on what these span."""
        pairs = zip((self.box, self.seen, self.hull), _parts(other), strict=True)
        found = [operation(b, a) if turned else operation(a, b) for a, b in pairs]
        return self._compared(*found, of=other)

    def __add__(self, other: Traced | float) -> Traced:
        return self._combined(operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: Traced | float) -> Traced:
        return self._combined(operator.sub, other)

    def __rsub__(self, other: float) -> Traced:
        return -self + other

    def __mul__(self, other: Traced | float) -> Traced:
        return self._combined(operator.mul, other)

    __rmul__ = __mul__

    def __truediv__(self, other: Traced | float) -> Traced:
        return self._combined(operator.truediv, other)

    def __rtruediv__(self, other: float) -> Traced:
        return self._combined(operator.truediv, other, turned=True)

    def __pow__(self, other: Traced | float) -> Traced:
        return self._combined(operator.pow, other)

    def __rpow__(self, other: float) -> Traced:
        return self._combined(operator.pow, other, turned=True)


def _parts(
    value: Traced | float,
) -> tuple[Interval | float, Array | float, Interval | float]:
    if isinstance(value, Traced):
        return value.box, value.seen, value.hull
    return value, value, value


def _traced(name: str) -> Callable[..., Traced]:
    on_interval, on_array = INTERVAL_FUNCTIONS[name], NUMPY_FUNCTIONS[name]

    def function(*arguments: Traced | float) -> Traced:
        one = next(value for value in arguments if isinstance(value, Traced))
        boxes, samples, hulls = zip(*map(_parts, arguments), strict=True)
        return one._compared(
            on_interval(*boxes), np.asarray(on_array(*samples)), on_interval(*hulls)
        )

    return function


TRACED_FUNCTIONS: Mapping[str, Callable[..., Traced]] = {
    name: _traced(name) for name in INTERVAL_FUNCTIONS if name in NUMPY_FUNCTIONS
}


def trace(
    expression: Expression, begin: Array, end: Array, samples: Array
) -> tuple[Interval, Array, NDArray[np.bool_]]:
    """Ranges of a formula of the time t over intervals, its samples there, and where these miss.

    Intervals from `begin` to `end`, shape ``(n,)``; samples in them, both ends included, of shape
    ``(n, k)``. The values have the shape of the samples, the rest ``(n,)``.
    """
    doubtful = np.zeros(begin.size, dtype=bool)
    time = Traced(Interval(begin, end), samples, doubtful)
    found = expression.evaluate({"t": time}, TRACED_FUNCTIONS)
    if not isinstance(found, Traced):
        constant = np.full(begin.size, float(found))
        return Interval(constant, constant), np.full(samples.shape, float(found)), doubtful
    return found.box, found.seen, doubtful
