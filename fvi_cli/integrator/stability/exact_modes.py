"""The modes of exact linear scenes that grow."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.integrator.stability.determinants import log_determinants
from fvi_cli.integrator.stability.systems import MatrixPencil
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.transforms.zeros import ZeroCountError, find_zeros, largest_root

LARGEST_FREQUENCY = 1e3
"""Times the step size: faster growth of the exact scene is beyond every method and number."""

LEAST_GROWTH = 0.05
"""Logarithm of the growth over the whole time that is none."""

NO_FREQUENCIES: ComplexArray = np.empty(0, dtype=np.complex128)


def growing_frequencies(
    system: MatrixPencil, final_time: float, step_size: float
) -> ComplexArray | None:
    r"""Zeros s of the exact scene with Re s > 0 that a step h can follow, :math:`|Im s| h < \pi`.

    By :math:`s = c (1 + \zeta) / (1 - \zeta)` the right half-plane is a disc, in which the
    determinant of :math:`s^2 M + \sum_j s^{\gamma_j} D_j + K`, divided by :math:`(s + c)^{2 d}`,
    is analytic; it is det M at 1. Growth by less than a twentieth over `final_time` is none. None
    where the zeros cannot be told apart.
    """
    if system.is_dissipative:
        return NO_FREQUENCIES
    least, c = LEAST_GROWTH / final_time, _scale(system, step_size)
    if least >= c:
        return NO_FREQUENCIES

    def frequency(zeta: ComplexArray) -> ComplexArray:
        return np.asarray(c * (1.0 + zeta) / (1.0 - zeta))

    def log_determinant(zeta: ComplexArray) -> ComplexArray:
        s = frequency(zeta)[:, None, None]
        matrix = s**2 * system.mass + system.stiffness
        for order, coefficient in system.damping:
            matrix = matrix + s**order * coefficient
        return log_determinants(matrix / (s + c) ** 2)

    # a little different where a zero lies on the circle itself
    for nudge in (1.0, 1.1, 0.9):
        ratio = nudge * least / c
        try:
            zeros = find_zeros(log_determinant, (1.0 - ratio) / (1.0 + ratio), 4 * system.dimension)
        except ZeroCountError:
            continue
        if zeros is not None:
            s = frequency(zeros)
            return np.asarray(s[np.abs(s.imag) * step_size < math.pi])
    return None


def _scale(system: MatrixPencil, step_size: float) -> float:
    """The c at which no zero is larger, or no step of h can follow."""
    fastest, sizes = LARGEST_FREQUENCY / step_size, system.sizes
    # where s^2 outweighs all other terms
    scale = largest_root(*map(np.array, zip(*sizes, strict=True))) if sizes else math.inf
    return min(scale, fastest)


def largest_rate(system: MatrixPencil, frequencies: ComplexArray | None, step_size: float) -> float:
    """Largest Re s of the :func:`growing_frequencies` of a system; 0 where none grows."""
    if frequencies is None:
        # what cannot be told apart is not held against the method
        return _scale(system, step_size)
    return float(frequencies.real.max(initial=0.0))
