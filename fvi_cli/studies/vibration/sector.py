r"""How many modes a sector of the complex plane holds, and which.

The determinant of T(s) is analytic in :math:`r_1 < |s| < r_2`,
:math:`\alpha_1 < \arg s < \alpha_2` with :math:`0 < \alpha_1, \alpha_2 < \pi`, so that its argument
turns once around for every zero inside when s goes around the sector. Zeros that are known are
divided out, so that what is followed turns quickly only where one is missing; it is followed in
steps that are halved until it turns by little in each.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness

LARGEST_TURN = 0.9
"""Radians by which the argument may turn in a step."""
FIRST_STEPS = 8
"""Steps of an edge at first."""
MOST_FACTORISATIONS = 20_000
INTEGRATION_POINTS = 24
"""Gauss points of each edge of a contour integral."""
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Sector:
    """A piece of a ring.

    Parameters
    ----------
    least, largest
        Of the modulus of s, 1/time.
    first, last
        Of its argument, radians.
    """

    least: float
    largest: float
    first: float
    last: float

    def holds(self, s: complex) -> bool:
        """Whether s lies inside."""
        return self.least < abs(s) < self.largest and self.first < cmath.phase(s) < self.last

    def corners(self) -> list[tuple[float, float]]:
        """Logarithm of the modulus, and argument, of the corners, counter-clockwise."""
        inner, outer = math.log(self.least), math.log(self.largest)
        return [(inner, self.first), (outer, self.first), (outer, self.last), (inner, self.last)]


class CountError(Exception):
    """The argument could not be followed: a mode lies on the edge."""


def count_modes(stiffness: DynamicStiffness, sector: Sector, known: Sequence[complex] = ()) -> int:
    """Number of zeros of the determinant inside, with their multiplicity.

    Parameters
    ----------
    stiffness, sector
        T and where.
    known
        Zeros that are known, in the sector or not, each as often as it is one.

    Raises
    ------
    CountError
        If a mode lies on the edge.
    """
    corners = sector.corners()
    total, done = 0.0, 0
    for begin, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        turn, steps = _turn_along(stiffness, begin, end, known, MOST_FACTORISATIONS - done)
        total, done = total + turn, done + steps
    turns = total / (2.0 * math.pi)
    return round(turns) + sum(sector.holds(s) for s in known)


def _turn_along(
    stiffness: DynamicStiffness,
    begin: tuple[float, float],
    end: tuple[float, float],
    known: Sequence[complex],
    most: int,
) -> tuple[float, int]:
    """How far the argument turns along an edge, and the factorisations that it took."""

    def phase(part: float) -> float:
        log, angle = ((1.0 - part) * b + part * e for b, e in zip(begin, end, strict=True))
        s = cmath.rect(math.exp(log), angle)
        divided = sum(cmath.phase((s - zero) * (s - zero.conjugate())) for zero in known)
        try:
            return stiffness.factors(s).phase - divided
        except np.linalg.LinAlgError as error:
            raise CountError("a mode lies on the edge of the region that is counted") from error

    parts = [index / FIRST_STEPS for index in range(FIRST_STEPS + 1)]
    seen = {part: phase(part) for part in parts}
    waiting = list(pairwise(parts))
    total = 0.0
    while waiting:
        left, right = waiting.pop()
        middle = 0.5 * (left + right)
        if middle in (left, right) or len(seen) > most:
            raise CountError("a mode lies too close to the edge of the region that is counted")
        seen[middle] = phase(middle)
        halves = [
            _turn(seen[left], seen[middle]),
            _turn(seen[middle], seen[right]),
        ]
        if max(map(abs, halves)) <= LARGEST_TURN:
            total += sum(halves)
        else:
            waiting += [(left, middle), (middle, right)]
    return total, len(seen)


def _turn(one: float, other: float) -> float:
    return math.remainder(other - one, 2.0 * math.pi)


def modes_by_integrals(
    stiffness: DynamicStiffness, sector: Sector, count: int
) -> list[tuple[complex, ComplexArray]]:
    r"""Approximations of the modes inside, by the moments of :math:`T(s)^{-1}` around the sector.

    Parameters
    ----------
    stiffness, sector
        T and where.
    count
        Number of modes inside.

    Notes
    -----
    Beyn, *An integral method for solving nonlinear eigenvalue problems*, Linear Algebra Appl. 436
    (2012), with :math:`A_k = \oint s^k T(s)^{-1} V ds` for random columns V.
    """
    d = stiffness.dimension
    columns = min(d, count + 8)
    random = np.random.default_rng(7).standard_normal((d, columns)).astype(complex)
    moments = [np.zeros((d, columns), dtype=complex) for _ in range(2)]
    nodes, weights = np.polynomial.legendre.leggauss(INTEGRATION_POINTS)
    scale = sector.largest
    corners = sector.corners()
    for begin, end in zip(corners, [*corners[1:], corners[0]], strict=True):
        rate = complex(end[0] - begin[0], end[1] - begin[1]) / 2.0
        for node, weight in zip(nodes, weights, strict=True):
            log = complex(*begin) + rate * (1.0 + node)
            s = cmath.exp(log)
            found = stiffness.factors(s).solve(random) * (weight * rate * s / scale)
            for power, moment in enumerate(moments):
                moment += (s / scale) ** power * found
    left, sizes, right = np.linalg.svd(moments[0], full_matrices=False)
    rank = int(np.count_nonzero(sizes > RANK_TOLERANCE * sizes[0]))
    reduced = left[:, :rank].conj().T @ moments[1] @ right[:rank].conj().T / sizes[:rank]
    values, vectors = np.linalg.eig(reduced)
    shapes = left[:, :rank] @ vectors
    return [
        (complex(scale * value), shapes[:, index])
        for index, value in enumerate(values)
        if sector.holds(scale * value)
    ]
