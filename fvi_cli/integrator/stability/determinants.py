r"""Determinants of the step equations of linear systems, as functions of z.

The equations are those of :mod:`fvi_cli.integrator.stability.patterns`. A zero in
:math:`|z| < 1`, where the determinant is analytic, is a mode that grows by :math:`1 / |z|` in a
step.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.stability.patterns import Patterns, step_patterns
from fvi_cli.integrator.stability.systems import MatrixPencil
from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers

ENTRIES_AT_ONCE = 2_000_000
"""Most entries of the matrices whose determinants are computed together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepDeterminants:
    """Step determinants of systems of one size with the same orders of damping."""

    patterns: Patterns
    forms: Array  # matrices that belong to the patterns, (number of systems, patterns, d, d)
    degree: int

    @property
    def number(self) -> int:
        """How many systems."""
        return len(self.forms)

    def __getitem__(self, which: Integers) -> StepDeterminants:
        return replace(self, forms=self.forms[which])

    def tabulate(self, z: ComplexArray) -> ComplexArray:
        """The patterns at each z."""
        return self.patterns(z)

    def logarithms(self, table: ComplexArray, rows: Integers, numbers: Integers) -> ComplexArray:
        """Logarithms of determinants of sums of Kronecker products."""
        rows, numbers = np.broadcast_arrays(rows, numbers)
        row, number, n = rows.ravel(), numbers.ravel(), table.shape[-1] * self.forms.shape[-1]
        found = np.empty(row.size, dtype=np.complex128)
        at_once = max(1, ENTRIES_AT_ONCE // (n * n + table[0].size))
        for begin in range(0, row.size, at_once):
            part = slice(begin, begin + at_once)
            patterns, forms = table[row[part]], self.forms[number[part]]
            k, i, a, d = *patterns.shape[:3], forms.shape[-1]
            whole = patterns.reshape(k, i, -1).swapaxes(1, 2) @ forms.reshape(k, i, -1)
            whole = whole.reshape(k, a, a, d, d).swapaxes(2, 3)
            found[part] = log_determinants(whole.reshape(-1, n, n))
        return found.reshape(rows.shape)


def log_determinants(matrices: ComplexArray) -> ComplexArray:
    """Logarithms of determinants, shape ``(..., n, n)`` to ``(...,)``."""
    # rows are scaled to one size, so that a large row does not hide the others
    sizes = np.abs(matrices).max(axis=-1)
    sizes = np.where(sizes == 0, 1.0, sizes)
    with np.errstate(divide="ignore"):
        sign, logarithm = np.linalg.slogdet(matrices / sizes[..., None])
        logarithm = logarithm + np.log(sizes).sum(axis=-1)
    return np.asarray(logarithm + 1j * np.angle(sign))


def step_determinants(
    systems: Sequence[MatrixPencil], method: AnyMethod, step_size: float | Array
) -> StepDeterminants:
    r"""Step determinants of systems with one step size, or of one system with many.

    The forms are M, :math:`h^2 K` and :math:`h^{2-\gamma_j} D_j`, relative to the size of M; the
    damping of all systems has the same orders.
    """
    first = systems[0]
    orders = tuple(order for order, _ in first.damping)
    h = np.asarray(step_size)[..., None, None]
    mass = np.array([system.mass for system in systems])
    scale = np.abs(mass).max(axis=(1, 2), keepdims=True)
    stiffness = h * h / scale * np.array([system.stiffness for system in systems])
    damping = [
        h ** (2.0 - order) / scale * np.array([system.damping[j][1].T for system in systems])
        for j, order in enumerate(orders)
    ]
    forms = np.broadcast_arrays(mass / scale, stiffness, *damping)
    return StepDeterminants(
        patterns=step_patterns(method, orders),
        forms=np.stack(forms, axis=1),
        degree=_degree(method, orders) * first.dimension,
    )


def _degree(method: AnyMethod, orders: tuple[float, ...]) -> int:
    """About how many zeros a determinant has: its unknowns, and the turns of a symbol's powers."""
    if isinstance(method, Baseline):
        return 2
    turns = 0.0 if method.is_runge_kutta else method.bdf_order * max(orders, default=0.0)
    return method.degree + 2 + math.ceil(turns)


def plane_determinants(
    method: AnyMethod, order: float, stiffness: Array, damping: Array
) -> StepDeterminants:
    r"""Determinants at n points :math:`(h^2 k / m, h^{2 - \gamma} \mu / m)` of a plane."""
    forms = np.stack([np.ones_like(stiffness), stiffness, damping], axis=1)
    return StepDeterminants(
        patterns=step_patterns(method, (order,)),
        forms=forms[..., None, None],
        degree=_degree(method, (order,)),
    )
