"""Roots and extremes of a formula along motions, between all points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.observe.along import FormulaAlong, divide
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.trajectory import Extent
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.brackets import bracketed_roots


def find_events(along: FormulaAlong, owner: Places, direction: str) -> tuple[Places, Array]:
    """Step and place in it of every change of sign, in the order of steps.

    `owner` is the member of every step; directions are ``any``, ``rising`` and ``falling``. Between
    neighbours among ends and extremes there is at most one root, so that both roots of a step with
    two are found. If the value is zero at an end, or changes its sign from one step to the next,
    the root is there.
    """
    every = divide(along, np.arange(owner.size), sought="roots")
    found = [one.stations(along, one.reach >= np.abs(one.middle)) for one in every]
    step, place, value = (np.concatenate(one) for one in zip(*found, strict=True))
    # values at the start of a run that are round-off are zero
    starts = np.flatnonzero((place == 0.0) & np.insert(np.diff(owner) != 0, 0, True)[step])
    first, noise = along.at_starts(step[starts])
    value[starts[np.abs(first) <= noise]] = 0.0
    signed = np.flatnonzero(np.isfinite(value) & (value != 0.0))
    left, right = signed[:-1], signed[1:]
    sign = np.sign(value)
    turns = (sign[left] != sign[right]) & (owner[step[left]] == owner[step[right]])
    if direction != "any":
        turns &= sign[right] == (1.0 if direction == "rising" else -1.0)
    left, right = left[turns], right[turns]
    inside = (step[left] == step[right]) & (right == left + 1)
    # else the value is zero there, or its sign changes by round-off between two steps
    at = np.where(inside, left, np.minimum(left + 1, right))
    roots = place[at]
    if inside.any():
        a, b = left[inside], right[inside]
        roots[inside] = bracketed_roots(along, step[a], place[a], place[b], value[a], value[b])
    return step[at], roots


class Fall(NamedTuple):
    """Where a formula along one step first falls through zero by more than round-off.

    `root` and `top` are 0 if no value before is above round-off.
    """

    root: float
    top: float  # place of the last value above round-off before the root
    below: float  # place of the first value below minus round-off, after the root


def first_fall(along: FormulaAlong, round_off: float) -> Fall | None:
    """Where a formula along one step first falls below minus its round-off, or None."""
    (found,) = divide(along, np.zeros(1, dtype=np.intp), sought="roots")
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


def find_extents(motion: Motion, along: FormulaAlong, ends: Sequence[float]) -> list[Extent]:
    """Extents of a formula for every member, up to a time of its own.

    At the start the velocity is the one that is given: behind a singular start the polynomial of
    the first step is far from it.
    """
    q, size, ending = len(motion.scenes), motion.step_size, np.asarray(ends)[motion.owner]
    steps = np.flatnonzero(motion.begin < ending)
    until = np.where(motion.end > ending, (ending - motion.begin) / size, 1.0)
    best, square, length = np.full((2, q), math.inf), np.zeros(q), np.zeros(q)
    begins = motion.firsts[:-1]
    with np.errstate(all="ignore"):
        starts, _ = along.at_starts(begins)
    known = np.flatnonzero(~np.isnan(starts))
    every = [(begins[known], np.zeros(known.size), starts[known])]
    for found in divide(along, steps, until[steps]):
        owner = motion.owner[found.step]
        square += np.bincount(owner, size[found.step] * found.squares, minlength=q)
        length += np.bincount(owner, size[found.step] * (found.end - found.begin), minlength=q)
        for k, sign in enumerate((-1.0, 1.0)):
            values = np.where(np.isfinite(found.values), sign * found.values, math.inf)
            np.minimum.at(best[k], owner, values.min(axis=1))
        wanted = found.middle + found.reach > -best[0][owner]
        wanted |= found.middle - found.reach < best[1][owner]
        step, place, value = found.stations(along, wanted)
        finite = np.isfinite(value)
        every.append((step[finite], place[finite], value[finite]))
    step, place, value = (np.concatenate(one) for one in zip(*every, strict=True))
    least, at = np.full((2, q), math.inf), np.zeros((2, q))
    member, time = motion.owner[step], motion.time(step, place)
    for k, sign in enumerate((-1.0, 1.0)):
        # by member, then by value; of equal values the first
        order = np.lexsort((sign * value, member))
        first = order[np.insert(np.diff(member[order]) > 0, 0, True)] if order.size else order
        least[k, member[first]], at[k, member[first]] = sign * value[first], time[first]
    # near an infinite start the integral of the square is not known
    square[np.isinf(starts)] = math.nan
    return [
        _extent(*(float(one) for one in (*least[:, k], *at[:, k], square[k], length[k])))
        for k in range(q)
    ]


def _extent(
    below: float, least: float, below_at: float, least_at: float, square: float, length: float
) -> Extent:
    """The extent of a formula with these least values of its negative and of itself."""
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
