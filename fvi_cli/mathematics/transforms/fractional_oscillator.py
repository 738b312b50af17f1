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
from collections.abc import Mapping

import numpy as np

from fvi_cli.mathematics.arrays import Array, ComplexArray
from fvi_cli.mathematics.transforms.characteristic import (
    AnyCharacteristic,
    ZeroCluster,
    evaluate_powers,
)

_ANGLE = math.pi / 4
_SPACINGS = (0.05, 0.045)
_DECAY = 42.0
_CHUNK = 2048
_SHIFT = 4.0
_SAME_POWER = 1e-9


def contour_response(
    characteristic: AnyCharacteristic,
    zeros: tuple[ZeroCluster, ...],
    numerator: Mapping[float, float],
    time: Array,
    *,
    decay: float = 0.0,
) -> Array:
    r"""Inverse Laplace transform of :math:`N(s)/P(s)`, times :math:`e^{-l t}`.

    The zeros of P are those of :func:`characteristic_zeros`; N maps powers of s, at most that of P
    less 1, to coefficients; :math:`l \ge 0` is for transforms N(s + l)/P(s + l). At times >= 0 of
    any shape the response is right to about 1e-14 of its own size near and after that time. Where
    ``numpy.longdouble`` is no longer than a double, phases of poles cost eps times t times
    abs(pole) on top.

    Raises
    ------
    ValueError
        If a power is too high, a time is negative, or zeros away from the positive real axis
        coincide nearly.
    """
    time = np.asarray(time, dtype=float)
    top, leading = characteristic.terms[0]
    if any(power > top - 1 + _SAME_POWER for power in numerator):
        raise ValueError(f"numerator: powers {sorted(numerator)} are not allowed above {top - 1:g}")
    if np.any(time < 0):
        raise ValueError("time: negative times are not allowed")
    for zero in zeros:
        is_separated = 4.0 * zero.radius <= zero.clearance
        if zero.multiplicity > 1 and not (zero.is_real and is_separated):
            raise ValueError(f"characteristic function: zeros near {zero.center} nearly coincide")
    flat = time.ravel()
    at_start = sum(c for power, c in numerator.items() if power > top - 1 - _SAME_POWER)
    result = np.full(flat.shape, at_start / leading)
    clusters = [zero for zero in zeros if zero.multiplicity > 1]
    positive = flat > 0
    # A double zero on the positive axis is kept inside the contour, or well outside.
    close = np.zeros(flat.shape, dtype=bool)
    for cluster in clusters:
        close |= flat * float(cluster.center.real) < 0.75 * _SHIFT
    for shift, chosen in ((0.0, positive & ~close), (_SHIFT, positive & close)):
        indices = np.flatnonzero(chosen)
        for start in range(0, len(indices), _CHUNK):
            part = indices[start : start + _CHUNK]
            outside = [
                zero
                for zero in zeros
                if zero.multiplicity == 1 or not shift or zero not in clusters
            ]
            # A growing response may leave the range of doubles, and is not finite from there on.
            with np.errstate(over="ignore", under="ignore", invalid="ignore"):
                result[part] = _one_chunk(
                    characteristic,
                    tuple(outside),
                    numerator,
                    flat[part],
                    shift,
                    decay,
                    has_clusters=bool(clusters),
                )
    return result.reshape(time.shape)


def _one_chunk(
    characteristic: AnyCharacteristic,
    zeros: tuple[ZeroCluster, ...],
    numerator: Mapping[float, float],
    time: Array,
    shift: float,
    decay: float,
    *,
    has_clusters: bool,
) -> Array:
    steepest = max(-min(numerator), 0.0) if numerator else 0.0
    # e^z n!/z^(n+1) is of the size of its integral where z is about n + 1.
    vertex = 1.2 if has_clusters else min(max(steepest, 1.2), 10.0)
    scale = vertex / (1.0 - math.sin(_ANGLE))
    simple = [zero for zero in zeros if zero.multiplicity == 1]
    residues = [_residue(characteristic, zero, numerator, time, decay) for zero in simple]
    positions = [_preimage(complex(zero.center), time, scale, shift) for zero in simple]
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
    result = np.empty(time.shape)
    for index, (spacing, offset) in enumerate(candidates):
        chosen = best == index
        if not np.any(chosen):
            continue
        value = _trapezoidal_sum(
            characteristic, numerator, time[chosen], scale, shift, spacing, offset
        ) * np.exp(-decay * time[chosen])
        for zero, residue, factor in zip(simple, residues, factors[index], strict=True):
            correction = residue[chosen] / (1.0 - factor[chosen])
            value += (1.0 if zero.is_real else 2.0) * correction.real
        result[chosen] = value
    for zero in zeros:
        if zero.multiplicity > 1:
            result += _cluster_residues(characteristic, zero, numerator, time, decay)
    return result


def _preimage(s: complex, time: Array, scale: float, shift: float) -> ComplexArray:
    z = s * time
    # z = shift + scale (1 + sin(i u - angle)); Im u > 0 lies inside, on the side of the cut.
    return np.asarray(-1j * (np.arcsin((z - shift) / scale - 1.0) + _ANGLE))


def _trapezoidal_sum(
    characteristic: AnyCharacteristic,
    numerator: Mapping[float, float],
    time: Array,
    scale: float,
    shift: float,
    spacing: float,
    offset: float,
) -> Array:
    last = math.acosh((_DECAY / scale + 1.0) / math.sin(_ANGLE))
    u = spacing * (offset + np.arange(int(last / spacing) + 2))
    weights = np.where(u == 0, 0.5, 1.0)
    z = shift + scale * (1.0 + np.sin(1j * u - _ANGLE))
    weights = weights * np.exp(z) * np.cos(1j * u - _ANGLE) * (spacing * scale / math.pi)
    top = np.zeros((len(time), len(u)), dtype=complex)
    bottom = np.zeros((len(time), len(u)), dtype=complex)
    highest = characteristic.terms[0][0]
    for power, coefficient in numerator.items():
        top += (coefficient * time ** (highest - 2.0 - power))[:, None] * z**power
    for power, coefficient in characteristic.terms:
        # Multiplied by a power of t, so that the largest term is of order one at small times.
        bottom += (coefficient * time ** (highest - power))[:, None] * z**power
    return np.asarray(((top / bottom) @ weights).real * time)


def _residue(
    characteristic: AnyCharacteristic,
    zero: ZeroCluster,
    numerator: Mapping[float, float],
    time: Array,
    decay: float,
) -> ComplexArray:
    """Residue of N/P e^(st) at a simple zero, with the exponential in extended precision."""
    center = np.array([zero.center])
    slope = {power - 1.0: power * c for power, c in characteristic.terms if power}
    constant = (evaluate_powers(numerator, center) / evaluate_powers(slope, center))[0]
    values = constant * np.exp((zero.center - decay) * time.astype(np.longdouble))
    return np.asarray(values, dtype=complex)


def _cluster_residues(
    characteristic: AnyCharacteristic,
    cluster: ZeroCluster,
    numerator: Mapping[float, float],
    time: Array,
    decay: float,
) -> Array:
    """All residues of a cluster on the positive axis, by a circle round it."""
    nodes = np.exp(2j * np.pi * (np.arange(96) + 0.5) / 96)
    center = float(cluster.center.real)
    radius = np.clip(2.0 / time, 2.0 * cluster.radius * center, 0.5 * cluster.clearance * center)
    s = (center + radius[:, None] * nodes).astype(np.clongdouble)
    quotient = evaluate_powers(numerator, s) / evaluate_powers(dict(characteristic.terms), s)
    integrand = quotient * np.exp((s - decay) * time[:, None]) * nodes
    return np.asarray(integrand.real.mean(axis=1) * radius, dtype=float)
