"""The places of a motion at which a formula changes its sign."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.observations.criteria import FormulaAlong, Isolated
from fvi_cli.integrator.observations.pieces import (
    Criterion,
    Part,
    bracketed_roots,
    parts_of,
    pieces_of,
)
from fvi_cli.mathematics.arrays import Array, Places


def event_places(
    along: FormulaAlong,
    members: Sequence[int],
    direction: str,
    criterion: Criterion | None = None,
) -> tuple[Places, Array, dict[int, float]]:
    """Step and place in it of every change of sign, in the order of steps.

    Behind them stands, for members where some may be missing, from which step on, with the place
    in it as a fraction.

    Between neighbours among ends and extremes there is one root at most, so none is lost where a
    step has two. Where the value is zero at an end, or changes from one step to the next, the
    root is there.

    Parameters
    ----------
    along
        The formula.
    members
        Number of steps of every member.
    direction
        ``any``, ``rising`` or ``falling``.
    criterion
        When pieces are halved; that of :class:`Isolated` by default.
    """
    firsts = np.append(0, np.cumsum(members))
    owner = np.repeat(np.arange(len(members)), members)
    parts: list[Part] = []
    for first, count in zip(firsts.tolist(), members, strict=False):
        parts += parts_of(first, count)
    steps, places = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    last: tuple[Places, Array, Array] = (steps[0], places[0], places[0])
    lost: dict[int, float] = {}
    for found in pieces_of(parts, criterion or Isolated(along)):
        for since in found.lost:
            member = int(owner[int(since)])
            lost[member] = min(lost.get(member, math.inf), since - float(firsts[member]))
        step, place = found.stations(found.reach >= np.abs(found.middle))
        own = (step, place, along(step, place))
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
        root, at = place[first].copy(), step[first].copy()
        if left.size:
            root[inside] = bracketed_roots(
                along, step[left], place[left], place[right], value[left], value[right]
            )
        # the value is zero there, or its sign changes by round-off between two steps
        between = np.minimum(first + 1, second)[~inside]
        at[~inside], root[~inside] = step[between], place[between]
        steps.append(at)
        places.append(root)
        kept = signed[-1:]
        last = (step[kept], place[kept], value[kept])
    return np.concatenate(steps), np.concatenate(places), lost


def first_below(along: FormulaAlong, level: float) -> tuple[float, float, float, float] | None:
    """Where a function along one step first falls below a level -c under 0; None: nowhere.

    Returns
    -------
    tuple or None
        Places of the last value above c before it, of the value below -c, of the root between the
        two; and that value. The first and the last place are 0 where no value before is above c.
    """
    (found,) = pieces_of(parts_of(0, 1), Isolated(along))
    step, place = found.stations(found.middle - found.reach < level)
    value = along(step, place)
    low = np.flatnonzero(value < level)
    if not low.size:
        return None
    first = int(low[0])
    high = np.flatnonzero(value[:first] > -level)
    if not high.size:
        return 0.0, float(place[first]), 0.0, float(value[first])
    last = int(high[-1])
    ends = [place[[last]], place[[first]], value[[last]], value[[first]]]
    root = bracketed_roots(along, step[:1], *ends)
    return float(place[last]), float(place[first]), float(root[0]), float(value[first])
