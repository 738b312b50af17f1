"""Where a formula in one variable grows beyond all bounds: ranges that stay unbounded."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import Interval

FIRST_PARTS: Final = 64  # of the interval, before any halving
MOST_PARTS: Final = 1024  # open parts of one length that are followed
DISTANCES: Final = (1e-8, 1e-6)
"""Distances from a place at which the power is estimated, relative to the interval's length."""
LEAST_INTEGRABLE: Final = -0.999  # estimated powers up to this are taken for -1 or less

IsOpen = Callable[[Places, Array, Array], NDArray[np.bool_]]


def find_open_places(is_open: IsOpen, low: Array, high: Array) -> tuple[Places, Array]:
    """Places in n intervals whose surroundings stay open however often they are halved.

    ``is_open(numbers, low, high)`` says which parts, from `low` to `high`, of the intervals with
    these numbers are open. Of each length the first 1024 open parts are followed. Returns the
    numbers of the intervals and the places, both ascending.
    """
    numbers = np.arange(low.size)
    least = 4 * np.spacing(np.maximum(np.abs(low), np.abs(high)).max())
    while True:
        left = is_open(numbers, low, high)
        numbers, low, high = (
            numbers[left][:MOST_PARTS],
            low[left][:MOST_PARTS],
            high[left][:MOST_PARTS],
        )
        middle = 0.5 * (low + high)
        if not numbers.size or (high - low).max() <= least:
            return numbers, middle
        numbers = np.repeat(numbers, 2)
        low, high = (np.stack(p, axis=1).ravel() for p in ((low, middle), (middle, high)))


@lru_cache(maxsize=1024)
def pole_inside(formula: Expression, begin: float, end: float) -> tuple[float, float] | None:
    """The first place in (begin, end] where the integral of a formula is infinite, and its power.

    Candidates are places around which the range is unbounded on any interval, however short. The
    power of the distance is estimated from values near a candidate; -1 and less is not integrable.
    None if there is no such place.
    """
    (name,) = formula.names or ("",)
    edges = np.linspace(begin, end, FIRST_PARTS + 1)

    def is_open(_: Places, low: Array, high: Array) -> NDArray[np.bool_]:
        try:
            found = formula.evaluate({name: Interval(low, high)})
        except ExpressionError:
            # some functions that only derivatives call have no known range
            found = 0.0
        return is_unbounded(found, low)

    with np.errstate(all="ignore"):
        length = end - begin
        for place in find_open_places(is_open, edges[:-1], edges[1:])[1].tolist():
            if place - begin > DISTANCES[1] * length:
                power = _power_at(formula, name, place, length, end)
                if power <= LEAST_INTEGRABLE:
                    return place, round(power, 3)
    return None


def is_unbounded(found: object, like: Array) -> NDArray[np.bool_]:
    """Where a range is infinite, in the shape of `like`; nowhere if `found` is a number."""
    if not isinstance(found, Interval):
        return np.zeros(like.shape, dtype=bool)
    return np.asarray(~(np.isfinite(found.low) & np.isfinite(found.high)))


def _power_at(formula: Expression, name: str, place: float, length: float, end: float) -> float:
    """The least power of the distance with which a formula grows near a place."""
    powers = [0.0]
    for side in (-1.0, 1.0):
        times: Array = place + side * length * np.array(DISTANCES)
        if times[1] > end:
            continue
        near, far = np.abs(formula.evaluate({name: times}))
        if 0 < near < np.inf and 0 < far < np.inf:
            powers.append(float(np.log(near / far) / np.log(DISTANCES[0] / DISTANCES[1])))
    return min(powers)
