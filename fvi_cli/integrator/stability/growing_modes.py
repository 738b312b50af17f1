"""The modes of the step equations that grow, of one system or of very many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinant import (
    MatrixPencil,
    number_of_unknowns,
    step_determinant,
)
from fvi_cli.integrator.stability.region import modal_family
from fvi_cli.mathematics.transforms.argument import LogFunction
from fvi_cli.mathematics.transforms.disc_zeros import (
    ZeroCountError,
    enclosed_zero_modulus,
    zeros_in_disc,
)
from fvi_cli.mathematics.transforms.many_discs import UNDECIDED, count_zeros_of_many

FEW = 8
"""Systems up to which each of them is looked at by itself."""

FASTEST = 700.0
"""Growth per step, as a logarithm, beyond every number."""

# a little different where a zero lies on the circle itself
_SHARES = (10.0, 10.7, 9.1)
_ROUNDS = 40


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
    if len(systems) > FEW and all(system.mass.shape[0] == 1 for system in systems):
        count, suspects = _growing_among_many(systems, method, step_size, n_steps)
    else:
        count, suspects = 0, list(systems)
    each = [
        _of_one(
            step_determinant(system, method, step_size), n_steps, number_of_unknowns(system, method)
        )
        for system in suspects
    ]
    return GrowingModes(
        count=count or sum(modes.count for modes in each),
        growth=max((modes.growth for modes in each), default=0.0),
    )


def _of_one(log_determinant: LogFunction, n_steps: int, degree: int) -> GrowingModes:
    for share in _SHARES:
        radius = 1.0 - 1.0 / (share * n_steps)
        try:
            found = zeros_in_disc(log_determinant, radius, degree)
            if found.count == 0:
                return GrowingModes(count=0, growth=0.0)
            if found.zeros is None:
                modulus = enclosed_zero_modulus(log_determinant, radius, degree)
            else:
                modulus = float(np.abs(found.zeros[0]))
        except ZeroCountError:
            continue
        growth = -math.log(modulus) if modulus > 0 else FASTEST
        return GrowingModes(count=found.count, growth=growth)
    raise ZeroCountError("a mode lies too close to the circle of no growth to be counted")


def _growing_among_many(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float, n_steps: int
) -> tuple[int, list[MatrixPencil]]:
    """Number of growing modes of scalar systems, and those systems that may have the worst."""
    family = modal_family(systems, method, step_size)
    degree = number_of_unknowns(systems[0], method)
    counts = np.full(len(systems), UNDECIDED)
    for share in _SHARES:
        left = np.flatnonzero(counts == UNDECIDED)
        if left.size:
            radius = 1.0 - 1.0 / (share * n_steps)
            counts[left] = count_zeros_of_many(family.part(left), left.size, radius, degree)
    if np.any(counts == UNDECIDED):
        raise ZeroCountError("a mode lies too close to the circle of no growth to be counted")
    suspects = np.flatnonzero(counts)
    low, high = math.log(0.1 / n_steps), math.log(20.0)
    for _ in range(_ROUNDS):
        if suspects.size <= FEW:
            break
        middle = 0.5 * (low + high)
        radius = math.exp(-math.exp(middle))
        faster = count_zeros_of_many(family.part(suspects), suspects.size, radius, degree) != 0
        if faster.any():
            suspects, low = suspects[faster], middle
        else:
            high = middle
    return int(counts.sum()), [systems[index] for index in suspects[: 4 * FEW]]
