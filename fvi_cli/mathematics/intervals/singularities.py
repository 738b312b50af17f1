"""Where a formula in one variable grows beyond all bounds: ranges that stay unbounded."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, ExpressionError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import INTERVAL_FUNCTIONS
from fvi_cli.mathematics.intervals.interval import Interval

FIRST_PARTS: Final = 64
MOST_PARTS: Final = 1024
MOST_HALVINGS: Final = 60
DISTANCES: Final = (1e-8, 1e-6)
"""Distances from a place at which the power is told, in lengths of the interval."""
LEAST_INTEGRABLE: Final = -0.999


@lru_cache(maxsize=1024)
def pole_inside(formula: Expression, begin: float, end: float) -> tuple[float, float] | None:
    """The first place in (begin, end] where the integral of a formula is infinite, and its power.

    A place is looked at where its range is not bounded however short the interval is; the power of
    the distance is told by values beside it, -1 and less is not integrable. None: there is none, or
    there are more places than can be looked at.
    """
    (name,) = formula.names or ("",)
    edges = np.linspace(begin, end, FIRST_PARTS + 1)
    low, high = edges[:-1], edges[1:]
    least = 4 * np.spacing(max(abs(begin), abs(end)))
    with np.errstate(all="ignore"):
        for _ in range(MOST_HALVINGS):
            try:
                found = formula.evaluate({name: Interval(low, high)}, INTERVAL_FUNCTIONS)
            except ExpressionError:
                # of some functions of derivatives no range is known
                return None
            if not isinstance(found, Interval):
                return None
            bounded = np.isfinite(found.low) & np.isfinite(found.high)
            low, high = low[~bounded], high[~bounded]
            if not low.size or low.size > MOST_PARTS:
                return None
            if (high - low).max() <= least:
                break
            middle = 0.5 * (low + high)
            low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
            low, high = np.sort(low), np.sort(high)
        length = end - begin
        for place in 0.5 * (low + high):
            if place - begin > DISTANCES[1] * length:
                power = _power_at(formula, name, float(place), length, end)
                if power <= LEAST_INTEGRABLE:
                    return float(place), round(power, 3)
    return None


def _power_at(formula: Expression, name: str, place: float, length: float, end: float) -> float:
    """The least power of the distance with which a formula grows beside a place."""
    powers = [0.0]
    for side in (-1.0, 1.0):
        times: Array = place + side * length * np.array(DISTANCES)
        if times[1] > end:
            continue
        near, far = np.abs(formula.evaluate({name: times}, NUMPY_FUNCTIONS))
        if 0 < near < np.inf and 0 < far < np.inf:
            powers.append(float(np.log(near / far) / np.log(DISTANCES[0] / DISTANCES[1])))
    return min(powers)
