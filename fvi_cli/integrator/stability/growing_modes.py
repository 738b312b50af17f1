"""The modes of the step equations that grow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinants import (
    number_of_unknowns,
    step_determinant,
    step_determinants,
)
from fvi_cli.integrator.stability.systems import MatrixPencil
from fvi_cli.mathematics.arrays import Integers
from fvi_cli.mathematics.transforms.zeros import (
    UNDECIDED,
    ZeroCountError,
    count_zeros,
    find_zeros,
)

FASTEST = 700.0
"""Growth per step, as a logarithm, beyond every number."""

FEW = 8
"""Modes up to which the worst is found among all."""

ACCURACY = 1e-9
"""Relative, of the growth of modes that cannot be told apart."""

# a little different where a zero lies on the circle itself
_SHARES = (10.0, 10.7, 9.1)


@dataclass(frozen=True, kw_only=True)
class GrowingModes:
    r"""What grows.

    Parameters
    ----------
    count
        Number of modes, with their multiplicity, that grow by a tenth or more over the run.
    growth
        :math:`\log(1/|z|)` of the worst; 0 where none grows.
    """

    count: int
    growth: float


def growing_modes(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, n_steps: int
) -> GrowingModes:
    """The growing modes of independent systems in steps of `method`.

    Raises
    ------
    ZeroCountError
        Where they cannot be counted.
    """
    counts = np.full(len(systems), UNDECIDED)
    for share in _SHARES:
        left = np.flatnonzero(counts == UNDECIDED).tolist()
        if left:
            radius = 1.0 - 1.0 / (share * n_steps)
            counts[left] = _counts([systems[i] for i in left], method, step_size, radius)
    if np.any(counts == UNDECIDED):
        raise ZeroCountError("a mode lies too close to the circle of no growth to be counted")
    count = int(counts.sum())
    if not count:
        return GrowingModes(count=0, growth=0.0)
    suspects = [systems[i] for i in np.flatnonzero(counts).tolist()]
    least = -math.log1p(-1.0 / (_SHARES[-1] * n_steps))
    return GrowingModes(count=count, growth=_worst(suspects, method, step_size, least, count))


def _counts(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, radius: float
) -> Integers:
    degree = number_of_unknowns(systems[0], method)
    determinants = step_determinants(systems, method, step_size)
    return count_zeros(determinants, len(systems), radius, degree)


def _worst(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, low: float, count: int
) -> float:
    """Growth of the worst mode, which exceeds `low`: located where few modes are that fast."""
    high, located = FASTEST, 0
    while high > (1.0 + ACCURACY) * low:
        if count <= FEW and count != located:
            growth, located = _located(systems, method, step_size, math.exp(-low)), count
            if growth is not None:
                return growth
        middle = math.sqrt(low * high)
        counts = _counts(systems, method, step_size, math.exp(-middle))
        faster = np.flatnonzero(counts).tolist()
        if faster:
            systems, low = [systems[i] for i in faster], middle
            count = int(np.abs(counts).sum())
        else:
            high = middle
    return low


def _located(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, radius: float
) -> float | None:
    """The same by the modes themselves; None where they cannot be told apart."""
    degree = number_of_unknowns(systems[0], method)
    smallest = math.inf
    for system in systems:
        try:
            zeros = find_zeros(step_determinant(system, method, step_size), radius, degree)
        except ZeroCountError:
            return None
        if zeros is None:
            return None
        smallest = min(smallest, float(np.abs(zeros).min(initial=math.inf)))
    if smallest == math.inf:
        return None
    return -math.log(smallest) if smallest > math.exp(-FASTEST) else FASTEST
