"""Formulas along motions, in pieces on each of which a polynomial replaces the formula.

On every piece (a step, or a part of one) the formula is interpolated in 17 Chebyshev points, and
the piece is halved where the polynomial is not resolved. The extremes of the polynomials are
eigenvalues; between two neighbours among them and the ends of the pieces the formula is monotone,
so that a change of sign encloses exactly one root (Boyd, *Solving Transcendental Equations*, SIAM
2014, sections 2 and 3).

All steps are numbered in one row: first those of the first member, then those of the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.chebyshev import (
    products_of_series,
    roots_of_series,
    second_kind_points,
    slopes_of_series,
    to_coefficients,
)
from fvi_cli.mathematics.expressions import Expression

Values = Mapping[str, Array | float]
Variables = Callable[[Places, Array, bool], Values]
"""From steps and places, and whether these are starts of runs, to the variables of a formula:
numbers, or arrays in the shape of the places."""

POINTS = 17  # Chebyshev points of a piece
AT_A_TIME = 2048  # steps that are divided together
AT_ONCE = 2**20  # most numbers that are held for the variables of a formula
DECAY = 1e-9  # a piece is resolved if its last coefficients are at most this share of the largest
MOST_HALVINGS = {"extremes": 6, "roots": 40}  # below: a kink; or round-off of the place
MOST_PIECES = 2**17  # as many as the steps that are divided together have after six halvings
FAR = 4.0  # a polynomial whose mean is more than so many times its reach has no root
ULPS = 4 * 2.0**-52  # relative round-off of every variable

_NODES = second_kind_points(POINTS)
_TO_COEFFICIENTS = to_coefficients(_NODES).T.copy()
_SLOPES, _PRODUCTS = slopes_of_series(POINTS), products_of_series(POINTS)


@dataclass(frozen=True, eq=False)
class FormulaAlong:
    """A formula along the motions of members."""

    expression: Expression
    variables: Variables
    # parameters of the members of steps, which have no round-off
    parameters: Callable[[Places], Values] = lambda steps: {}
    width: int = 1  # numbers that are held for every place

    def __call__(self, steps: Places, tau: Array) -> Array:
        """Values at places: steps and tau ``(n,)``, or ``(n, 1)`` and ``(n, k)``."""
        return self._evaluate(steps, tau)[0]

    def with_noise(self, steps: Places, tau: Array) -> tuple[Array, Array]:
        """Values at k places in each step, ``(n, k)``, and their round-off there, ``(n,)``."""
        return self._evaluate(steps, tau, has_noise=True)

    def at_starts(self, steps: Places) -> tuple[Array, Array]:
        """Values at the start of runs, by their first steps, and their round-off, ``(n,)``."""
        tau = np.zeros(steps.size)
        variables = self.variables(steps, tau, True)
        return self._values(steps, tau, variables), self._noise(steps, tau, variables)

    def _evaluate(
        self, steps: Places, tau: Array, *, has_noise: bool = False
    ) -> tuple[Array, Array]:
        """Values and round-off, of so many places at a time that variables take little memory."""
        values, noise = np.empty(tau.shape), np.zeros(len(tau))
        count = max(AT_ONCE // (max(self.width, 1) * max(tau[:1].size, 1)), 1)
        for first in range(0, len(tau), count):
            own = slice(first, first + count)
            variables = self.variables(steps[own], tau[own], False)
            values[own] = self._values(steps[own], tau[own], variables)
            if has_noise:
                middle = tau.shape[1] // 2
                alone = {
                    name: np.broadcast_to(one, tau[own].shape)[:, middle] if np.ndim(one) else one
                    for name, one in variables.items()
                }
                noise[own] = self._noise(steps[own, 0], tau[own, middle], alone)
        return values, noise

    def _values(self, steps: Places, tau: Array, variables: Values) -> Array:
        found = self.expression.evaluate({**self.parameters(steps), **variables})
        return np.array(np.broadcast_to(found, tau.shape))

    def _noise(self, steps: Places, tau: Array, variables: Values) -> Array:
        """How far values move where each variable moves by its round-off."""
        noise = np.zeros(tau.shape)
        with np.errstate(all="ignore"):
            at = self._values(steps, tau, variables)
            for name in self.expression.names & variables.keys():
                for factor in (1.0 - ULPS, 1.0 + ULPS):
                    moved = {**variables, name: variables[name] * factor}
                    noise += np.abs(self._values(steps, tau, moved) - at)
        return np.where(np.isfinite(noise), noise, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Pieces of steps with the values of a formula in their Chebyshev points."""

    step: Places  # (n,), ascending
    begin: Array  # places in the step, (n,)
    end: Array
    values: Array  # at the Chebyshev points of the second kind, (n, POINTS)
    coefficients: Array  # of the Chebyshev polynomials, (n, POINTS)

    @property
    def middle(self) -> Array:
        """Means of the polynomials in the Chebyshev weight, ``(n,)``."""
        return self.coefficients[:, 0]

    @property
    def reach(self) -> Array:
        """Bound on the difference of the polynomials from `middle`, ``(n,)``."""
        return np.asarray(np.abs(self.coefficients[:, 1:]).sum(axis=1))

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


def divide(
    along: FormulaAlong, steps: Places, ends: Array | None = None, *, sought: str = "extremes"
) -> Iterator[Pieces]:
    """Pieces of steps, ascending, in which ``extremes`` or ``roots`` are sought.

    Steps end at the places `ends`, by default 1.
    """
    ends = np.ones(steps.size) if ends is None else ends
    for first in range(0, steps.size, AT_A_TIME):
        own = slice(first, first + AT_A_TIME)
        yield _divided(along, steps[own], ends[own], sought)


def _divided(along: FormulaAlong, step: Places, end: Array, sought: str) -> Pieces:
    begin, done = np.zeros(step.size), []
    for depth in range(MOST_HALVINGS[sought] + 1):
        tau = begin[:, None] + 0.5 * (_NODES + 1.0) * (end - begin)[:, None]
        tau[:, -1] = end
        values, noise = along.with_noise(step[:, None], tau)
        # a single point without a value, such as t = 0, is no reason to halve
        coefficients = np.where(np.isfinite(values), values, 0.0) @ _TO_COEFFICIENTS
        size = np.abs(coefficients)
        rough = size[:, -2:].max(axis=1) > np.maximum(DECAY * size.max(axis=1), noise)
        if sought == "roots":
            rough &= size[:, 0] <= FAR * size[:, 1:].sum(axis=1)
        if depth == MOST_HALVINGS[sought] or 2 * np.count_nonzero(rough) > MOST_PIECES:
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
    return Pieces(step=step, begin=begin, end=end, values=values, coefficients=coefficients)
