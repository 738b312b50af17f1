"""Roots of a formula along a motion, isolated by its range as well as by its values.

A piece of a step is halved until the range of the formula over the boxes of its variables, by
interval arithmetic, excludes zero, or is no wider than that of its polynomial, or shrinks with the
piece (Moore, Kearfott, Cloud, *Introduction to Interval Analysis*, SIAM 2009, section 8.1). So
pulses and waves between all samples are met, however long the steps are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.observations.pieces import (
    AT_A_TIME,
    DECAY,
    POINTS,
    TO_COEFFICIENTS,
    Columns,
    Pieces,
    bracketed_roots,
    coefficients_of,
    halve,
    join_in_order,
    may_change_sign,
    may_exceed,
    places_in,
    stations,
)
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import INTERVAL_FUNCTIONS
from fvi_cli.mathematics.intervals.interval import Interval

Variables = Callable[[Places, Array], Mapping[str, Array | float]]
"""The variables of a formula there, by name, numbers or of shape ``(n,)``."""

MOST_BISECTIONS = 40
MOST_PIECES = 2**17
"""Pieces of these steps of one length; where there would be more, roots may be missing."""
TIGHT = 1.1
"""Ranges up to so many times that of the polynomial of a piece hide nothing."""
SHRINKAGE, SHRINKS = 0.6, 3
"""Ranges that so often shrink to this share with half of the piece are overestimates only."""
ROUND_OFF = 1e-14
"""Relative to the largest value; narrower ranges are told from nothing."""
ULPS = 4 * 2.0**-52
"""By so much of its size every variable may be off."""


@dataclass(frozen=True, eq=False)
class FormulaAlong:
    """A formula along a motion.

    Parameters
    ----------
    expression, variables
        The formula, and its variables at places of steps.
    """

    expression: Expression
    variables: Variables

    def __call__(self, steps: Places, tau: Array) -> Array:
        """Values at places of steps, shape ``(n,)``."""
        return self._values(self.variables(steps, tau), steps.shape)

    def _values(self, variables: Mapping[str, Array | float], shape: tuple[int, ...]) -> Array:
        found = self.expression.evaluate(variables, NUMPY_FUNCTIONS)
        return np.broadcast_to(np.asarray(found, dtype=float), shape)

    def enclosed(self, steps: Places, tau: Array) -> tuple[Array, Interval, Array]:
        """Values at the Chebyshev points of pieces, ranges over them, and round-off of the values.

        Parameters
        ----------
        steps, tau
            Shapes ``(n * POINTS,)`` and ``(n, POINTS)``.
        """
        variables = self.variables(steps, tau.ravel())
        boxes: dict[str, Interval | float] = {}
        points: dict[str, Interval | float] = {}
        for name in self.expression.names:
            values = variables[name]
            if np.ndim(values) == 0:
                boxes[name] = points[name] = float(values)
                continue
            columns = np.reshape(values, tau.shape)
            boxes[name] = _box(columns)
            middle = columns[:, POINTS // 2]
            off = ULPS * np.abs(middle)
            points[name] = Interval(middle - off, middle + off)
        values = self._values(variables, steps.shape).reshape(tau.shape)
        noise = _width(self._range(points, len(tau)))
        return values, self._range(boxes, len(tau)), np.where(np.isfinite(noise), noise, 0.0)

    def _range(self, boxes: Mapping[str, Interval | float], n: int) -> Interval:
        with np.errstate(all="ignore"):
            found = self.expression.evaluate(boxes, INTERVAL_FUNCTIONS)
        if not isinstance(found, Interval):
            return Interval(np.full(n, found), np.full(n, found))
        low = np.where(np.isnan(found.low), -math.inf, found.low)
        return Interval(low, np.where(np.isnan(found.high), math.inf, found.high))


def _width(found: Interval) -> Array:
    """Length of ranges; inf where both ends are infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(found.width), math.inf, found.width)


def _box(values: Array) -> Interval:
    """Range of the polynomials through Chebyshev points, shape ``(n, POINTS)`` to ``(n,)``."""
    coefficients = values @ TO_COEFFICIENTS
    middle, reach = coefficients[:, 0], np.abs(coefficients[:, 1:]).sum(axis=1)
    with np.errstate(invalid="ignore"):
        return Interval(
            np.where(np.isnan(middle), -math.inf, middle - reach),
            np.where(np.isnan(middle), math.inf, middle + reach),
        )


def isolating_pieces_of(along: FormulaAlong, n_steps: int) -> Iterator[tuple[Pieces, float]]:
    """Pieces of steps on each of which a formula has the roots of its polynomial.

    With every group of pieces comes the number of the step, and the place in it as a fraction,
    from which on roots may be missing, since the formula changes too fast; inf: none.
    """
    for first in range(0, n_steps, AT_A_TIME):
        step = np.arange(first, min(first + AT_A_TIME, n_steps))
        begin, end = np.zeros(step.size), np.ones(step.size)
        width, shrinks = np.full(step.size, math.inf), np.zeros(step.size)
        largest, lost = 0.0, math.inf
        done: list[Columns] = []
        for depth in range(MOST_BISECTIONS + 1):
            tau = places_in(begin, end)
            values, found, noise = along.enclosed(np.repeat(step, POINTS), tau)
            coefficients = coefficients_of(values)
            size = np.abs(coefficients)
            finite = np.where(np.isfinite(values), np.abs(values), 0.0)
            largest = max(largest, float(finite.max(initial=0.0)))
            tail = size[:, -2:].max(axis=1)
            is_settled = (tail <= DECAY * size.max(axis=1)) | (tail <= noise)
            is_settled &= np.isfinite(values[:, 1:-1]).all(axis=1)
            before, width = width, _width(found)
            shrinks = np.where(width <= SHRINKAGE * before, shrinks + 1, 0)
            is_told = width <= TIGHT * 2.0 * size[:, 1:].sum(axis=1)
            rough = (found.low <= 0.0) & (found.high >= 0.0)
            rough &= ~(is_settled & (is_told | (shrinks >= SHRINKS)))
            rough &= ~(width <= np.maximum(ROUND_OFF * largest, 4.0 * noise))
            if rough.any() and 2 * int(rough.sum()) > MOST_PIECES:
                at = int(np.flatnonzero(rough)[0])
                lost = float(step[at] + begin[at])
                # of these only the ends count
                coefficients[rough] = np.eye(POINTS)[0]
                rough[:] = False
            if depth == MOST_BISECTIONS:
                rough[:] = False
            smooth = ~rough
            done.append(
                (step[smooth], begin[smooth], end[smooth], values[smooth], coefficients[smooth])
            )
            if not rough.any():
                break
            step, begin, end = halve(step, begin, end, rough)
            width, shrinks = np.repeat(width[rough], 2), np.repeat(shrinks[rough], 2)
        yield join_in_order(done), lost


def event_places(along: FormulaAlong, n_steps: int, direction: str) -> tuple[Places, Array, float]:
    """Step and place in it of every change of sign, in the order of time.

    Behind them stands from which step on, with the place in it as a fraction, some may be missing.

    Between neighbours among ends and extremes there is one root at most, so none is lost where a
    step has two. Where the value is zero at an end, or changes from one step to the next, the
    root is there.
    """
    steps, places = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    carried: tuple[Places, Array, Array] = (steps[0], places[0], places[0])
    lost = math.inf
    for found, since in isolating_pieces_of(along, n_steps):
        lost = min(lost, since)
        step, place = stations(found, may_change_sign(found))
        own = (step, place, along(step, place))
        step, place, value = (np.concatenate(pair) for pair in zip(carried, own, strict=True))
        signed = np.flatnonzero(np.isfinite(value) & (value != 0.0))
        first, second = signed[:-1], signed[1:]
        sign = np.sign(value)
        turns = sign[first] != sign[second]
        if direction != "any":
            turns &= sign[second] == (1.0 if direction == "rising" else -1.0)
        first, second = first[turns], second[turns]
        inside = (step[first] == step[second]) & (second == first + 1)
        left, right = first[inside], second[inside]
        root = place[first].copy()
        at = step[first].copy()
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
        carried = (step[kept], place[kept], value[kept])
    return np.concatenate(steps), np.concatenate(places), lost


def first_below(along: FormulaAlong, level: float) -> tuple[float, float, float, float] | None:
    """Where a function along one step first falls below a level -c under 0; None: nowhere.

    Returns
    -------
    tuple or None
        Places of the last value above c before it, of the value below -c, of the root between the
        two; and that value. The first and the last place are 0 where no value before is above c.
    """
    for found, _ in isolating_pieces_of(along, 1):
        step, place = stations(found, may_exceed(found, level, math.inf))
        value = along(step, place)
        low = np.flatnonzero(value < level)
        if not low.size:
            return None
        first = int(low[0])
        high = np.flatnonzero(value[:first] > -level)
        if not high.size:
            return 0.0, float(place[first]), 0.0, float(value[first])
        last = int(high[-1])
        both = np.array([last]), np.array([first])
        root = bracketed_roots(
            along, step[:1], place[both[0]], place[both[1]], value[both[0]], value[both[1]]
        )
        return float(place[last]), float(place[first]), float(root[0]), float(value[first])
    return None
