"""Formulas along motions: their values, roots and extremes between all points.

On every piece of a step (a whole one, or a part) the formula is interpolated in 17 Chebyshev
points, and the piece is halved where the polynomial is not resolved. The extremes of the
polynomials are eigenvalues; between two neighbours among them and the ends of the pieces the
formula is monotone, so that a change of sign encloses exactly one root (Boyd, *Solving
Transcendental Equations*, SIAM 2014, sections 2 and 3).

All steps are numbered in one row: first those of the first member, then those of the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.trajectory import Extent
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.chebyshev import (
    products_of_series,
    roots_of_series,
    second_kind_points,
    slopes_of_series,
    to_coefficients,
)
from fvi_cli.mathematics.expressions import Expression, slopes_of

Values = Mapping[str, Array | float]
Variables = Callable[[Places, Array], Values]
"""From steps and places to the variables of a formula: numbers, or arrays in the shape of these."""

POINTS = 17  # Chebyshev points of a piece
AT_A_TIME = 2048  # steps that are divided together
AT_ONCE = 2**15  # most places whose variables are held at once
DECAY = 1e-9  # a piece is resolved if its last coefficients are at most this share of the largest
MOST_HALVINGS = 10  # below: a kink
MOST_PIECES = 2**17  # as many as the steps that are divided together have after six halvings
ULPS = 8 * 2.0**-52  # relative round-off of every variable

_NODES = second_kind_points(POINTS)
_TO_COEFFICIENTS = to_coefficients(_NODES).T.copy()
_SLOPES, _PRODUCTS = slopes_of_series(POINTS), products_of_series(POINTS)


@dataclass(frozen=True, eq=False)
class FormulaAlong:
    """A formula along the motions of members."""

    expression: Expression
    variables: Variables

    def __call__(self, steps: Places, tau: Array) -> Array:
        """Values at places: steps and tau ``(n,)``, or ``(n, 1)`` and ``(n, k)``."""
        values = np.empty(tau.shape)
        for own in self._slices(tau):
            values[own] = self._values(tau[own], self.variables(steps[own], tau[own]))
        return values

    def with_noise(self, steps: Places, tau: Array) -> tuple[Array, Array]:
        """Values at k places in each step, ``(n, k)``, and their round-off there, ``(n,)``.

        The round-off is how far a value moves where each variable moves by its own.
        """
        values, noise, middle = np.empty(tau.shape), np.zeros(len(tau)), tau.shape[1] // 2
        for own in self._slices(tau):
            variables = self.variables(steps[own], tau[own])
            values[own] = self._values(tau[own], variables)
            alone = {
                name: np.broadcast_to(one, tau[own].shape)[:, middle] if np.ndim(one) else one
                for name, one in variables.items()
            }
            with np.errstate(all="ignore"):
                for name, slope in slopes_of(self.expression, alone, alone).items():
                    noise[own] += ULPS * np.abs(slope * alone[name])
        return values, np.where(np.isfinite(noise), noise, 0.0)

    def _slices(self, tau: Array) -> Iterator[slice]:
        """So many places at a time that variables take little memory."""
        count = max(AT_ONCE // max(tau[:1].size, 1), 1)
        return (slice(first, first + count) for first in range(0, len(tau), count))

    def _values(self, tau: Array, variables: Values) -> Array:
        return np.array(np.broadcast_to(self.expression.evaluate(variables), tau.shape))


class Pieces(NamedTuple):
    """Pieces of steps with the values of a formula in their Chebyshev points."""

    step: Places  # (n,), ascending
    begin: Array  # places in the step, (n,)
    end: Array
    values: Array  # at the Chebyshev points of the second kind, (n, POINTS)
    coefficients: Array  # of the Chebyshev polynomials, (n, POINTS)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Bounds on the polynomials, ``(n,)`` each."""
        middle, reach = self.coefficients[:, 0], np.abs(self.coefficients[:, 1:]).sum(axis=1)
        return middle - reach, middle + reach

    @property
    def squares(self) -> Array:
        """Integrals of the squared polynomials, in parts of a step, ``(n,)``."""
        product = np.matmul(self.coefficients, _PRODUCTS)
        return np.asarray(0.5 * (self.end - self.begin) * (product * self.coefficients).sum(axis=1))

    def stations(self, along: FormulaAlong, wanted: Mask) -> tuple[Places, Array, Array]:
        """Ends of pieces and extremes of the wanted ones: step, place in it, and value there."""
        piece, inside = roots_of_series(np.matmul(self.coefficients[wanted], _SLOPES))
        own = np.flatnonzero(wanted)[piece]
        begin, end = self.begin[own], self.end[own]
        step = np.concatenate([self.step, self.step, self.step[own]])
        within = begin + 0.5 * (inside + 1.0) * (end - begin)
        place = np.concatenate([self.begin, self.end, within])
        order = np.lexsort((place, step))
        step, place = step[order], place[order]
        return step, place, along(step, place)


def divide(along: FormulaAlong, steps: Places, ends: Array | None = None) -> Iterator[Pieces]:
    """Pieces of steps, ascending, on which a formula is resolved, or which are as short as a kink.

    Steps end at the places `ends`, by default 1.
    """
    ends = np.ones(steps.size) if ends is None else ends
    for first in range(0, steps.size, AT_A_TIME):
        step, end = steps[first : first + AT_A_TIME], ends[first : first + AT_A_TIME]
        begin, done = np.zeros(step.size), []
        for depth in range(MOST_HALVINGS + 1):
            tau = begin[:, None] + 0.5 * (_NODES + 1.0) * (end - begin)[:, None]
            tau[:, -1] = end
            values, noise = along.with_noise(step[:, None], tau)
            # a single point without a value, such as t = 0, is no reason to halve
            coefficients = np.where(np.isfinite(values), values, 0.0) @ _TO_COEFFICIENTS
            size = np.abs(coefficients)
            rough = size[:, -2:].max(axis=1) > np.maximum(DECAY * size.max(axis=1), noise)
            if depth == MOST_HALVINGS or 2 * np.count_nonzero(rough) > MOST_PIECES:
                rough[:] = False
            kept = ~rough
            done.append((step[kept], begin[kept], end[kept], values[kept], coefficients[kept]))
            if not rough.any():
                break
            middle = 0.5 * (begin[rough] + end[rough])
            begin = np.stack([begin[rough], middle], axis=1).ravel()
            end = np.stack([middle, end[rough]], axis=1).ravel()
            step = np.repeat(step[rough], 2)
        columns = [np.concatenate(one) for one in zip(*done, strict=True)]
        order = np.lexsort((columns[1], columns[0]))
        step, begin, end, values, coefficients = (one[order] for one in columns)
        yield Pieces(step, begin, end, values, coefficients)


def find_events(along: FormulaAlong, owner: Places, direction: str) -> tuple[Places, Array]:
    """Step and place in it of every change of sign, in the order of steps.

    `owner` is the member of every step; directions are ``any``, ``rising`` and ``falling``. Between
    neighbours among ends and extremes there is at most one root, so that both roots of a step with
    two are found. If the value is zero at an end, or changes its sign from one step to the next,
    the root is there.
    """
    found = []
    for one in divide(along, np.arange(owner.size)):
        low, high = one.bounds
        found.append(one.stations(along, (low <= 0.0) & (high >= 0.0)))
    step, place, value = (np.concatenate(one) for one in zip(*found, strict=True))
    # values at the start of a run that are round-off are zero
    starts = np.flatnonzero((place == 0.0) & np.insert(np.diff(owner) != 0, 0, True)[step])
    first, noise = along.with_noise(step[starts, None], place[starts, None])
    value[starts[np.abs(first[:, 0]) <= noise]] = 0.0
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
        from scipy.optimize.elementwise import find_root

        a, ends = left[inside], (place[left[inside]], place[right[inside]])
        solve: Any = find_root  # its stubs know no arguments
        within = solve(lambda tau, k: along(k, tau), ends, args=(step[a],))
        # where a sign was round-off there is no bracket
        roots[inside] = np.where(within.success, within.x, place[a])
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
    (found,) = divide(along, np.zeros(1, dtype=np.intp))
    step, place, value = found.stations(along, found.bounds[0] < -round_off)
    low = np.flatnonzero(value < -round_off)
    if not low.size:
        return None
    first = int(low[0])
    high = np.flatnonzero(value[:first] > round_off)
    if not high.size:
        return Fall(0.0, 0.0, float(place[first]))
    last = int(high[-1])
    from scipy.optimize import brentq

    top, below = float(place[last]), float(place[first])
    root = brentq(lambda tau: along(step[:1], np.array([tau]))[0], top, below, xtol=ULPS)
    return Fall(float(root), top, below)


def find_extents(motion: Motion, along: FormulaAlong, ends: Sequence[float]) -> list[Extent]:
    """Extents of a formula for every member, up to a time of its own."""
    q, size, ending = len(motion.scenes), motion.step_size, np.asarray(ends)[motion.owner]
    steps = np.flatnonzero(motion.begin < ending)
    until = np.where(motion.end > ending, (ending - motion.begin) / size, 1.0)
    least, greatest = np.full(q, math.inf), np.full(q, -math.inf)
    square, length, every = np.zeros(q), np.zeros(q), []
    for found in divide(along, steps, until[steps]):
        owner, infinite = motion.owner[found.step], np.isinf(found.values)
        square += np.bincount(owner, size[found.step] * found.squares, minlength=q)
        # near an infinite value the integral of the square is not known
        square[owner[infinite.any(axis=1)]] = math.nan
        length += np.bincount(owner, size[found.step] * (found.end - found.begin), minlength=q)
        is_finite = np.isfinite(found.values)
        np.minimum.at(least, owner, np.where(is_finite, found.values, math.inf).min(axis=1))
        np.maximum.at(greatest, owner, np.where(is_finite, found.values, -math.inf).max(axis=1))
        low, high = found.bounds
        step, place, value = found.stations(along, (low < least[owner]) | (high > greatest[owner]))
        kept = ~np.isnan(value)
        every.append((step[kept], place[kept], value[kept]))
    step, place, value = (np.concatenate(one) for one in zip(*every, strict=True))
    edges = np.searchsorted(motion.owner[step], np.arange(1, q))
    extents = []
    for k, own in enumerate(np.split(np.arange(step.size), edges)):
        if not own.size:
            extents.append(Extent())
            continue
        values = value[own]
        lowest, highest = float(values.min()), float(values.max())
        peak = max(-lowest, highest)
        at = own[[int((values if peak == highest else -values).argmax())]]
        extents.append(
            Extent(
                peak=peak,
                peak_time=float(motion.time(step[at], place[at])[0]),
                least=lowest,
                greatest=highest,
                rms=math.sqrt(max(square[k], 0.0) / length[k]) if length[k] else peak,
            )
        )
    return extents
