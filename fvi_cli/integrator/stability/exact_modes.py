"""The modes of exact linear scenes that grow."""

from __future__ import annotations

import math
from dataclasses import dataclass

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


@dataclass(frozen=True, kw_only=True, eq=False)
class HalfPlane:
    r"""The characteristic determinant of the exact scene on the right half-plane as a disc.

    :math:`s = c (1 + \zeta) / (1 - \zeta)`; divided by :math:`(s + c)^{2 d}` the determinant of
    :math:`s^2 M + \sum_j s^{\gamma_j} D_j + K` is analytic in the disc and det M at 1.

    Parameters
    ----------
    system
        The scene.
    scale
        c > 0, of the size of the largest zero.
    """

    system: MatrixPencil
    scale: float

    def log_determinant(self, zeta: ComplexArray) -> ComplexArray:
        """Logarithm of the determinant divided by (s + c)^(2 d)."""
        s = self.frequency(zeta)[:, None, None]
        matrix = s**2 * self.system.mass + self.system.stiffness
        for order, coefficient in self.system.damping:
            matrix = matrix + s**order * coefficient
        return log_determinants(matrix / (s + self.scale) ** 2)

    def frequency(self, zeta: ComplexArray) -> ComplexArray:
        """The s that belong to points of the disc."""
        return np.asarray(self.scale * (1.0 + zeta) / (1.0 - zeta))

    def radius(self, growth: float) -> float:
        """Radius of the disc that holds the zeros with Re s > `growth` on the real axis."""
        ratio = growth / self.scale
        return (1.0 - ratio) / (1.0 + ratio)


def half_plane(system: MatrixPencil, step_size: float) -> HalfPlane:
    """The half-plane on a scale at which no zero is larger than c, or no step of h can follow."""
    fastest, sizes = LARGEST_FREQUENCY / step_size, system.sizes
    # where s^2 outweighs all other terms
    scale = largest_root(*map(np.array, zip(*sizes, strict=True))) if sizes else math.inf
    return HalfPlane(system=system, scale=min(scale, fastest))


def growing_frequencies(
    system: MatrixPencil, final_time: float, step_size: float
) -> ComplexArray | None:
    r"""Zeros s of the exact scene with Re s > 0 that a step of this size can follow.

    Parameters
    ----------
    system
        The scene's matrices.
    final_time, step_size
        T and h: growth by less than a tenth over T is none, and zeros with
        :math:`|\mathrm{Im}\, s| h \ge \pi` are left out.

    Returns
    -------
    ComplexArray or None
        None where the zeros cannot be told apart.
    """
    if system.is_dissipative:
        return NO_FREQUENCIES
    plane = half_plane(system, step_size)
    least = LEAST_GROWTH / final_time
    if least >= plane.scale:
        return NO_FREQUENCIES
    # a little different where a zero lies on the circle itself
    for nudge in (1.0, 1.1, 0.9):
        radius = plane.radius(least * nudge)
        try:
            zeros = find_zeros(plane.log_determinant, radius, 4 * system.dimension)
        except ZeroCountError:
            continue
        if zeros is not None:
            s = plane.frequency(zeros)
            return np.asarray(s[np.abs(s.imag) * step_size < math.pi])
    return None


def largest_rate(system: MatrixPencil, frequencies: ComplexArray | None, step_size: float) -> float:
    """Largest Re s of the :func:`growing_frequencies` of a system; 0 where none grows."""
    if frequencies is None:
        # what cannot be told apart is not held against the method
        return half_plane(system, step_size).scale
    return float(frequencies.real.max(initial=0.0))
