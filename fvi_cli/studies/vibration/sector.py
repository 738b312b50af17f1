r"""Number of modes in a sector of the complex plane, and the modes themselves.

The determinant of T(s) is analytic in :math:`r_1 < |s| < r_2`,
:math:`\alpha_1 < \arg s < \alpha_2` with :math:`0 < \alpha_1, \alpha_2 < \pi`, so that its argument
turns once around for every zero inside when s goes around the sector. Known zeros are divided out,
so that the argument turns quickly only where a zero is missing.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.zeros import OneFunction, changes_of_argument
from fvi_cli.studies.vibration.dynamic_stiffness import DynamicStiffness

FIRST_STEPS = 4
FIRST_STEPS_AROUND = 16
STEPS_PER_FOLD = 4
"""First steps along an edge: so many, and as many for each radian or e-fold of the modulus."""
NEAR_AXIS = np.array([0.002, 0.006, 0.02, 0.05, 0.1])
"""Distances (radians) of extra points from the imaginary axis, near lightly damped modes."""
INTEGRATION_POINTS = 24
"""Gauss points of each edge of a contour integral."""
RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Sector:
    """A part of an annulus, between two moduli and two arguments of s."""

    least: float
    largest: float
    """Bounds of the modulus of s, 1/time."""
    first: float
    last: float
    """Bounds of the argument of s, radians."""

    def holds(self, s: complex) -> bool:
        """Whether s lies inside."""
        return self.least < abs(s) < self.largest and self.first < cmath.phase(s) < self.last

    def edges(self) -> list[tuple[complex, complex]]:
        """Logarithms of s at the ends of the four edges, counter-clockwise."""
        inner, outer = math.log(self.least), math.log(self.largest)
        corners = [
            complex(inner, self.first),
            complex(outer, self.first),
            complex(outer, self.last),
            complex(inner, self.last),
        ]
        return list(zip(corners, [*corners[1:], corners[0]], strict=True))

    @property
    def extent(self) -> tuple[float, float]:
        """Extent of the logarithm of the modulus, and of the argument in radians."""
        return math.log(self.largest / self.least), self.last - self.first

    def halves(self, part: float) -> tuple[Sector, Sector]:
        """Two sectors, cut where the longer side is divided by `part`."""
        across, around = self.extent
        if across > around:
            cut = self.least * math.exp(part * across)
            return replace(self, largest=cut), replace(self, least=cut)
        angle = self.first + part * around
        return replace(self, last=angle), replace(self, first=angle)


class CountError(Exception):
    """The argument could not be followed: a mode lies on the edge."""


def count_modes(stiffness: DynamicStiffness, sector: Sector, known: Sequence[complex] = ()) -> int:
    """Number of zeros of the determinant inside, with their multiplicity.

    Raises
    ------
    CountError
        If a mode lies on the edge.
    """
    zeros = np.array([*known, *np.conj(known)], dtype=complex)
    # modes far below the sector turn the argument evenly along it, as zeros at 0 do
    below = 0 if stiffness.is_small else stiffness.number_below(sector.least)
    if below >= stiffness.dimension:
        raise CountError("the number of modes slower than the region is unknown")

    def log_rest(s: ComplexArray) -> ComplexArray:
        """Logarithm of det T(s) after the known zeros are divided out."""
        with np.errstate(divide="ignore"):
            divided = np.log(s[:, None] - zeros).sum(axis=1)
            divided += 2 * below * np.log(s)
            return np.asarray(stiffness.log_determinants(s) - divided)

    # s^2d must turn by less than half a revolution per step, or whole turns are missed
    density = STEPS_PER_FOLD + (stiffness.dimension if stiffness.is_small else 0)
    total = 0.0
    for first, last in sector.edges():

        def edge(part: Array, first: complex = first, last: complex = last) -> ComplexArray:
            return np.exp((1.0 - part) * first + part * last)

        parts = _first_parts(first, last, density)
        total += float(changes_of_argument(OneFunction(log_rest), edge, parts)[0])
    if math.isnan(total):
        raise CountError("a mode lies on the edge of the region that is counted")
    return round(total / (2.0 * math.pi)) + sum(sector.holds(s) for s in known)


def _first_parts(first: complex, last: complex, density: float) -> Array:
    """First points of an edge as shares of it, closer where it crosses the imaginary axis."""
    around = last.imag - first.imag
    steps = math.ceil(density * abs(last - first)) + (FIRST_STEPS_AROUND if around else FIRST_STEPS)
    parts = np.linspace(0.0, 1.0, steps + 1)
    if around:
        near = (0.5 * math.pi + np.array([-1.0, 1.0])[:, None] * NEAR_AXIS - first.imag) / around
        parts = np.concatenate([parts, near[(near > 0) & (near < 1)]])
    return np.unique(parts)


def modes_by_integrals(
    stiffness: DynamicStiffness, sector: Sector, count: int
) -> list[tuple[complex, ComplexArray]]:
    r"""Approximate modes inside, from contour integrals of :math:`T(s)^{-1}` around the sector.

    Beyn, *An integral method for solving nonlinear eigenvalue problems*, Linear Algebra Appl. 436
    (2012), with :math:`A_k = \oint s^k T(s)^{-1} V ds` for random columns V.
    """
    d = stiffness.dimension
    columns = min(d, count + 8)
    random = np.random.default_rng(7).standard_normal((d, columns)).astype(complex)
    moments = [np.zeros((d, columns), dtype=complex) for _ in range(2)]
    nodes, weights = np.polynomial.legendre.leggauss(INTEGRATION_POINTS)
    scale = sector.largest
    for begin, end in sector.edges():
        rate = (end - begin) / 2.0
        for node, weight in zip(nodes, weights, strict=True):
            s = cmath.exp(begin + rate * (1.0 + node))
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
