r"""The characteristic function :math:`P(s) = m s^2 + \sum_j \mu_j s^{\gamma_j} + k` and its zeros.

Powers are principal, cut along the negative real axis. In :math:`w = \log s` the function is an
entire exponential sum, whose zeros in a strip are found by Newton's iteration from the balances of
two terms each, and counted by the argument principle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array, ComplexArray, LongArray
from fvi_cli.mathematics.zeros import OneFunction, Path, changes_of_argument

LongComplexArray = NDArray[np.clongdouble]
_LARGEST_LOGARITHM = 700.0  # of abs(s)
_STRIPS = (2.95, 2.9, 3.0, 2.85, 3.05)  # bounds of arg(s), tried in turn
_SAME_ZERO = 5e-3  # distance in w below which zeros form a cluster
_SAME_POSITIVE_ZERO = 0.1  # the same near the positive axis of s
FIRST_STEPS = 10.0
"""Initial steps of a path per unit length in w."""
_CONVERGED = 4 * np.finfo(np.longdouble).eps  # change of w that ends Newton's iteration

Terms = tuple[tuple[float, float], ...]
"""A sum of powers: pairs (power of s, coefficient), powers falling, without zeros."""


def characteristic_terms(
    *, mass: float, stiffness: float = 0.0, damping: tuple[tuple[float, float], ...] = ()
) -> Terms:
    r"""The characteristic function of :math:`m x'' + \sum_j \mu_j D^{\gamma_j} x + k x`.

    The mass is positive; `damping` has pairs :math:`(\gamma_j, \mu_j)` with orders in (0, 2).
    """
    sums: dict[float, float] = {2.0: mass}
    for order, coefficient in (*damping, (0.0, stiffness)):
        sums[order] = sums.get(order, 0.0) + coefficient
    return tuple((power, sums[power]) for power in sorted(sums, reverse=True) if sums[power])


@dataclass(frozen=True, kw_only=True)
class ZeroCluster:
    r"""Zeros of a characteristic function that lie close together; nearly always a single one."""

    center: np.clongdouble  # the zero, or the middle of the cluster; its argument lies in [0, pi)
    # no zero of the cluster is farther from the center than this, relative to abs(center)
    radius: float
    # every other zero, and the branch point, is at least about this far away, relative to
    # abs(center)
    clearance: float
    multiplicity: int  # how many zeros there are, on both sides of the real axis if `is_real`
    # whether the cluster is its own mirror image. Otherwise there is another one at the conjugate
    is_real: bool


def characteristic_zeros(terms: Terms) -> tuple[ZeroCluster, ...]:
    r"""Zeros with :math:`0 \le \arg s < 2.9` or so; other zeros lie inside every contour used.

    With one damping term and positive coefficients there is a single conjugate pair
    (for orders below 1: M. Naber, *Linear fractionally damped oscillator*, Int. J. Differ. Equ.
    2010, 197020), which is left out where it lies close to the cut.

    Raises
    ------
    ValueError
        If the zeros found do not match their number by the argument principle.
    """
    if len(terms) == 1:
        return ()
    powers, coefficients = np.array(terms, dtype=np.longdouble).T
    sums = _ExponentialSum(powers, coefficients)
    low, high = sums.bounds()
    if not low < high:
        # whatever |s|, one term outweighs the others
        return ()
    # the balances alone nearly always find all zeros, which the count confirms
    for density in (0, 1, 4):
        found = sums.polished(sums.balances(low, high, density))
        for strip in _STRIPS:
            number = sums.count(low, high, strip)
            if number is None:
                continue
            inside = found[(found.imag < strip) & (found.real > low) & (found.real < high)]
            clusters = _clusters(sums, inside)
            if number == sum(c.multiplicity * (1 if c.is_real else 2) for c in clusters):
                return clusters
    raise ValueError(f"characteristic function: the zeros of {terms!r} could not be separated")


@dataclass(frozen=True, eq=False)
class _ExponentialSum:
    """The characteristic function of w = log s."""

    powers: LongArray
    coefficients: LongArray

    def bounds(self) -> tuple[float, float]:
        """Real parts of w between which all zeros lie.

        Outside, the first (or last) term alone is larger than four times the sum of the others.
        """
        powers, plain = self.powers, np.log(np.abs(self.coefficients))
        logs = plain + math.log(4.0 * len(powers))
        high = float(np.max((logs[1:] - plain[0]) / (powers[0] - powers[1:])))
        low = float(np.min((plain[-1] - logs[:-1]) / (powers[:-1] - powers[-1])))
        # for terms of nearly equal power a bound may be out of range, on either side
        largest = _LARGEST_LOGARITHM
        return min(max(low, -largest), largest), min(max(high, -largest), largest)

    def values(
        self, w: LongComplexArray
    ) -> tuple[LongComplexArray, LongComplexArray, LongComplexArray]:
        """The sum, its derivative and the sum of moduli, each over its largest term."""
        powers = self.powers[:, None]
        logs = np.log(np.abs(self.coefficients))[:, None] + powers * w
        parts = np.sign(self.coefficients)[:, None] * np.exp(logs - logs.real.max(axis=0))
        return parts.sum(axis=0), (powers * parts).sum(axis=0), np.abs(parts).sum(axis=0)

    def balances(self, low: float, high: float, density: int) -> LongComplexArray:
        """Places at which two terms cancel each other, and further places around them."""
        seeds: list[complex] = []
        angles = np.linspace(0.0, 3.1, 12 * density)
        shifts = np.linspace(-2.0, 2.0, 4 * density + 1) if density else np.empty(0)
        terms = zip(self.powers, self.coefficients, strict=True)
        for (power, coefficient), (other_power, other) in itertools.combinations(terms, 2):
            gap, ratio = power - other_power, -other / coefficient
            radius = math.log(abs(ratio)) / gap
            start = 0.0 if ratio > 0 else math.pi
            turns = np.arange(int(3.1 * gap / (2 * math.pi)) + 2)
            exact = (start + 2 * math.pi * turns) / gap
            seeds.extend(complex(radius, angle) for angle in exact if angle <= 3.1)
            seeds.extend(complex(radius + shift, angle) for shift in shifts for angle in angles)
        array = np.array(seeds, dtype=np.clongdouble)
        return array[(array.real >= low) & (array.real <= high)]

    def polished(self, w: LongComplexArray) -> LongComplexArray:
        """The zeros to which Newton's iteration leads."""
        for _ in range(60):
            value, slope, _ = self.values(w)
            slope = np.where(slope == 0, 1.0, slope)
            step = value / slope
            step *= np.minimum(1.0, 0.5 / np.maximum(np.abs(step), 1e-300))
            w = w - step
            w = np.clip(w.real, -2000.0, 2000.0) + 1j * np.clip(w.imag, -4.0, 4.0)
            if not np.any(np.abs(step) > _CONVERGED):
                break
        value, _, size = self.values(w)
        w = w[np.abs(value) < 1e-13 * size.real]
        # The coefficients are real: zeros come in mirror images.
        return w.real + 1j * np.abs(w.imag)

    def turn(self, path: Path, parameters: Array) -> float:
        """Change of the argument along a path of w; nan if a zero lies on it."""

        def logarithm(w: ComplexArray) -> ComplexArray:
            sums = self.values(w.astype(np.clongdouble))[0]
            return np.asarray(np.log(sums), dtype=np.complex128)

        return float(changes_of_argument(OneFunction(logarithm), path, parameters)[0])

    def count(self, low: float, high: float, strip: float) -> int | None:
        """Zeros with abs(arg) < strip by the argument principle; None if one is on the boundary."""
        corners = (complex(high, 0.0), complex(high, strip), complex(low, strip), complex(low, 0.0))
        turn = 0.0
        for begin, end in itertools.pairwise(corners):

            def line(part: Array, begin: complex = begin, end: complex = end) -> ComplexArray:
                return np.asarray(begin + part * (end - begin), dtype=np.complex128)

            steps = 2 + math.ceil(FIRST_STEPS * abs(end - begin))
            turn += self.turn(line, np.linspace(0.0, 1.0, steps))
        return None if math.isnan(turn) else round(turn / math.pi)


def _linked(first: LongComplexArray, second: LongComplexArray) -> NDArray[np.bool_]:
    """Which first zeros are close to any second one; on the positive axis the limit is wider."""
    positive = np.abs(first.imag) < _SAME_POSITIVE_ZERO
    limit = np.where(positive, _SAME_POSITIVE_ZERO, _SAME_ZERO)
    return np.asarray((np.abs(first[:, None] - second) < limit[:, None]).any(axis=1))


def _clusters(sums: _ExponentialSum, zeros: LongComplexArray) -> tuple[ZeroCluster, ...]:
    everything = np.concatenate([zeros, zeros.conj()])
    clusters: list[ZeroCluster] = []
    left = everything
    while len(left):
        members = left[:1]
        near = _linked(everything, members)
        while int(near.sum()) > len(members):
            members = everything[near]
            near = _linked(everything, members)
        left = left[~_linked(left, members)]
        center = members.mean()
        # A zero that is not real is linked to its mirror image, or at least _SAME_ZERO / 2 off the
        # axis.
        if abs(center.imag) < _SAME_ZERO / 4 or center.imag > 0:
            clusters.append(_cluster(sums, members, everything[~near]))
    return tuple(clusters)


def _cluster(
    sums: _ExponentialSum, members: LongComplexArray, others: LongComplexArray
) -> ZeroCluster:
    center = members.mean()
    is_real = bool(abs(center.imag) < _SAME_ZERO / 4)
    inner = float(np.abs(members - center).max())
    outer = min([0.5, *np.abs(others - center).astype(float)])
    around, radius = complex(center), math.sqrt(max(inner, 1e-6) * outer)
    turn = sums.turn(
        lambda part: around + radius * np.exp(2j * math.pi * part), np.linspace(0.0, 1.0, 65)
    )
    multiplicity = 0 if math.isnan(turn) else round(turn / (2 * math.pi))
    if multiplicity == 1:
        # The copy with the least residual; the mean would depend on where the iterations started.
        center = members[np.abs(sums.values(members)[0]).argmin()]
    return ZeroCluster(
        center=np.exp(np.clongdouble(center.real) if is_real else center),
        radius=0.0 if multiplicity == 1 else max(inner, 1e-6),
        clearance=outer,
        multiplicity=multiplicity,
        is_real=is_real,
    )


def evaluate_powers(terms: Mapping[float, float], s: LongComplexArray) -> LongComplexArray:
    r"""The sum :math:`\sum_p c_p s^p` of principal powers in extended precision."""
    total = np.zeros(np.shape(s), dtype=np.clongdouble)
    logarithm = np.log(s)
    for power, coefficient in terms.items():
        total = total + coefficient * np.exp(power * logarithm)
    return total
