"""The modes of the step equations that grow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinants import StepDeterminants, step_determinants
from fvi_cli.integrator.stability.systems import MatrixPencil
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


@dataclass(frozen=True)
class GrowingModes:
    """What grows by a tenth or more over the run."""

    count: int  # with multiplicity
    growth: float  # log(1/|z|) of the worst; 0 where none grows


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
    if not count:
        return GrowingModes(0, 0.0)
    least = -math.log1p(-1.0 / (_SHARES[-1] * n_steps))
    return GrowingModes(count, _worst(determinants[np.flatnonzero(counts)], least, count))


def _worst(determinants: StepDeterminants, low: float, count: int) -> float:
    """Growth of the worst mode, which exceeds `low`: located where few modes are that fast."""
    high, located = FASTEST, 0
    while high > (1.0 + ACCURACY) * low:
        if count <= FEW and count != located:
            growth, located = _located(determinants, math.exp(-low)), count
            if growth is not None:
                return growth
        middle = math.sqrt(low * high)
        counts = count_zeros(determinants, math.exp(-middle))
        if counts.any():
            determinants = determinants[np.flatnonzero(counts)]
            low, count = middle, int(np.abs(counts).sum())
        else:
            high = middle
    return low


def _located(determinants: StepDeterminants, radius: float) -> float | None:
    """The same by the modes themselves; None where they cannot be told apart."""
    smallest = math.inf
    for number in range(determinants.number):
        try:
            zeros = find_zeros(determinants.of(number), radius, determinants.degree)
        except ZeroCountError:
            return None
        if zeros is None:
            return None
        smallest = min(smallest, float(np.abs(zeros).min(initial=math.inf)))
    if smallest == math.inf:
        return None
    return -math.log(smallest) if smallest > math.exp(-FASTEST) else FASTEST
