r"""Exact responses of :math:`m x'' + \sum_j \mu_j D^{\gamma_j} x + k x = f`, orders in (0, 2).

Every solution of the linear equation has a transform :math:`N(s)/P(s)`, with a sum of powers N
for initial data and for a force :math:`\sum c\,t^\beta`, and P the characteristic function. Its
inverse is the residues at the zeros of P on the principal sheet plus the integral round the branch
cut. The cut integral is taken along a hyperbola that scales with 1/t, so that near-singular
densities (orders close to 1, overdamped) stay inside of it, small times lose nothing by
cancellation, and the algebraic tail keeps its relative accuracy.

A bound on the rounding of such sums is computed with them: the sum of the absolute values of the
terms, times the rounding of one term. It shows where powers of s cancel (forces that are large and
small in turn, zeros next to the branch point).

References
----------
J.A.C. Weideman, L.N. Trefethen, *Parabolic and hyperbolic contours for computing the Bromwich
integral*, Math. Comp. 76 (2007); L.N. Trefethen, J.A.C. Weideman, *The exponentially convergent
trapezoidal rule*, SIAM Rev. 56 (2014), section 5, for the correction of a nearby pole.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray, LongArray
from fvi_cli.mathematics.transforms.characteristic import (
    Terms,
    ZeroCluster,
    evaluate_powers,
)

_ANGLE = math.pi / 4  # of the hyperbola
SPACINGS, OTHER_SPACINGS = (0.05, 0.045), (0.04, 0.036)
"""Step sizes along the contour, in pairs: the one with nodes farther from the poles is used."""
_DECAY = 42.0  # the contour ends where e^(st) is about exp(-42)
_CHUNK = 2048  # times that are computed together
_SHIFT = 4.0  # of s t: keeps double zeros inside of the contour
_SAME_POWER = 1e-9  # powers that differ by less are equal
EPSILON = float(np.finfo(float).eps)
LONG_EPSILON = float(np.finfo(np.longdouble).eps)


def contour_response(
    terms: Terms,
    zeros: tuple[ZeroCluster, ...],
    numerator: Mapping[float, float],
    time: Array,
    *,
    terms_error: float = LONG_EPSILON,
    time_error: float = 0.0,
    spacings: tuple[float, float] = SPACINGS,
) -> tuple[Array, Array]:
    r"""Inverse Laplace transform of :math:`N(s)/P(s)`, and its rounding.

    P is a sum of powers, its zeros are those of :func:`characteristic_zeros`; N maps powers of s,
    at most that of P less 1, to coefficients. Times are positive, of any shape. The second array
    bounds the error by round-off if times are known to a relative error `time_error` and
    coefficients of P to `terms_error`. It is about 1e-15 of the response's own size near and after
    that time where nothing cancels. Where ``numpy.longdouble`` is no longer than a double, phases
    of poles cost eps times t times abs(pole). The error of the rule along the contour is seen in
    the difference from the response with another pair of `spacings`: it is large for steep forces
    and zeros next to the branch point.

    Raises
    ------
    ValueError
        If a power is too high, a time is not positive, or zeros away from the positive real axis
        coincide nearly.
    """
    time = np.asarray(time, dtype=float)
    top = terms[0][0]
    if any(power > top - 1 + _SAME_POWER for power in numerator):
        raise ValueError(f"numerator: powers {sorted(numerator)} are not allowed above {top - 1:g}")
    if not np.all(time > 0):
        raise ValueError("time: only positive times are allowed")
    clusters = [zero for zero in zeros if zero.multiplicity > 1]
    for zero in clusters:
        if not (zero.is_real and 4.0 * zero.radius <= zero.clearance):
            raise ValueError(f"characteristic function: zeros near {zero.center} nearly coincide")
    flat = time.ravel()
    result, rounding = np.zeros((2, flat.size))
    # A double zero on the positive axis is kept inside the contour, or well outside.
    close = np.zeros(flat.shape, dtype=bool)
    for cluster in clusters:
        close |= flat * float(cluster.center.real) < 0.75 * _SHIFT
    steepest = max(-min(numerator), 0.0) if numerator else 0.0
    # e^z n!/z^(n+1) is of the size of its integral where z is about n + 1.
    vertex = 1.2 if clusters else min(max(steepest, 1.2), 10.0)
    scale = vertex / (1.0 - math.sin(_ANGLE))
    for shift, chosen in ((0.0, ~close), (_SHIFT, close)):
        outside = zeros if not shift else [zero for zero in zeros if zero not in clusters]
        contour = _Contour(terms, numerator, scale, shift, terms_error, time_error, spacings)
        indices = np.flatnonzero(chosen)
        for start in range(0, len(indices), _CHUNK):
            part = indices[start : start + _CHUNK]
            # A growing response may leave the range of doubles, and is not finite from there on.
            with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                result[part], rounding[part] = contour.response(flat[part], outside)
    return result.reshape(time.shape), rounding.reshape(time.shape)


@dataclass(frozen=True, eq=False)
class _Contour:
    """Integrals of N/P e^(st) along s t = shift + scale (1 + sin(i u - angle)), a hyperbola."""

    terms: Terms
    numerator: Mapping[float, float]
    scale: float
    shift: float
    terms_error: float
    time_error: float
    spacings: tuple[float, float]

    def response(self, time: Array, zeros: Sequence[ZeroCluster]) -> tuple[Array, Array]:
        """The integral along the contour, with the residues at zeros outside; and its rounding."""
        simple = [zero for zero in zeros if zero.multiplicity == 1]
        residues = [self._residue(zero, time) for zero in simple]
        positions = [self._preimage(complex(zero.center), time) for zero in simple]
        candidates = [(spacing, offset) for spacing in self.spacings for offset in (0.0, 0.5)]
        factors = [
            [np.exp(2j * np.pi * (offset - position / spacing)) for position in positions]
            for spacing, offset in candidates
        ]
        # No node may come close to a pole.
        distances = np.array(
            [
                np.min([np.abs(1.0 - f) for f in row], axis=0) if row else np.ones(time.shape)
                for row in factors
            ]
        )
        best = distances.argmax(axis=0)
        result, rounding = np.empty((2, time.size))
        for index, (spacing, offset) in enumerate(candidates):
            chosen = best == index
            if not np.any(chosen):
                continue
            at = time[chosen]
            value, lost = self._trapezoidal_sum(at, spacing, offset)
            for zero, (residue, own), place, factor in zip(
                simple, residues, positions, factors[index], strict=True
            ):
                share = 1.0 / (1.0 - factor[chosen])
                count = 1.0 if zero.is_real else 2.0
                correction = residue[chosen] * share
                value += count * correction.real
                # the factor is known to its exponent's round-off
                turns = 2.0 * np.pi / spacing * np.abs(place[chosen])
                unsure = 2.0 + np.abs(share - 1.0) * turns
                lost += count * np.abs(share) * own[chosen]
                lost += count * np.abs(correction) * unsure * EPSILON
            result[chosen], rounding[chosen] = value, lost
        for zero in zeros:
            if zero.multiplicity > 1:
                value, lost = self._cluster_residues(zero, time)
                result += value
                rounding += lost
        return result, rounding

    def _preimage(self, s: complex, time: Array) -> ComplexArray:
        """The u of a pole; Im u > 0 lies inside, on the side of the cut."""
        return np.asarray(-1j * (np.arcsin((s * time - self.shift) / self.scale - 1.0) + _ANGLE))

    def _trapezoidal_sum(self, time: Array, spacing: float, offset: float) -> Array:
        """The sum, and the effect of one unit in the last place of its terms, ``(2, n)``."""
        last = math.acosh((_DECAY / self.scale + 1.0) / math.sin(_ANGLE))
        u = spacing * (offset + np.arange(int(last / spacing) + 2))
        weights = np.where(u == 0, 0.5, 1.0)
        z = self.shift + self.scale * (1.0 + np.sin(1j * u - _ANGLE))
        weights = weights * np.exp(z) * np.cos(1j * u - _ANGLE) * (spacing * self.scale / math.pi)
        modulus, shape = np.abs(z), (len(time), len(u))
        top, bottom = np.zeros((2, *shape), dtype=complex)
        size_of_top, size_of_bottom = np.zeros((2, *shape))
        highest = self.terms[0][0]
        for power, coefficient in self.numerator.items():
            factor = (coefficient * time ** (highest - 2.0 - power))[:, None]
            top += factor * z**power
            size_of_top += np.abs(factor) * modulus**power
        for power, coefficient in self.terms:
            # Multiplied by a power of t, so that the largest term is of order one at small times.
            factor = (coefficient * time ** (highest - power))[:, None]
            bottom += factor * z**power
            size_of_bottom += np.abs(factor) * modulus**power
        quotient = top / bottom
        sizes = (size_of_top + np.abs(quotient) * size_of_bottom) / np.abs(bottom)
        return np.stack([(quotient @ weights).real, EPSILON * (sizes @ np.abs(weights))]) * time

    def _residue(self, zero: ZeroCluster, time: Array) -> tuple[ComplexArray, Array]:
        """Residue at a simple zero and its rounding error; in extended precision."""
        center = np.array([zero.center])
        slope = {power - 1.0: power * c for power, c in self.terms if power}
        above, below = (evaluate_powers(one, center)[0] for one in (self.numerator, slope))
        constant = above / below
        values = constant * np.exp(zero.center * time.astype(np.longdouble))
        radius = np.abs(center[0])
        of_top, of_slope, of_whole = (
            float(_sizes(one, radius) / np.abs(below))
            for one in (self.numerator, slope, dict(self.terms))
        )
        # relative error of the zero
        off = self.terms_error * of_whole / float(radius)
        steepest = 2.0 + max(map(abs, self.numerator), default=0.0)
        share = float(np.abs(constant))
        lost = of_top * (EPSILON + steepest * off)
        lost += share * of_slope * (self.terms_error + steepest * off)
        growth = np.abs(np.exp(zero.center.real * time))
        moved = (off + self.time_error) * float(radius) * time + EPSILON
        return np.asarray(values, dtype=complex), np.asarray(growth * (lost + share * moved))

    def _cluster_residues(self, cluster: ZeroCluster, time: Array) -> tuple[Array, Array]:
        """All residues of a cluster on the positive axis, by a circle round it; their rounding."""
        nodes = np.exp(2j * np.pi * (np.arange(96) + 0.5) / 96)
        center = float(cluster.center.real)
        least, most = 2.0 * cluster.radius * center, 0.5 * cluster.clearance * center
        radius = np.clip(2.0 / time, least, most)
        s = (center + radius[:, None] * nodes).astype(np.clongdouble)
        terms, modulus = dict(self.terms), np.abs(s)
        below = evaluate_powers(terms, s)
        quotient = evaluate_powers(self.numerator, s) / below
        integrand = quotient * np.exp(s * time[:, None]) * nodes
        sizes = EPSILON * _sizes(self.numerator, modulus)
        sizes = sizes + self.terms_error * np.abs(quotient) * _sizes(terms, modulus)
        lost = sizes / np.abs(below) * np.exp(s.real * time[:, None])
        lost += EPSILON * np.abs(integrand)
        value, rounding = (
            (radius * one.mean(axis=1)).astype(float) for one in (integrand.real, lost)
        )
        return value, rounding


def _sizes(terms: Mapping[float, float], modulus: LongArray) -> LongArray:
    """Sums of the moduli of the terms, at points s with these moduli."""
    total = np.zeros(np.shape(modulus), dtype=np.longdouble)
    for power, coefficient in terms.items():
        total = total + abs(coefficient) * modulus ** np.longdouble(power)
    return total
