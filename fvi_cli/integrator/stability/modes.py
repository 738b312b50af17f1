"""The modes that grow: of exact linear scenes, and of the equations of steps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinants import (
    StepDeterminants,
    log_determinants,
    step_determinants,
)
from fvi_cli.integrator.stability.systems import MatrixPencil
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.transforms.zeros import (
    UNDECIDED,
    ZeroCountError,
    count_zeros,
    find_zeros,
    largest_root,
)

LARGEST_FREQUENCY = 1e3
"""Largest frequency times step size: faster growth is beyond every method and every number."""

LEAST_GROWTH = 0.05
"""Logarithm of the growth over the whole time; less growth does not count."""

NO_FREQUENCIES: ComplexArray = np.empty(0, dtype=np.complex128)


def growing_frequencies(
    system: MatrixPencil, final_time: float, step_size: float
) -> ComplexArray | None:
    r"""Zeros s of the exact scene with Re s > 0 that a step h can follow, :math:`|Im s| h < \pi`.

    By :math:`s = c (1 + \zeta) / (1 - \zeta)` the right half-plane is a disc, in which the
    determinant of :math:`s^2 M + \sum_j s^{\gamma_j} D_j + K`, divided by :math:`(s + c)^{2 d}`,
    is analytic; it is det M at 1. Growth by less than a twentieth over `final_time` does
    not count. None if the zeros cannot be separated.
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
    """A c such that no zero is larger, or no step h can follow a larger one."""
    fastest, sizes = LARGEST_FREQUENCY / step_size, system.sizes
    # where s^2 outweighs all other terms
    scale = largest_root(*map(np.array, zip(*sizes, strict=True))) if sizes else math.inf
    return min(scale, fastest)


def largest_rate(system: MatrixPencil, frequencies: ComplexArray | None, step_size: float) -> float:
    """Largest Re s of the :func:`growing_frequencies` of a system; 0 where none grows."""
    if frequencies is None:
        # modes that cannot be separated do not count against the method
        return _scale(system, step_size)
    return float(frequencies.real.max(initial=0.0))


FASTEST = 700.0
"""Growth per step, as a logarithm, that exceeds every number."""

FEW = 8
"""Most modes that are all located, to find the worst."""

ACCURACY = 1e-9
"""Relative accuracy of the growth of modes that cannot be separated."""

# a little different where a zero lies on the circle itself
_SHARES = (10.0, 10.7, 9.1)


@dataclass(frozen=True)
class GrowingModes:
    """Modes that grow by a tenth or more over the run."""

    count: int  # with multiplicity
    growth: float  # log(1/|z|) of the worst; 0 where none grows
    zeros: Sequence[ComplexArray | None]  # z of the modes of every system, where they were located


def growing_modes(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, n_steps: int
) -> GrowingModes:
    """The growing modes of independent systems in steps of `method`.

    Raises
    ------
    ZeroCountError
        Where they cannot be counted.
    """
    determinants = step_determinants(systems, method, step_size)
    counts = np.full(len(systems), UNDECIDED)
    for share in _SHARES:
        left = np.flatnonzero(counts == UNDECIDED)
        if left.size:
            counts[left] = count_zeros(determinants[left], 1.0 - 1.0 / (share * n_steps))
    if np.any(counts == UNDECIDED):
        raise ZeroCountError("a mode lies too close to the circle of no growth to be counted")
    count = int(counts.sum())
    zeros: list[ComplexArray | None] = [NO_FREQUENCIES] * len(systems)
    if not count:
        return GrowingModes(0, 0.0, zeros)
    which, least = np.flatnonzero(counts), -math.log1p(-1.0 / (_SHARES[-1] * n_steps))
    if count <= FEW and (located := _located(determinants[which], least)) is not None:
        for index, own in zip(which.tolist(), located, strict=True):
            zeros[index] = own
        return GrowingModes(count, _fastest(located), zeros)
    return GrowingModes(count, _worst(determinants[which], least, count), [None] * len(zeros))


def _worst(determinants: StepDeterminants, low: float, count: int) -> float:
    """Growth of the worst mode, which exceeds `low`: located where fewer modes are that fast."""
    high, tried = FASTEST, count
    while high > (1.0 + ACCURACY) * low:
        middle = math.sqrt(low * high)
        counts = count_zeros(determinants, math.exp(-middle))
        if counts.any():
            determinants = determinants[np.flatnonzero(counts)]
            low, count = middle, int(np.abs(counts).sum())
        else:
            high = middle
        if count <= FEW and count != tried:
            tried = count
            if (located := _located(determinants, low)) is not None:
                return _fastest(located)
    return low


def _located(determinants: StepDeterminants, growth: float) -> list[ComplexArray] | None:
    """The modes that grow faster, of every system; None where they cannot be separated."""
    found: list[ComplexArray] = []
    for number in range(determinants.number):
        try:
            zeros = find_zeros(determinants.of(number), math.exp(-growth), determinants.degree)
        except ZeroCountError:
            return None
        if zeros is None:
            return None
        found.append(zeros)
    return found if any(one.size for one in found) else None


def _fastest(zeros: Sequence[ComplexArray]) -> float:
    smallest = min(float(np.abs(one).min(initial=math.inf)) for one in zeros)
    return -math.log(smallest) if smallest > math.exp(-FASTEST) else FASTEST
