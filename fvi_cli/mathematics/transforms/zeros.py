r"""Zeros of analytic functions: how many lie inside a contour, and where they lie in a disc.

By the argument principle (Henrici, *Applied and Computational Complex Analysis* 1, section 4.10)

.. math:: \frac{1}{2 \pi i} \oint z^k\, d \log f = \sum_j z_j^k

over the zeros inside. The functions are given by their logarithms, because determinants overflow,
and many of them that have much in common are followed together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers

LogFunction = Callable[[ComplexArray], ComplexArray]
"""Any branch of log f at points of shape ``(k,)``, minus infinity at a zero."""

Path = Callable[[Array], ComplexArray]

UNDECIDED = -1
"""In place of a count: a zero lies on the contour to round-off."""

USUAL_DEGREE = 8
"""Number of zeros that is assumed for the determinant of a few unknowns."""

LARGEST_COUNT = 64
"""Zeros are not located if there are more than this."""

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

_ITERATIONS = 150  # at most, for all zeros
_SHIFT = 1e-6  # distance of the values for f / f', in units of `_scale`
_LAST_STEP = 1e-8  # a smaller step ends the iteration of a zero, same units
_DISTINCT = 1e-9  # least distance of two zeros, same units
_PLACES = 8.0  # number of radii at which points start again
_SWEEPS = 30  # of :func:`largest_root`
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)  # turn between successive such points


class ZeroCountError(ValueError):
    """Zeros could not be counted: one of them lies on the contour itself."""


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


def contour_integrals(
    functions: Functions, path: Path, parameters: Array, *, powers: int = 0
) -> Array:
    r"""Imaginary parts of :math:`\int z^k\, d \log f_q` along a path, ``(q, powers + 1)``.

    Column 0 has the changes of the argument in radians; nan where a zero lies on the path to
    round-off.
    The path goes through the points of `parameters`, which increase. Intervals are halved until
    log f, its modulus included, changes by less than 1 over each half, and the changes of the
    halves add up to that between the ends. This finds close pairs of zeros, whose turn of
    :math:`2 \pi` would be overlooked otherwise. Each function has points where it needs them.
    """
    number = functions.number
    fine = np.empty(2 * parameters.size - 1)
    fine[::2], fine[1::2] = parameters, 0.5 * (parameters[1:] + parameters[:-1])
    table = functions.tabulate(path(fine))
    found = np.empty((number, powers + 1))
    at_once = max(1, VALUES_AT_ONCE // fine.size)
    with np.errstate(all="ignore"):
        for begin in range(0, number, at_once):
            some = np.arange(begin, min(begin + at_once, number))
            values = functions.logarithms(table, np.arange(fine.size), some[:, None])
            found[some] = _integrals(functions, some, path, fine, values, powers)
    return found


def _integrals(
    functions: Functions,
    numbers: Integers,
    path: Path,
    fine: Array,
    values: ComplexArray,
    powers: int,
) -> Array:
    """The integrals of some functions, from values at ends and middles of the first intervals."""
    n = numbers.size
    total = np.zeros((n, powers + 1))
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
        kept = []
        halves = ((first, low, middle, left, new), (second, middle, high, new, right))
        for change, start, end, here, there in halves:
            _add(total, owner[done], change[done], path, start[done], end[done])
            kept.append([one[~done] for one in (owner, start, end, here, there)])
        owner, low, high, left, right = (np.concatenate(pair) for pair in zip(*kept, strict=True))
        # a zero on the path itself would be halved for ever
        total[np.bincount(owner, minlength=n) > MOST_PENDING + fine.size] = np.nan
        going = np.isfinite(total[owner, 0])
        owner, low, high, left, right = (one[going] for one in (owner, low, high, left, right))
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


def _add(
    total: Array, owner: Integers, change: ComplexArray, path: Path, low: Array, high: Array
) -> None:
    """Add integrals over intervals, by the midpoint rule, to the totals of their owners."""
    terms, powers = change, total.shape[1]
    z = 0.5 * (path(low) + path(high)) if powers > 1 else change
    for power in range(powers):
        terms = terms * z if power else change
        total[:, power] += np.bincount(owner, weights=terms.imag, minlength=total.shape[0])


def count_zeros(functions: Functions, radius: float) -> Integers:
    r"""Number of zeros of each function in :math:`|z| < \rho < 1`, with multiplicity, ``(q,)``.

    The functions are analytic in the open unit disc and real on the real axis.
    :data:`UNDECIDED` where a zero lies on the circle to round-off.
    """
    angles = _first_angles(radius, functions.degree)
    turns = contour_integrals(functions, lambda at: radius * _unit_circle(at), angles)
    counts = np.round(turns[:, 0] / math.pi)
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


def find_zeros(
    log_function: LogFunction, radius: float, degree: int = USUAL_DEGREE
) -> ComplexArray | None:
    r"""All zeros in :math:`|z| < \rho`, smallest modulus first; None if they cannot be separated.

    Newton's iteration with mutual repulsion (O. Aberth, Math. Comp. 27, 1973, 339-344) has found
    all zeros when it has found as many as were counted. `degree`: see :class:`Functions`.

    Raises
    ------
    ZeroCountError
        If a zero lies on the circle to round-off.
    """
    function = OneFunction(lambda z: log_function(radius * z))
    angles = _first_angles(radius, degree)
    powers = min(degree, LARGEST_COUNT)
    sums = contour_integrals(function, _unit_circle, angles, powers=powers)[0] / math.pi
    if not sums[0] > -0.5:
        raise ZeroCountError(f"radius: a zero lies on the circle of radius {radius!r}")
    count = round(sums[0])
    if count == 0:
        return np.empty(0, dtype=np.complex128)
    if count > LARGEST_COUNT:
        return None
    if count > powers:
        sums = contour_integrals(function, _unit_circle, angles, powers=count)[0] / math.pi
    z = _repelled(log_function, radius * _seeds(sums[1 : count + 1]), radius)
    return None if z is None else z[np.argsort(np.abs(z))]


def _seeds(sums: Array) -> ComplexArray:
    """Points of the unit disc with these power sums, by Newton's identities.

    L. M. Delves, J. N. Lyness, *A numerical method for locating the zeros of an analytic
    function*, Math. Comp. 21, 1967, 543-560.
    """
    count = sums.size
    polynomial = np.zeros(count + 1)
    polynomial[0] = 1.0
    for k in range(1, count + 1):
        polynomial[k] = -(sums[:k] @ polynomial[k - 1 :: -1][:k]) / k
    roots = np.roots(polynomial)
    seeds = np.zeros(count, dtype=np.complex128)
    seeds[: roots.size] = roots
    # apart from each other, and inside
    seeds = seeds + 1e-9 * np.exp(1j * np.arange(count))
    return np.asarray(seeds / np.maximum(np.abs(seeds), 1.0))


def _repelled(log_function: LogFunction, z: ComplexArray, radius: float) -> ComplexArray | None:
    """The zeros that iterations from z find, one for each point; None if a point finds none."""
    live, begun = np.ones(z.size, dtype=bool), 0
    for _ in range(_ITERATIONS):
        now = np.flatnonzero(live)
        step = _newton(log_function, z[now])
        gaps = z[now, None] - z
        gaps[np.arange(now.size), now] = np.inf
        repulsion = 1.0 - step * np.sum(1.0 / np.where(gaps == 0, 1e-14, gaps), axis=1)
        step = step / np.where(repulsion == 0, 1.0, repulsion)
        # at most half way to 0
        size, room = np.abs(step), 0.5 * np.maximum(np.abs(z[now]), 0.1)
        step = step * np.minimum(1.0, room / np.maximum(size, 1e-300))
        z[now] -= step
        is_found = size < _LAST_STEP * _scale(z[now])
        live[now] = ~is_found | (np.abs(z[now]) >= radius)
        # points that leave the disc or find zeros outside of it start again elsewhere
        lost = now[(np.abs(z[now]) > 1.0 - 0.5 * (1.0 - radius)) | (is_found & live[now])]
        places = begun + np.arange(lost.size)
        z[lost] = radius * np.sqrt((0.5 + places) % _PLACES / _PLACES)
        z[lost] *= np.exp(2j * math.pi * _GOLDEN * places)
        begun += lost.size
        if not live.any():
            gaps = np.abs(z[:, None] - z)
            np.fill_diagonal(gaps, np.inf)
            return z if np.all(gaps.min(axis=1) > _DISTINCT * _scale(z)) else None
    return None


def _scale(z: ComplexArray) -> Array:
    """Length scale of functions that may have branch points at 1 and -1."""
    return np.minimum(np.maximum(np.abs(z), 1e-3), np.minimum(np.abs(1.0 - z), np.abs(1.0 + z)))


def _newton(log_function: LogFunction, z: ComplexArray) -> ComplexArray:
    """The correction f / f' from a difference of nearby values."""
    shift = _SHIFT * _scale(z)
    values = log_function(np.concatenate([z, z + shift]))
    here, there = values[: z.size], values[z.size :]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        ratio = np.expm1(there - here)
        step = shift / np.where(ratio == 0, 1e-300, ratio)
    return np.asarray(np.where(np.isneginf(here.real), 0.0, np.nan_to_num(step)))


def largest_root(orders: Array, sizes: Array) -> float:
    r"""A bound from above on the positive zero of :math:`s^2 - \sum_j a_j s^{\gamma_j}`, or 0.

    Powers below 2 and factors that are not negative, both ``(n,)``.
    """
    orders, sizes = orders[sizes > 0], sizes[sizes > 0]
    if not sizes.size:
        return 0.0
    with np.errstate(over="ignore"):
        found = float(((sizes.size * sizes) ** (1.0 / (2.0 - orders))).max())
        for _ in range(_SWEEPS):
            found = math.sqrt(float((sizes * found**orders).sum()))
    return found
