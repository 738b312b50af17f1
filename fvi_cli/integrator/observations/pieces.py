"""A function along a motion, in pieces on each of which a polynomial replaces it.

On every piece (a step, or a part of one) the function is interpolated in Chebyshev points. A
criterion, see :mod:`~fvi_cli.integrator.observations.formulas`, says which pieces are halved. The
extremes of the polynomials are eigenvalues; between two neighbours among them and the ends of the
pieces the function is monotone, so that a change of sign encloses exactly one root, and two roots
in a step are two changes (Boyd, *Solving Transcendental Equations*, SIAM 2014, sections 2 and 3).

All steps are numbered in one row: first those of the first member, then those of the next. No
decision on a member depends on others.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.series.chebyshev import (
    products_of_series,
    roots_of_series,
    second_kind_points,
    slopes_of_series,
    to_coefficients,
)

Along = Callable[[Places, Array], Array]
"""Values at places of steps, both ``(n,)``, or at k places in each, ``(n, 1)`` and ``(n, k)``."""

POINTS = 17
"""Chebyshev points of a piece."""
AT_A_TIME = 2048
"""Most steps in a part of a member, and most steps of all members that are computed together."""
MOST_PIECES = 2**17
"""Most pieces of one length of a part; if more are needed, features may be missed."""

_NODES = second_kind_points(POINTS)
_TO_COEFFICIENTS = to_coefficients(_NODES).T.copy()
_SLOPES, _PRODUCTS = slopes_of_series(POINTS), products_of_series(POINTS)


class StepPart(NamedTuple):
    """Successive steps of one member."""

    first: int
    last: int  # number after the last step
    end: float = 1.0  # place in the last step at which the part ends


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """Pieces of steps with the values of a function in their Chebyshev points."""

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

    def stations(self, along: Along, wanted: Mask) -> tuple[Places, Array, Array]:
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


class Criterion(Protocol):
    """Samples a function on pieces and says which of them are halved."""

    def __call__(
        self, depth: int, step: Places, tau: Array, part: Places
    ) -> tuple[Array, Array, Mask]:
        """Values, coefficients, and the pieces to be halved.

        After `depth` halvings the pieces have the steps ``(n,)``, Chebyshev points ``(n, POINTS)``
        and numbers of their parts ``(n,)``.
        """


def parts_of(first: int, count: int, end: float = 1.0) -> list[StepPart]:
    """The parts of `count` steps of a member from the step `first` on."""
    edges = [*range(first, first + count, AT_A_TIME), first + count]
    found = [StepPart(a, b) for a, b in itertools.pairwise(edges)]
    return [*found[:-1], *(one._replace(end=end) for one in found[-1:])]


def pieces_of(parts: Sequence[StepPart], criterion: Criterion) -> Iterator[Pieces]:
    """The pieces of all parts, some parts at a time, in their order."""
    first, steps = 0, 0
    for index, one in enumerate(parts):
        if steps and steps + one.last - one.first > AT_A_TIME:
            yield from _divided(parts[first:index], criterion)
            first, steps = index, 0
        steps += one.last - one.first
    yield from _divided(parts[first:], criterion)


def _divided(parts: Sequence[StepPart], criterion: Criterion) -> Iterator[Pieces]:
    """The pieces of parts; where there are too many, of one part after the other."""
    if not parts:
        return
    step = np.concatenate([np.arange(one.first, one.last) for one in parts])
    sizes = [one.last - one.first for one in parts]
    part = np.repeat(np.arange(len(parts)), sizes)
    begin, end = np.zeros(step.size), np.ones(step.size)
    end[np.cumsum(sizes) - 1] = [one.end for one in parts]
    done: list[tuple[NDArray[np.generic], ...]] = []
    depth = 0
    while step.size:
        tau = begin[:, None] + 0.5 * (_NODES + 1.0) * (end - begin)[:, None]
        tau[:, -1] = end
        values, coefficients, rough = criterion(depth, step, tau, part)
        count = int(np.count_nonzero(rough))
        if 2 * count > MOST_PIECES:
            if len(parts) > 1:
                for one in parts:
                    yield from _divided([one], criterion)
                return
            # of these pieces only the ends are used
            coefficients[rough] = np.eye(POINTS)[0]
            rough[:] = False
        kept = ~rough
        done.append((step[kept], begin[kept], end[kept], values[kept], coefficients[kept]))
        middle = 0.5 * (begin[rough] + end[rough])
        begin = np.stack([begin[rough], middle], axis=1).ravel()
        end = np.stack([middle, end[rough]], axis=1).ravel()
        step, part = np.repeat(step[rough], 2), np.repeat(part[rough], 2)
        depth += 1
    columns = [np.concatenate(one) for one in zip(*done, strict=True)]
    order = np.lexsort((columns[1], columns[0]))
    step, begin, end, values, coefficients = (one[order] for one in columns)
    yield Pieces(step=step, begin=begin, end=end, values=values, coefficients=coefficients)


def by_owner(owner: Places, steps: Places, count: int) -> list[tuple[int, Places | slice]]:
    """The members, of `count`, that own some of the steps, and which steps they own."""
    if count == 1:
        return [(0, slice(None))]
    members, inverse = np.unique(owner[steps.ravel()], return_inverse=True)
    order = np.argsort(inverse, kind="stable")
    ends = np.cumsum(np.bincount(inverse))[:-1]
    return list(zip(members.tolist(), np.split(order, ends), strict=True))


def coefficients_of(values: Array) -> Array:
    """Chebyshev coefficients of values, both of shape ``(n, POINTS)``."""
    # a single point without a value, such as t = 0, is no reason to halve
    return np.asarray(np.where(np.isfinite(values), values, 0.0) @ _TO_COEFFICIENTS)
