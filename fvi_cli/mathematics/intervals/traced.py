"""Formulas on intervals and on samples inside of them at once: where samples see too little.

The range of a function over an interval holds all that its samples there span. Where it is many
times as large, a wall or a pulse may stand between the samples. Functions are looked at one by one,
so that a pulse is not lost in the range of a larger term beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import INTERVAL_FUNCTIONS
from fvi_cli.mathematics.intervals.interval import Interval

BEYOND_SEEN = 4.0
"""Ranges up to so many times what samples span are their overestimate."""
LARGEST = 1e300
ROUND_OFF = 1e-13
"""Ranges below this share of their values are round-off."""


@dataclass(frozen=True, eq=False)
class Traced:
    """A value over n intervals of the time.

    Parameters
    ----------
    box
        Its range on each, shape ``(n,)``.
    seen
        Samples, shape ``(n, k)``.
    doubtful
        Where the range of any function so far is far beyond its samples, ``(n,)``; shared.
    """

    box: Interval
    seen: Array
    doubtful: NDArray[np.bool_] = field(repr=False)

    __array_ufunc__ = None

    def _with(self, box: Interval, seen: Array) -> Traced:
        return Traced(box, seen, self.doubtful)

    def _compared(self, box: Interval, seen: Array) -> Traced:
        # where both have overflowed nothing hides
        low, high = np.clip(box.low, -LARGEST, LARGEST), np.clip(box.high, -LARGEST, LARGEST)
        values = np.clip(seen, -LARGEST, LARGEST)
        least, most = values.min(axis=1), values.max(axis=1)
        largest = np.maximum(np.abs(least), np.abs(most))
        spanned = BEYOND_SEEN * (most - least) + ROUND_OFF * largest
        self.doubtful[~(high - low <= spanned)] = True
        return self._with(box, seen)

    def __neg__(self) -> Traced:
        return self._with(-self.box, -self.seen)

    def __add__(self, other: Traced | float) -> Traced:
        box, seen = _parts(other)
        return self._with(self.box + box, self.seen + seen)

    __radd__ = __add__

    def __sub__(self, other: Traced | float) -> Traced:
        box, seen = _parts(other)
        return self._with(self.box - box, self.seen - seen)

    def __rsub__(self, other: float) -> Traced:
        return -self + other

    def __mul__(self, other: Traced | float) -> Traced:
        box, seen = _parts(other)
        return self._with(self.box * box, self.seen * seen)

    __rmul__ = __mul__

    def __truediv__(self, other: Traced | float) -> Traced:
        box, seen = _parts(other)
        return self._compared(self.box / box, self.seen / seen)

    def __rtruediv__(self, other: float) -> Traced:
        return self._compared(other / self.box, other / self.seen)

    def __pow__(self, other: Traced | float) -> Traced:
        box, seen = _parts(other)
        return self._compared(self.box**box, self.seen**seen)

    def __rpow__(self, other: float) -> Traced:
        return self._compared(other**self.box, other**self.seen)


def _parts(value: Traced | float) -> tuple[Interval | float, Array | float]:
    return (value.box, value.seen) if isinstance(value, Traced) else (value, value)


def _traced(name: str) -> Callable[..., Traced]:
    on_interval, on_array = INTERVAL_FUNCTIONS[name], NUMPY_FUNCTIONS[name]

    def function(*arguments: Traced | float) -> Traced:
        one = next(value for value in arguments if isinstance(value, Traced))
        boxes, samples = zip(*map(_parts, arguments), strict=True)
        return one._compared(on_interval(*boxes), np.asarray(on_array(*samples)))

    return function


TRACED_FUNCTIONS: Mapping[str, Callable[..., Traced]] = {
    name: _traced(name) for name in INTERVAL_FUNCTIONS if name in NUMPY_FUNCTIONS
}


def trace(
    expression: Expression, begin: Array, end: Array, samples: Array
) -> tuple[Interval, Array, NDArray[np.bool_]]:
    """Ranges of a formula of the time t over intervals, its samples there, and where these miss.

    Parameters
    ----------
    expression
        Of t alone.
    begin, end
        Ends of the intervals, shape ``(n,)``.
    samples
        Times inside, both ends among them, shape ``(n, k)``.

    Returns
    -------
    ranges, values, doubtful
        Of n intervals, shape ``(n, k)``, and shape ``(n,)``.
    """
    doubtful = np.zeros(begin.size, dtype=bool)
    time = Traced(Interval(begin, end), samples, doubtful)
    with np.errstate(all="ignore"):
        found = expression.evaluate({"t": time}, TRACED_FUNCTIONS)
    if not isinstance(found, Traced):
        constant = np.full(begin.size, float(found))
        return Interval(constant, constant), np.full(samples.shape, float(found)), doubtful
    return found.box, found.seen, doubtful
