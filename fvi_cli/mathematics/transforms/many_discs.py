r"""Zeros in a disc, counted for many functions at once.

The functions :math:`f_q` differ by a few numbers only. What depends on z alone is tabulated once
for all of them, on angles that come from halving the intervals of one first division, so that each
function may put its points where it needs them.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers
from fvi_cli.mathematics.transforms.argument import principal_changes
from fvi_cli.mathematics.transforms.disc_zeros import circle_angles, circle_points


class Family(Protocol):
    """Functions that are analytic in the unit disc and real on the real axis."""

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """What all functions have in common at each z, rows of any shape."""
        ...

    def all_logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of these functions at every row, any branch, ``(functions, rows)``."""
        ...

    def logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of functions, one for each row, shape ``(rows,)``."""
        ...


UNDECIDED = -1
"""In place of a count: a zero lies on the circle to round-off."""

_LARGEST_CHANGE = 1.0
_LARGEST_SURPRISE = 0.5
_DEEPEST = 40
_MOST_INTERVALS = 2_000
_AT_ONCE = 500_000
"""Values that are held at a time."""


def count_zeros_of_many(family: Family, number: int, radius: float, degree: int) -> Integers:
    r"""Number of zeros of :math:`f_0, \dots, f_{n-1}` in :math:`|z| < \rho`.

    The rule for where points are needed is that of
    :func:`fvi_cli.mathematics.transforms.disc_zeros.zeros_in_disc`.

    Parameters
    ----------
    family
        The functions.
    number
        Their number n.
    radius
        The radius, in (0, 1).
    degree
        About how many zeros each has, in and around the disc.

    Returns
    -------
    Integers
        Shape ``(n,)``; :data:`UNDECIDED` where a zero lies on the circle to round-off.

    Raises
    ------
    ValueError
        For a radius outside (0, 1).
    """
    if not 0 < radius < 1:
        raise ValueError(f"radius: {radius!r} is not allowed; it must lie in (0, 1)")
    coarse = circle_angles(radius, degree)
    angles = np.empty(2 * coarse.size - 1)
    angles[::2], angles[1::2] = coarse, 0.5 * (coarse[1:] + coarse[:-1])
    table = family.tabulate(circle_points(radius, angles))
    counts = np.empty(number, dtype=np.int64)
    at_once = max(1, _AT_ONCE // angles.size)
    with np.errstate(all="ignore"):
        for begin in range(0, number, at_once):
            functions = np.arange(begin, min(begin + at_once, number))
            values = family.all_logarithms(table, functions)
            counts[functions] = _turns(family, functions, radius, angles, values)
    return counts


def _turns(
    family: Family, functions: Integers, radius: float, angles: Array, values: ComplexArray
) -> Integers:
    """Turns of each function, from values at angles of which every other one halves an interval."""
    n = functions.size
    total = np.zeros(n)
    owner = np.repeat(np.arange(n), angles.size // 2)
    low, middle, high = (np.tile(part, n) for part in (angles[:-1:2], angles[1::2], angles[2::2]))
    left, new, right = (
        part.ravel() for part in (values[:, :-1:2], values[:, 1::2], values[:, 2::2])
    )
    for _ in range(_DEEPEST):
        halves = _change(left, new), _change(new, right)
        settled = np.abs(halves[0] + halves[1] - _change(left, right)) < _LARGEST_SURPRISE
        kept = []
        parts = ((low, middle, left, new), (middle, high, new, right))
        for change, part in zip(halves, parts, strict=True):
            done = settled & (np.abs(change) <= _LARGEST_CHANGE)
            total += np.bincount(owner[done], weights=change.imag[done], minlength=n)
            kept.append([one[~done] for one in (owner, *part)])
        owner, low, high, left, right = (np.concatenate(pair) for pair in zip(*kept, strict=True))
        # a zero on the circle itself would be halved for ever, and is left undecided
        hopeless = np.bincount(owner, minlength=n) > _MOST_INTERVALS
        total[hopeless] = np.nan
        going = ~hopeless[owner]
        owner, low, high = owner[going], low[going], high[going]
        left, right = left[going], right[going]
        if not owner.size:
            break
        middle = 0.5 * (low + high)
        # intervals of several functions are the same ones
        different, row = np.unique(middle, return_inverse=True)
        table = family.tabulate(circle_points(radius, different))
        new = np.concatenate(
            [
                family.logarithms(table[row[some]], functions[owner[some]])
                for some in np.array_split(np.arange(owner.size), 1 + owner.size // _AT_ONCE)
            ]
        )
    total[owner] = np.nan
    counts = np.round(total / math.pi)
    return np.where(np.isfinite(counts) & (counts >= 0), counts, UNDECIDED).astype(np.int64)


def _change(before: ComplexArray, after: ComplexArray) -> ComplexArray:
    return np.asarray(principal_changes(np.stack([before, after]))[0])
