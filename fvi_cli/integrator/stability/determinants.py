r"""Determinants of the step equations of linear systems, as functions of z.

The equations are those of :mod:`fvi_cli.integrator.stability.patterns`. A zero in
:math:`|z| < 1`, where the determinant is analytic, is a mode that grows by :math:`1 / |z|` in a
step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import decouple_forms
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.stability.patterns import Patterns, step_patterns
from fvi_cli.mathematics.arrays import Array, ComplexArray, Integers

ENTRIES_AT_ONCE = 2_000_000
"""Most entries of the matrices whose determinants are computed together: some 32 MB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystems:
    r"""Systems :math:`M x'' + \sum_j \mu_j D^{\gamma_j} x + K x = 0` of one size."""

    orders: tuple[float, ...]  # gamma_j
    forms: Array  # M, K, mu_1, mu_2, ... of every system, (number, 2 + len(orders), d, d)


def independent_systems(scene: Scene) -> LinearSystems:
    """The independent systems of a linear scene, equal ones once; or the whole, if it is coupled.

    If there are several, each has one component.
    """
    sums: dict[float, Array] = {}
    for term in scene.active_damping:
        sums[term.order] = sums.get(term.order, 0.0) + term.matrix.T
    sums = {order: matrix for order, matrix in sums.items() if matrix.any()}
    whole = (scene.inertia.mass, scene.stiffness, *sums.values())
    parts = decouple_forms(whole[0], whole[1], whole[2:])
    forms = np.array([whole])
    if parts is not None:
        forms = np.stack([parts.matrices(form) for form in whole], axis=1)
        digits = np.char.mod("%.12e", forms.reshape(len(forms), -1))
        forms = forms[np.sort(np.unique(digits, axis=0, return_index=True)[1])]
    return LinearSystems(orders=tuple(sums), forms=forms)


@dataclass(frozen=True, kw_only=True, eq=False)
class StepDeterminants:
    """Step determinants of systems of one size with the same orders of damping."""

    patterns: Patterns
    forms: Array  # matrices that belong to the patterns, (number of systems, patterns, d, d)
    degree: int  # about how many zeros each has

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
        logarithms = np.empty(row.size, dtype=np.complex128)
        at_once = max(1, ENTRIES_AT_ONCE // (n * n + table[0].size))
        for begin in range(0, row.size, at_once):
            part = slice(begin, begin + at_once)
            patterns, forms = table[row[part]], self.forms[number[part]]
            k, i, a, d = *patterns.shape[:3], forms.shape[-1]
            whole = patterns.reshape(k, i, -1).swapaxes(1, 2) @ forms.reshape(k, i, -1)
            whole = whole.reshape(k, a, a, d, d).swapaxes(2, 3)
            logarithms[part] = log_determinants(whole.reshape(-1, n, n))
        return logarithms.reshape(rows.shape)


def step_determinants(
    systems: LinearSystems, method: AnyMethod, step_size: float
) -> StepDeterminants:
    r"""Step determinants of systems, one for each.

    The forms are M, :math:`h^2 K` and :math:`h^{2-\gamma_j} \mu_j`, relative to the size of M.
    """
    powers = np.array([0.0, 2.0, *(2.0 - order for order in systems.orders)])
    sizes = np.abs(systems.forms[:, 0]).max(axis=(1, 2))
    factors = step_size**powers / sizes[:, None]
    # zeros: the unknowns of a step, and the turns of the powers of a symbol
    turns = 0.0
    if not isinstance(method, Baseline) and not method.is_runge_kutta:
        turns = method.bdf_order * max(systems.orders, default=0.0)
    zeros = 2 if isinstance(method, Baseline) else method.degree + 2 + math.ceil(turns)
    return StepDeterminants(
        patterns=step_patterns(method, systems.orders),
        forms=factors[:, :, None, None] * systems.forms,
        degree=zeros * systems.forms.shape[-1],
    )


def log_determinants(matrices: ComplexArray) -> ComplexArray:
    """Logarithms of determinants, shape ``(..., n, n)`` to ``(...,)``."""
    # rows are scaled to one size, so that a large row does not hide the others
    sizes = np.abs(matrices).max(axis=-1)
    sizes = np.where(sizes == 0, 1.0, sizes)
    with np.errstate(divide="ignore"):
        sign, logarithm = np.linalg.slogdet(matrices / sizes[..., None])
        logarithm = logarithm + np.log(sizes).sum(axis=-1)
    return np.asarray(logarithm + 1j * np.angle(sign))
