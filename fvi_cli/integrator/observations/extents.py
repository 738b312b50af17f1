"""How large functions along a motion become between all points."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.observations.criteria import Resolved
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.pieces import Along, Part, parts_of, pieces_of
from fvi_cli.integrator.results.observed import Extent
from fvi_cli.mathematics.arrays import Array, Places


def extents_of(motion: DenseMotion, along: Along, ends: Sequence[float]) -> list[Extent]:
    """Extents of a function for every member, up to a time of its own.

    Parameters
    ----------
    motion
        The motion of q members.
    along
        The function.
    ends
        Up to which time each is followed, q of them.
    """
    q, size = len(motion.scenes), motion.step_size
    parts: list[Part] = []
    for index, end in enumerate(ends):
        first, last = motion.firsts[index : index + 2].tolist()
        begins = motion.begin[first:last]
        count = int(np.searchsorted(begins, end, side="left"))
        until = 1.0
        if count and motion.end[first + count - 1] > end:
            until = float((end - begins[count - 1]) / size[first + count - 1])
        parts += parts_of(first, count, until)
    least, greatest = np.full(q, math.inf), np.full(q, -math.inf)
    least_at, greatest_at, square, length = np.zeros((4, q))
    for found in pieces_of(parts, Resolved(along)):
        owner = motion.owner[found.step]
        np.add.at(square, owner, size[found.step] * found.squares)
        np.add.at(length, owner, size[found.step] * (found.end - found.begin))
        is_value = np.isfinite(found.values)
        low, high = least.copy(), greatest.copy()
        np.minimum.at(low, owner, np.where(is_value, found.values, math.inf).min(axis=1))
        np.maximum.at(high, owner, np.where(is_value, found.values, -math.inf).max(axis=1))
        wanted = (found.middle + found.reach > high[owner]) | (
            found.middle - found.reach < low[owner]
        )
        step, place = found.stations(wanted)
        values = along(step, place)
        finite = np.isfinite(values)
        step, place, values = step[finite], place[finite], values[finite]
        times, member = motion.time(step, place), motion.owner[step]
        _improve(least, least_at, values, member, times)
        negative = -greatest
        _improve(negative, greatest_at, -values, member, times)
        greatest = -negative
    return [
        _extent(
            *(float(one[k]) for one in (least, least_at, greatest, greatest_at, square, length))
        )
        for k in range(q)
    ]


def _improve(least: Array, at: Array, values: Array, owner: Places, time: Array) -> None:
    """Take smaller values, the first of each member, and their times."""
    # by member, then by value; equal values keep their order in time
    order = np.lexsort((values, owner))
    first = order[np.append(True, np.diff(owner[order]) > 0)] if order.size else order
    first = first[values[first] < least[owner[first]]]
    least[owner[first]], at[owner[first]] = values[first], time[first]


def _extent(
    least: float, least_at: float, greatest: float, greatest_at: float, square: float, length: float
) -> Extent:
    if not math.isfinite(least):
        return Extent(
            peak=math.nan, peak_time=math.nan, least=math.nan, greatest=math.nan, rms=math.nan
        )
    is_low = -least > greatest
    return Extent(
        peak=-least if is_low else greatest,
        peak_time=least_at if is_low else greatest_at,
        least=least,
        greatest=greatest,
        rms=math.sqrt(max(square, 0.0) / length) if length else abs(greatest),
    )
