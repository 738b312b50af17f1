r"""Zeros of analytic functions: how many lie inside a contour.

By the argument principle (Henrici, *Applied and Computational Complex Analysis* 1, section 4.10)
it is :math:`\frac{1}{2 \pi i} \oint d \log f`. The functions are given by their logarithms, because
determinants overflow, and many of them that have much in common are followed together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers

LogFunction = Callable[[ComplexArray], ComplexArray]
"""Any branch of log f at points of shape ``(k,)``, minus infinity at a zero."""

Path = Callable[[Array], ComplexArray]

UNDECIDED = -1
"""In place of a count: a zero lies on the contour to round-off."""

USUAL_DEGREE = 8
"""Number of zeros that is assumed for the determinant of a few unknowns."""

PER_ZERO, PER_FACTOR = 4, 2
"""Initial points on half a circle: 4 for each zero; and for every two zeros one more for each
factor of 2 towards its ends, where the zeros of coupled systems gather for short steps. With these
no count differed from that of the eigenvalues for 10,000 random systems of 2 to 6 components by
explicit Euler (with 6, and one for each factor, 8 of 3,000 differed), and none from that with 4
times as many points for 970,000 points on maps of BDF4 to BDF6."""
LARGEST_CHANGE = 1.0
"""Largest change of log f between neighbouring points of a path. A smaller one finds more pairs of
zeros, but takes round-off for zeros where steps are as short as a millionth of the run."""
LARGEST_MISMATCH = 0.5
"""Largest difference between the change over an interval and the sum over its halves."""
DEEPEST = 48
"""Most halvings of an interval."""
MOST_PENDING = 2_000
"""Most intervals of one function that wait to be halved."""
VALUES_AT_ONCE = 500_000  # logarithms that are computed together


class Functions(Protocol):
    r"""Functions :math:`f_0, f_1, \dots` that depend on z in a common way."""

    @property
    def number(self) -> int:
        """How many functions there are."""

    @property
    def degree(self) -> int:
        """About how many zeros each function has in and around the contour."""

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """What all of them have in common at each z, shape ``(k, ...)``."""

    def logarithms(self, table: ComplexArray, rows: Integers, numbers: Integers) -> ComplexArray:
        """Any branch of log f; `rows` of the table and `numbers` of functions broadcast."""


@dataclass(frozen=True, eq=False)
class OneFunction:
    """A single function, as functions that depend on z in a common way."""

    log_function: LogFunction
    degree: int = USUAL_DEGREE
    number = 1

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """Its logarithms."""
        return self.log_function(z)

    def logarithms(self, table: ComplexArray, rows: Integers, numbers: Integers) -> ComplexArray:
        """Its logarithms again."""
        return np.asarray(table[np.broadcast_arrays(rows, numbers)[0]])


def changes_of_argument(functions: Functions, path: Path, parameters: Array) -> Array:
    r"""Changes of the arguments of functions along a path in radians, ``(q,)``.

    nan where a zero lies on the path to round-off.
    The path goes through the points of `parameters`, which increase. Intervals are halved until
    log f, its modulus included, changes by less than 1 over each half, and the changes of the
    halves add up to that between the ends. This finds close pairs of zeros, whose turn of
    :math:`2 \pi` would be overlooked otherwise. Each function has points where it needs them.
    """
    number = functions.number
    fine = np.empty(2 * parameters.size - 1)
    fine[::2], fine[1::2] = parameters, 0.5 * (parameters[1:] + parameters[:-1])
    table = functions.tabulate(path(fine))
    found = np.empty(number)
    at_once = max(1, VALUES_AT_ONCE // fine.size)
    with np.errstate(all="ignore"):
        for begin in range(0, number, at_once):
            some = np.arange(begin, min(begin + at_once, number))
            values = functions.logarithms(table, np.arange(fine.size), some[:, None])
            found[some] = _changes(functions, some, path, fine, values)
    return found


def _changes(
    functions: Functions, numbers: Integers, path: Path, fine: Array, values: ComplexArray
) -> Array:
    """The changes of some functions, from values at ends and middles of the first intervals."""
    n = numbers.size
    total = np.zeros(n)
    owner = np.repeat(np.arange(n), fine.size // 2)
    low, middle, high = (np.tile(part, n) for part in (fine[:-1:2], fine[1::2], fine[2::2]))
    left, new, right = (
        part.ravel() for part in (values[:, :-1:2], values[:, 1::2], values[:, 2::2])
    )
    total[~np.isfinite(values).all(axis=1)] = np.nan
    for _ in range(DEEPEST):
        first, second = _change(left, new), _change(new, right)
        is_resolved = np.abs(first + second - _change(left, right)) < LARGEST_MISMATCH
        # a half next to one that changes fast may hide a whole turn
        done = is_resolved & (np.maximum(np.abs(first), np.abs(second)) <= LARGEST_CHANGE)
        kept: list[list[Any]] = []
        halves = ((first, low, middle, left, new), (second, middle, high, new, right))
        for change, start, end, here, there in halves:
            total += np.bincount(owner[done], weights=change[done].imag, minlength=n)
            kept.append([one[~done] for one in (owner, start, end, here, there)])
        owner, low, high, left, right = (np.concatenate(pair) for pair in zip(*kept, strict=True))
        # a zero on the path itself would be halved for ever
        total[np.bincount(owner, minlength=n) > MOST_PENDING + fine.size] = np.nan
        going = np.isfinite(total[owner])
        owner, low, high = owner[going], low[going], high[going]
        left, right = left[going], right[going]
        if not owner.size:
            return total
        middle = 0.5 * (low + high)
        # several functions have the same intervals
        different, rows = (
            (middle, np.arange(middle.size)) if n == 1 else np.unique(middle, return_inverse=True)
        )
        new = functions.logarithms(functions.tabulate(path(different)), rows, numbers[owner])
        total[owner[~np.isfinite(new)]] = np.nan
    total[owner] = np.nan
    return total


def _change(before: ComplexArray, after: ComplexArray) -> ComplexArray:
    """Difference of logarithms, its imaginary part between -pi and pi."""
    change = after - before
    return np.asarray(change - 2j * math.pi * np.round(change.imag / (2 * math.pi)))


def count_zeros(functions: Functions, radius: float) -> Integers:
    r"""Number of zeros of each function in :math:`|z| < \rho < 1`, with multiplicity, ``(q,)``.

    The functions are analytic in the open unit disc and real on the real axis.
    :data:`UNDECIDED` where a zero lies on the circle to round-off.
    """
    angles = _first_angles(radius, functions.degree)
    turns = changes_of_argument(functions, lambda at: radius * _unit_circle(at), angles)
    counts = np.round(turns / math.pi)
    return np.where(np.isfinite(counts) & (counts >= 0), counts, UNDECIDED).astype(np.int64)


@lru_cache(maxsize=64)
def _first_angles(radius: float, degree: int) -> Array:
    r"""Angles in :math:`[0, \pi]` to begin with, closer to each other at both ends."""
    least = min(max(1.0 - radius, 1e-12), 0.3)
    factors = math.ceil(math.log2(math.pi / 2 / least)) + 1
    number = math.ceil(factors * max(1.0, degree / PER_FACTOR)) + 1
    rising = np.geomspace(least / 2, math.pi / 2, number)
    even = np.linspace(0.0, math.pi, PER_ZERO * degree)
    return np.unique(np.concatenate([even, rising, math.pi - rising[:-1]]))


def _unit_circle(angles: Array) -> ComplexArray:
    """Points of the unit circle at these angles; at 0 and pi exactly real, as the functions are."""
    points = np.exp(1j * angles)
    return np.asarray(np.where(angles == math.pi, -1.0, points))
