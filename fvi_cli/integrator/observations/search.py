"""Roots and extremes of a function along a motion, between all points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.observations.formulas import FormulaAlong, Isolated, Resolved
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.observations.pieces import parts_of, pieces_of
from fvi_cli.integrator.results.observed import Extent
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.brackets import bracketed_roots


def event_places(
    along: FormulaAlong, members: Sequence[int], direction: str
) -> tuple[Places, Array]:
    """Step and place in it of every change of sign, in the order of steps.

    `members` are the numbers of steps of the members; directions are ``any``, ``rising`` and
    ``falling``. Between neighbours among ends and extremes there is at most one root, so that both
    roots of a step with two are found. If the value is zero at an end, or changes its sign from one
    step to the next, the root is there.
    """
    firsts = np.append(0, np.cumsum(members))
    owner = np.repeat(np.arange(len(members)), members)
    parts = [one for first, n in zip(firsts, members, strict=False) for one in parts_of(first, n)]
    steps, places = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    last: tuple[Places, Array, Array] = (steps[0], places[0], places[0])
    are_inside, brackets = [np.zeros(0, dtype=bool)], [np.zeros((4, 0))]
    for found in pieces_of(parts, Isolated(along)):
        own = found.stations(along, found.reach >= np.abs(found.middle))
        _zero_at_starts(along, firsts, *own)
        step, place, value = (np.concatenate(pair) for pair in zip(last, own, strict=True))
        signed = np.flatnonzero(np.isfinite(value) & (value != 0.0))
        first, second = signed[:-1], signed[1:]
        sign = np.sign(value)
        turns = (sign[first] != sign[second]) & (owner[step[first]] == owner[step[second]])
        if direction != "any":
            turns &= sign[second] == (1.0 if direction == "rising" else -1.0)
        first, second = first[turns], second[turns]
        inside = (step[first] == step[second]) & (second == first + 1)
        left, right = first[inside], second[inside]
        brackets.append(np.stack([place[left], place[right], value[left], value[right]]))
        # else the value is zero there, or its sign changes by round-off between two steps
        at = np.where(inside, first, np.minimum(first + 1, second))
        are_inside.append(inside)
        steps.append(step[at])
        places.append(place[at])
        kept = signed[-1:]
        last = (step[kept], place[kept], value[kept])
    at, root, inside = (np.concatenate(one) for one in (steps, places, are_inside))
    if inside.any():
        root[inside] = bracketed_roots(along, at[inside], *np.concatenate(brackets, axis=1))
    return at, root


def _zero_at_starts(
    along: FormulaAlong, firsts: Places, step: Places, place: Array, value: Array
) -> None:
    """Let values at the start of a run that are round-off be zero."""
    at = np.flatnonzero(place == 0.0)
    at = at[firsts[np.searchsorted(firsts, step[at], side="right") - 1] == step[at]]
    if at.size:
        value[at[along.starts_with_zero(step[at])]] = 0.0


class Fall(NamedTuple):
    """Where a function along one step first falls through zero by more than round-off.

    `root` and `top` are 0 if no value before is above round-off.
    """

    root: float
    top: float  # place of the last value above round-off before the root
    below: float  # place of the first value below minus round-off, after the root


def first_fall(along: FormulaAlong, round_off: float) -> Fall | None:
    """Where a function along one step first falls below minus its round-off, or None."""
    (found,) = pieces_of(parts_of(0, 1), Isolated(along))
    step, place, value = found.stations(along, found.middle - found.reach < -round_off)
    low = np.flatnonzero(value < -round_off)
    if not low.size:
        return None
    first = int(low[0])
    high = np.flatnonzero(value[:first] > round_off)
    if not high.size:
        return Fall(0.0, 0.0, float(place[first]))
    last = int(high[-1])
    ends = [place[[last]], place[[first]], value[[last]], value[[first]]]
    root = bracketed_roots(along, step[:1], *ends)
    return Fall(float(root[0]), float(place[last]), float(place[first]))


def extents_of(motion: DenseMotion, along: FormulaAlong, ends: Sequence[float]) -> list[Extent]:
    """Extents of a formula for every member, up to a time of its own.

    At the start the velocity is the one that is given: behind a singular start the polynomial of
    the first step is far from it.
    """
    q, size = len(motion.scenes), motion.step_size
    parts = []
    for index, end in enumerate(ends):
        first, last = motion.firsts[index : index + 2].tolist()
        begins = motion.begin[first:last]
        count = int(np.searchsorted(begins, end, side="left"))
        until = 1.0
        if count and motion.end[first + count - 1] > end:
            until = float((end - begins[count - 1]) / size[first + count - 1])
        parts += parts_of(first, count, until)
    # least values, and their times, of minus the function and of the function
    least, at = np.full((2, q), math.inf), np.zeros((2, q))
    square, length = np.zeros((2, q))
    for found in pieces_of(parts, Resolved(along)):
        owner = motion.owner[found.step]
        np.add.at(square, owner, size[found.step] * found.squares)
        np.add.at(length, owner, size[found.step] * (found.end - found.begin))
        best = least.copy()
        for k, sign in enumerate((-1.0, 1.0)):
            known = np.where(np.isfinite(found.values), sign * found.values, math.inf)
            np.minimum.at(best[k], owner, known.min(axis=1))
        wanted = found.middle + found.reach > -best[0][owner]
        wanted |= found.middle - found.reach < best[1][owner]
        step, place, values = found.stations(along, wanted)
        finite = np.isfinite(values)
        step, place, values = step[finite], place[finite], values[finite]
        times, member = motion.time(step, place), motion.owner[step]
        for k, sign in enumerate((-1.0, 1.0)):
            _improve(least[k], at[k], sign * values, member, times)
    with np.errstate(all="ignore"):
        starts = along.at_starts(motion.firsts[:-1])
    known = np.flatnonzero(np.isfinite(starts))
    for k, sign in enumerate((-1.0, 1.0)):
        _improve(least[k], at[k], sign * starts[known], known, np.zeros(known.size))
    for k in np.flatnonzero(np.isinf(starts)).tolist():
        # there is no station at the start, and the integral of the square near it is not known
        side = int(starts[k] < 0)
        least[side, k], at[side, k], square[k] = -math.inf, 0.0, math.nan
    return [
        _extent(*(float(one) for one in (*least[:, k], *at[:, k], square[k], length[k])))
        for k in range(q)
    ]


def _improve(least: Array, at: Array, values: Array, owner: Places, time: Array) -> None:
    """Replace least values of members, and their times, by smaller values."""
    # by member, then by value; equal values keep their order in time
    order = np.lexsort((values, owner))
    first = order[np.append(True, np.diff(owner[order]) > 0)] if order.size else order
    first = first[values[first] < least[owner[first]]]
    least[owner[first]], at[owner[first]] = values[first], time[first]


def _extent(
    below: float, least: float, below_at: float, least_at: float, square: float, length: float
) -> Extent:
    """The extent of a function with these least values of its negative and of itself."""
    greatest, nan = -below, math.nan
    if least == math.inf:
        return Extent(peak=nan, peak_time=nan, least=nan, greatest=nan, rms=nan)
    is_low = -least > greatest
    return Extent(
        peak=-least if is_low else greatest,
        peak_time=least_at if is_low else below_at,
        least=least,
        greatest=greatest,
        rms=math.sqrt(max(square, 0.0) / length) if length else abs(greatest),
    )
