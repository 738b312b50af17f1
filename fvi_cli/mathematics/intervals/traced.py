"""Evaluate formulas on intervals and on samples inside of them: find where samples miss something.

The range of a function over an interval contains the span of its samples there. Where the range is
many times as wide, a wall or a pulse may lie between the samples. Each function in a formula is
checked by itself, so that a pulse is not lost in the range of a larger term.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import Algebra
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import Interval

BEYOND_SEEN = 4.0
"""A range up to this many times the span of the samples counts as an overestimate."""
STEEPEST = 0.25
"""Samples farther from the mean of their neighbours, relative to the span, are not smooth."""
MARGIN = 0.25
"""How far values may lie outside of the span of smooth samples, relative to the span."""
LARGEST, LEAST = 1e300, 1e-290  # size to which values are clipped, and width that is always noise
ROUND_OFF = 1e-13
"""A range narrower than this share of its values is round-off."""
_OPERATORS = (np.add, np.subtract, np.multiply, np.divide, np.power)


@dataclass(frozen=True, eq=False)
class Traced(Algebra):
    """A value over n intervals of the time."""

    box: Interval  # its range on each, shape (n,)
    seen: Array  # samples, shape (n, k)
    # where any function so far has a range far wider than its samples, (n,); shared
    undersampled: NDArray[np.bool_] = field(repr=False)

    @property
    def hull(self) -> Interval:
        """The span of the samples."""
        return Interval(self.seen.min(axis=1), self.seen.max(axis=1))

    def _compared(self, box: Interval, seen: Array, spanned: Interval, *, combines: bool) -> Traced:
        """Mark where samples miss something, and tighten the range elsewhere.

        `spanned` would be the range if the operands stayed within the spans of their samples. The
        range is tightened if the function `combines` two values, which may depend on each other.
        """
        # clipped: where all values have overflowed, samples miss nothing
        low, high = np.clip(box.low, -LARGEST, LARGEST), np.clip(box.high, -LARGEST, LARGEST)
        values = np.clip(seen, -LARGEST, LARGEST)
        least, most = values.min(axis=1), values.max(axis=1)
        span = most - least
        noise = ROUND_OFF * np.maximum(np.abs(least), np.abs(most)) + LEAST
        usual = np.clip(spanned.high, -LARGEST, LARGEST) - np.clip(spanned.low, -LARGEST, LARGEST)
        between = 0.5 * (values[:, :-2:2] + values[:, 2::2])
        turns = np.abs(values[:, 1:-1:2] - between).max(axis=1)
        is_sampled = (high - low <= BEYOND_SEEN * np.maximum(usual, span) + noise) & (
            turns <= STEEPEST * span + noise
        )
        self.undersampled[~is_sampled] = True
        if not combines:
            return Traced(box, seen, self.undersampled)
        is_sampled = ~self.undersampled
        low = np.where(is_sampled, np.maximum(low, least - MARGIN * span - noise), box.low)
        high = np.where(is_sampled, np.minimum(high, most + MARGIN * span + noise), box.high)
        return Traced(Interval(low, high), seen, self.undersampled)

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Traced:
        """Apply a function to the ranges, to the samples and to the spans of the samples."""
        boxes, samples, hulls = zip(*map(_parts, inputs), strict=True)
        box, seen = ufunc(*boxes), np.asarray(ufunc(*samples))
        if ufunc is np.negative:
            return Traced(box, seen, self.undersampled)
        combines = ufunc in _OPERATORS and all(isinstance(one, Traced) for one in inputs)
        return self._compared(box, seen, ufunc(*hulls), combines=combines)


def _parts(
    value: Traced | float,
) -> tuple[Interval | float, Array | float, Interval | float]:
    if isinstance(value, Traced):
        return value.box, value.seen, value.hull
    return value, value, value


def trace(
    expression: Expression, begin: Array, end: Array, samples: Array
) -> tuple[Interval, Array, NDArray[np.bool_]]:
    """Ranges of a formula of t over intervals, its samples there, and where samples miss something.

    Intervals from `begin` to `end`, shape ``(n,)``; samples in them, both ends included, of shape
    ``(n, k)``. The values have the shape of the samples, the rest ``(n,)``.
    """
    undersampled = np.zeros(begin.size, dtype=bool)
    time = Traced(Interval(begin, end), samples, undersampled)
    found = expression.evaluate({"t": time})
    if not isinstance(found, Traced):
        constant = np.full(begin.size, float(found))
        return Interval(constant, constant), np.full(samples.shape, float(found)), undersampled
    return found.box, found.seen, undersampled
