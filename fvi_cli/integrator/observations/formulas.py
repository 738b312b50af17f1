"""Formulas along a motion, and when a polynomial may replace one on a piece of a step.

To integrate a formula and to find its extremes, its polynomial must be resolved. To find its roots,
no root may be hidden: a piece is halved until the range of the formula over the boxes of its
variables, by interval arithmetic, excludes zero, or is no wider than that of its polynomial, or
shrinks with the piece (Moore, Kearfott, Cloud, *Introduction to Interval Analysis*, SIAM 2009,
section 8.1). So pulses and waves between samples are found, however long the steps are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fvi_cli.integrator.observations.pieces import (
    POINTS,
    Along,
    by_owner,
    coefficients_of,
)
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import Interval

Variables = Callable[[Places, Array], Mapping[str, Array | float]]
"""From steps and places to a formula's variables by name: numbers, or in the shape of places."""

DECAY = 1e-9
"""A piece is resolved if its last coefficients are at most this, relative to the largest."""
LEAST_HALVINGS, MOST_HALVINGS, MOST_BISECTIONS = 4, 7, 40  # of a piece: Resolved, and Isolated
TIGHT = 1.1
"""A range up to this many times that of the polynomial of a piece hides no root."""
SHRINKAGE, SHRINKS = 0.6, 3
"""A range that shrinks to this share 3 times, with halves of the piece, is only an overestimate."""
ROUND_OFF = 1e-14
"""Relative to the largest value; pieces with narrower ranges are not halved."""
ULPS = 4 * 2.0**-52
"""Relative round-off of every variable."""


@dataclass(frozen=True, eq=False)
class FormulaAlong:
    """A formula along a motion."""

    expression: Expression
    variables: Variables
    constants: Sequence[Mapping[str, float]] = ({},)  # of every member; one for all of them
    owner: Places | None = None  # member of every step, (N,), where constants are more than one

    def __call__(self, steps: Places, tau: Array) -> Array:
        """Values at places of steps."""
        return self._values(steps, tau, self.variables(steps, tau))

    def _values(self, steps: Places, tau: Array, variables: Mapping[str, Array | float]) -> Array:
        found = np.empty(tau.shape)
        for chosen, value in self._by_constants(steps, variables):
            found[chosen] = value
        return found

    def _by_constants(
        self, steps: Places, variables: Mapping[str, Any]
    ) -> Iterator[tuple[Places | slice, Any]]:
        """Places that share constants, and the value there, on any algebra."""
        groups: list[tuple[int, Places | slice]] = [(0, slice(None))]
        if len(self.constants) > 1 and self.owner is not None:
            groups = by_owner(self.owner, steps, len(self.constants))
        for member, chosen in groups:
            own = {name: _at(one, chosen) for name, one in variables.items()}
            yield chosen, self.expression.evaluate({**self.constants[member], **own})

    def enclosed(self, steps: Places, tau: Array) -> tuple[Array, Interval, Array]:
        """Values at the Chebyshev points of pieces, ranges over them, and round-off of the values.

        Steps are ``(n,)``, their places ``(n, POINTS)``.
        """
        variables = self.variables(steps[:, None], tau)
        values = self._values(steps, tau, variables)
        boxes: dict[str, Interval | float] = {}
        middles: dict[str, Array | float] = {}
        for name in self.expression.names & set(variables):
            one = variables[name]
            if np.ndim(one) == 0:
                boxes[name] = middles[name] = float(one)
                continue
            columns = np.broadcast_to(one, tau.shape)
            boxes[name], middles[name] = _box(columns), columns[:, POINTS // 2]
        return values, self._range(steps, boxes), self._noise(steps, middles)

    def round_off(self, steps: Places, tau: Array) -> Array:
        """Bound on the round-off of values at places, ``(n,)``."""
        return self._noise(steps, self.variables(steps, tau))

    def _noise(self, steps: Places, variables: Mapping[str, Array | float]) -> Array:
        """Round-off of the values by round-off of the variables."""
        boxes: dict[str, Interval | float] = {
            name: one if isinstance(one, float) else _around(np.asarray(one))
            for name, one in variables.items()
        }
        width = interval_length(self._range(steps, boxes))
        return np.where(np.isfinite(width), width, 0.0)

    def _range(self, steps: Places, boxes: Mapping[str, Interval | float]) -> Interval:
        low, high = np.empty(steps.size), np.empty(steps.size)
        with np.errstate(all="ignore"):
            for chosen, value in self._by_constants(steps, boxes):
                is_range = isinstance(value, Interval)
                low[chosen], high[chosen] = (value.low, value.high) if is_range else (value, value)
        return Interval(
            np.where(np.isnan(low), -math.inf, low), np.where(np.isnan(high), math.inf, high)
        )


def _around(values: Array) -> Interval:
    off = ULPS * np.abs(values)
    return Interval(values - off, values + off)


def _at(one: Any, chosen: Places | slice) -> Any:
    if isinstance(one, Interval):
        return Interval(one.low[chosen], one.high[chosen])
    return one[chosen] if np.ndim(one) else one


def interval_length(found: Interval) -> Array:
    """Length of ranges; inf where both ends are infinite."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isnan(found.width), math.inf, found.width)


def _box(values: Array) -> Interval:
    """Range of the polynomials through Chebyshev points, shape ``(n, POINTS)`` to ``(n,)``."""
    finite = np.isfinite(values).all(axis=1)
    coefficients = coefficients_of(values)
    middle, reach = coefficients[:, 0], np.abs(coefficients[:, 1:]).sum(axis=1)
    return Interval(
        np.where(finite, middle - reach, -math.inf), np.where(finite, middle + reach, math.inf)
    )


class Resolved:
    """Criterion: the polynomial of a piece is resolved, or halving does not help (round-off)."""

    def __init__(self, along: Along) -> None:
        self._along = along
        self._before = np.zeros(0)

    def __call__(
        self, depth: int, step: Places, tau: Array, part: Places, carried: Array
    ) -> tuple[Array, Array, Mask, Array]:
        """As :class:`~fvi_cli.integrator.observations.pieces.Criterion`."""
        values = self._along(step[:, None], tau)
        coefficients = coefficients_of(values)
        size = np.abs(coefficients)
        rough = size[:, -2:].max(axis=1) > DECAY * size.max(axis=1)
        if depth == 0:
            self._before = np.bincount(part).astype(float)
        now = np.bincount(part[rough], minlength=self._before.size).astype(float)
        if depth >= LEAST_HALVINGS:
            rough &= ~(now > 1.8 * self._before)[part]
        self._before = now
        if depth == MOST_HALVINGS:
            rough[:] = False
        return values, coefficients, rough, carried


class Isolated:
    """Criterion: a piece has the roots of its polynomial and no others."""

    def __init__(self, along: FormulaAlong) -> None:
        self._along = along
        self._largest = np.zeros(0)

    def __call__(
        self, depth: int, step: Places, tau: Array, part: Places, carried: Array
    ) -> tuple[Array, Array, Mask, Array]:
        """As :class:`~fvi_cli.integrator.observations.pieces.Criterion`."""
        values, found, noise = self._along.enclosed(step, tau)
        coefficients = coefficients_of(values)
        size = np.abs(coefficients)
        if depth == 0:
            self._largest = np.zeros(int(part.max()) + 1)
        finite = np.where(np.isfinite(values), np.abs(values), 0.0).max(axis=1)
        np.maximum.at(self._largest, part, finite)
        tail = size[:, -2:].max(axis=1)
        is_resolved = (tail <= DECAY * size.max(axis=1)) | (tail <= noise)
        is_resolved &= np.isfinite(values[:, 1:-1]).all(axis=1)
        width, (before, shrinks) = interval_length(found), carried.T
        shrinks = np.where(width <= SHRINKAGE * before, shrinks + 1.0, 0.0)
        is_known = width <= TIGHT * 2.0 * size[:, 1:].sum(axis=1)
        rough = (found.low <= 0.0) & (found.high >= 0.0)
        rough &= ~(is_resolved & (is_known | (shrinks >= SHRINKS)))
        rough &= ~(width <= np.maximum(ROUND_OFF * self._largest[part], 4.0 * noise))
        if depth == MOST_BISECTIONS:
            rough[:] = False
        return values, coefficients, rough, np.stack([width, shrinks], axis=1)
