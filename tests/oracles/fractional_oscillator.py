r"""Exact responses of :math:`m x'' + \sum_j \mu_j D^{\gamma_j} x + k x = f`, orders in (0, 2).

Every solution of the linear equation has a transform :math:`N(s)/P(s)`, with a sum of powers N
for initial data and for a force :math:`\sum c\,t^\beta`, and P the characteristic function. Its
inverse is the residues at the zeros of P on the principal sheet plus the integral round the branch
cut. The cut integral is taken along a hyperbola that scales with 1/t, so that near-singular
densities (orders close to 1, overdamped) stay inside of it, small times lose nothing by
cancellation, and the algebraic tail keeps its relative accuracy.

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

from fvi_cli.mathematics.arrays import Array, ComplexArray

from .characteristic import (
    Terms,
    ZeroCluster,
    evaluate_powers,
)

_ANGLE = math.pi / 4  # of the hyperbola
_SPACINGS = (0.05, 0.045)  # along the contour: the one with nodes farther from poles is used
_DECAY = 42.0  # the contour ends where e^(st) is about exp(-42)
_CHUNK = 2048  # times that are computed together
_SHIFT = 4.0  # of s t: keeps double zeros inside of the contour
_SAME_POWER = 1e-9  # powers that differ by less are equal


def contour_response(
    terms: Terms,
    zeros: tuple[ZeroCluster, ...],
    numerator: Mapping[float, float],
    time: Array,
) -> Array:
    r"""Inverse Laplace transform of :math:`N(s)/P(s)` at positive times.

    P is a sum of powers, its zeros are those of :func:`characteristic_zeros`; N maps powers of s,
    at most that of P less 1, to coefficients.
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
    result = np.zeros(flat.size)
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
        contour = _Contour(terms, numerator, scale, shift)
        indices = np.flatnonzero(chosen)
        for start in range(0, len(indices), _CHUNK):
            part = indices[start : start + _CHUNK]
            # A growing response may leave the range of doubles, and is not finite from there on.
            with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                result[part] = contour.response(flat[part], outside)
    return result.reshape(time.shape)


@dataclass(frozen=True, eq=False)
class _Contour:
    """Integrals of N/P e^(st) along s t = shift + scale (1 + sin(i u - angle)), a hyperbola."""

    terms: Terms
    numerator: Mapping[float, float]
    scale: float
    shift: float

    def response(self, time: Array, zeros: Sequence[ZeroCluster]) -> Array:
        """The integral along the contour, with the residues at zeros outside."""
        simple = [zero for zero in zeros if zero.multiplicity == 1]
        residues = [self._residue(zero, time) for zero in simple]
        positions = [self._preimage(complex(zero.center), time) for zero in simple]
        candidates = [(spacing, offset) for spacing in _SPACINGS for offset in (0.0, 0.5)]
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
        result = np.empty(time.size)
        for index, (spacing, offset) in enumerate(candidates):
            chosen = best == index
            if not np.any(chosen):
                continue
            value = self._trapezoidal_sum(time[chosen], spacing, offset)
            for zero, residue, factor in zip(simple, residues, factors[index], strict=True):
                count = 1.0 if zero.is_real else 2.0
                value += count * (residue[chosen] / (1.0 - factor[chosen])).real
            result[chosen] = value
        for zero in zeros:
            if zero.multiplicity > 1:
                result += self._cluster_residues(zero, time)
        return result

    def _preimage(self, s: complex, time: Array) -> ComplexArray:
        """The u of a pole; Im u > 0 lies inside, on the side of the cut."""
        return np.asarray(-1j * (np.arcsin((s * time - self.shift) / self.scale - 1.0) + _ANGLE))

    def _trapezoidal_sum(self, time: Array, spacing: float, offset: float) -> Array:
        last = math.acosh((_DECAY / self.scale + 1.0) / math.sin(_ANGLE))
        u = spacing * (offset + np.arange(int(last / spacing) + 2))
        weights = np.where(u == 0, 0.5, 1.0)
        z = self.shift + self.scale * (1.0 + np.sin(1j * u - _ANGLE))
        weights = weights * np.exp(z) * np.cos(1j * u - _ANGLE) * (spacing * self.scale / math.pi)
        top, bottom = np.zeros((2, len(time), len(u)), dtype=complex)
        highest = self.terms[0][0]
        # Multiplied by powers of t, so that the largest term is of order one at small times.
        for power, coefficient in self.numerator.items():
            top += (coefficient * time ** (highest - 2.0 - power))[:, None] * z**power
        for power, coefficient in self.terms:
            bottom += (coefficient * time ** (highest - power))[:, None] * z**power
        return np.asarray(((top / bottom) @ weights).real * time)

    def _residue(self, zero: ZeroCluster, time: Array) -> ComplexArray:
        """Residue at a simple zero, in extended precision."""
        center = np.array([zero.center])
        slope = {power - 1.0: power * c for power, c in self.terms if power}
        above, below = (evaluate_powers(one, center)[0] for one in (self.numerator, slope))
        values = above / below * np.exp(zero.center * time.astype(np.longdouble))
        return np.asarray(values, dtype=complex)

    def _cluster_residues(self, cluster: ZeroCluster, time: Array) -> Array:
        """All residues of a cluster on the positive axis, by a circle round it."""
        nodes = np.exp(2j * np.pi * (np.arange(96) + 0.5) / 96)
        center = float(cluster.center.real)
        least, most = 2.0 * cluster.radius * center, 0.5 * cluster.clearance * center
        radius = np.clip(2.0 / time, least, most)
        s = (center + radius[:, None] * nodes).astype(np.clongdouble)
        quotient = evaluate_powers(self.numerator, s) / evaluate_powers(dict(self.terms), s)
        integrand = quotient * np.exp(s * time[:, None]) * nodes
        return np.asarray(radius * integrand.real.mean(axis=1), dtype=float)
