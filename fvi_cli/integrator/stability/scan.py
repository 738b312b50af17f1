r"""At which of many step sizes a run may be unstable.

Windows of instability lie between stable steps, so that halving a step may find none. The zeros of
the step determinants of all steps in question are counted at once; those with zeros are then
predicted one by one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinant import (
    MatrixPencil,
    dimensionless_forms,
    log_determinants,
    number_of_unknowns,
)
from fvi_cli.integrator.stability.patterns import Patterns, step_patterns
from fvi_cli.integrator.stability.region import plane_family
from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers
from fvi_cli.mathematics.transforms.many_discs import Family, count_zeros_of_many

EVERY_UP_TO = 200
"""Numbers of steps up to which each is looked at."""

SPACING = 0.005
"""Relative distance of the steps that are looked at beyond: windows that are wider are seen."""

FEW = 8
"""Independent systems of a scene up to which that is so."""

WIDE_SPACING = 0.05
"""The same of more systems, and of scenes that are fed."""

_BLOCK = 2.0
"""Ratio of the numbers of steps that are looked at together."""
_FASTEST = 300.0
"""Growth per step, as a logarithm, that nothing exceeds which is counted."""
_MOST_ENTRIES = 2_000_000


def numbers_of_steps(fewest: int, most: int, *, is_wide: bool = False) -> Integers:
    """Those that are looked at, increasing."""
    spacing, every = (WIDE_SPACING, EVERY_UP_TO // 4) if is_wide else (SPACING, EVERY_UP_TO)
    each = np.arange(fewest, min(most, every) + 1)
    if most <= every:
        return each
    first = max(fewest, every)
    count = 1 + math.ceil(math.log(most / first) / math.log1p(spacing))
    return np.unique(np.concatenate([each, np.geomspace(first, most, count).round().astype(int)]))


def suspects(
    systems: Sequence[MatrixPencil],
    method: AnyMethod,
    final_time: float,
    numbers: Integers,
    growth: Array,
) -> Iterator[int]:
    """Numbers of steps, decreasing, at which a mode grows too fast, or where that is not known.

    Parameters
    ----------
    systems, method, final_time
        Independent systems, how they are integrated, and T.
    numbers
        Numbers of steps N, increasing.
    growth
        Logarithm of the growth over the run that is permitted at each N, shape ``(n,)``.
    """
    end = numbers.size
    while end:
        begin = int(np.searchsorted(numbers, numbers[end - 1] / _BLOCK))
        some = numbers[begin:end]
        # one circle for all: that of the slowest growth
        slowest = float((growth[begin:end] / some).min())
        if slowest > _FASTEST:
            end = begin
            continue
        grows = grow_faster(systems, method, final_time / some, slowest)
        yield from some[grows][::-1].tolist()
        end = begin


def grow_faster(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_sizes: Array, growth: float
) -> NDArray[np.bool_]:
    """At which step sizes a mode grows by more than this in a step, or may, a logarithm."""
    grows = np.zeros(step_sizes.size, dtype=bool)
    for system in systems:
        left = np.flatnonzero(~grows)
        if left.size:
            family = _family(system, method, step_sizes[left])
            degree = number_of_unknowns(system, method)
            counts = count_zeros_of_many(family, left.size, math.exp(-growth), degree)
            grows[left] = counts != 0
    return grows


def _family(system: MatrixPencil, method: AnyMethod, step_sizes: Array) -> Family:
    """The determinants of one system over step sizes."""
    if system.mass.shape[0] == 1 and len(system.damping) == 1:
        ((order, coefficient),) = system.damping
        mass = float(system.mass[0, 0])
        return plane_family(
            method,
            order,
            step_sizes**2 * float(system.stiffness[0, 0]) / mass,
            step_sizes ** (2.0 - order) * float(coefficient[0, 0]) / mass,
        )
    return StepFamily(
        patterns=step_patterns(method, tuple(order for order, _ in system.damping)),
        forms=np.array([dimensionless_forms(system, float(h)) for h in step_sizes]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class StepFamily:
    """Step determinants of a system over step sizes.

    Parameters
    ----------
    patterns
        Of the method for the orders of the system.
    forms
        Matrices of the patterns at each step size, shape ``(n, patterns, d, d)``.
    """

    patterns: Patterns
    forms: Array

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """The patterns at each z."""
        return self.patterns(z)

    def all_logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the determinants at these step sizes at every row."""
        rows = np.arange(table.shape[0])
        pairs = np.repeat(functions, rows.size), np.tile(rows, functions.size)
        entries = (table.shape[-1] * self.forms.shape[-1]) ** 2 + table[0].size
        number = 1 + pairs[0].size * entries // _MOST_ENTRIES
        parts = [
            self.logarithms(table[row], function)
            for function, row in zip(*(np.array_split(one, number) for one in pairs), strict=True)
        ]
        return np.concatenate(parts).reshape(functions.size, rows.size)

    def logarithms(self, table: ComplexArray, functions: Integers) -> ComplexArray:
        """Logarithms of the determinants, one step size for each row."""
        n, d = table.shape[-1], self.forms.shape[-1]
        whole = np.einsum("kiab,kicd->kacbd", table, self.forms[functions], optimize=True)
        return log_determinants(whole.reshape(-1, n * d, n * d))
