r"""The equations of one step in matrices that do not depend on the scene.

With :math:`x_k, p_k, \delta_k \sim z^{-k}` the step equations in momentum form become a linear
system for position, momentum and increments,

.. math::
   (1 - z) x - z \delta^s &= 0 \\
   (1 - z) p + z h G &= 0, \qquad
      G = K \Big(x + \sum_{i,\nu} b_i l_\nu(c_i) \delta^\nu\Big) + \sum_i \beta_i F_i \\
   \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu K X_i
     - h \sum_i \beta_i l_\nu F_i + p\, \delta_{\nu 0} &= 0,

where :math:`F = \sum_j h^{-\gamma_j} \gamma_p(z)^{\gamma_j} / (1 - z) \, U \mu_j` for backward
differences, and likewise with :math:`\Delta(z)^{\gamma_j - 1}` for Runge-Kutta methods. Its
determinant is analytic in :math:`|z| < 1`, and a zero z there is a mode that grows by
:math:`1 / |z|` in a step.

It equals the determinant of s equations for :math:`\delta^1, \dots, \delta^{s-1}` and y, with
:math:`\delta^s = (1 - z)\, y` and :math:`x = z y`, in which p is eliminated from the second and
the last equation with :math:`\nu = 0` by their sum. They are

.. math:: A_0 \otimes M + A_1 \otimes h^2 K + \sum_j A_{1+j} \otimes h^{2 - \gamma_j} \mu_j

with small matrices :math:`A_i(z)`, the patterns, whose entries are finite wherever z is.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from fvi_cli.integrator.memory.stages import stage_operator
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.bdf import symbol_at

Patterns = Callable[[ComplexArray], ComplexArray]
Forces = Callable[[ComplexArray], list[ComplexArray]]
"""From points z, ``(k,)``, to the forces by increments, ``(k, m, s)`` for each order."""

_BASELINES: dict[str, Callable[[ComplexArray], tuple[ComplexArray, ComplexArray]]] = {
    "explicit-euler": lambda z: (z * z, z),
    "implicit-euler": lambda z: (np.ones_like(z), np.ones_like(z)),
    "gruenwald-letnikov": lambda z: (z, z),
}
"""Baselines with equations ``(1 - z)^2 M + a h^2 K + b (1 - z)^order h^(2 - order) mu``: a, b."""


def has_patterns(method: AnyMethod) -> bool:
    """Whether the step equations of `method` are known here; those of some baselines are not."""
    return isinstance(method, Method) or method.name in _BASELINES


@functools.lru_cache(maxsize=64)
def step_patterns(method: AnyMethod, orders: tuple[float, ...]) -> Patterns:
    """The patterns for these orders of damping, ``(k,)`` z to ``(k, 2 + len(orders), s, s)``.

    Raises
    ------
    KeyError
        For a method without :func:`has_patterns`.
    """
    if isinstance(method, Baseline):
        return _baseline_patterns(method, orders)
    tables = step_tables(method)
    force_weights = tables.to_loads
    if method.is_runge_kutta:
        force_weights = force_weights @ stage_operator(method.cq, method.stages).to_values
        forces = _staged_forces(method, tables, orders)
    else:
        forces = _sampled_forces(method, tables, orders)
    s = tables.degree
    # coefficients of the increments and x in the equations with nu = 0 to s - 1 and in G
    constant = np.zeros((2, s + 1, s + 1))
    constant[0, :s, :s] = tables.mass_matrix
    constant[1, :s, :s] = -tables.test_weights[:-1] @ tables.basis[1:].T
    constant[1, :s, s] = -tables.test_weights[:-1].sum(axis=1)
    constant[1, s] = np.append(tables.weights @ tables.basis[1:].T, 1.0)
    tests = np.concatenate([-force_weights[:-1], force_weights.sum(axis=0)[None]])

    def patterns(z: ComplexArray) -> ComplexArray:
        whole = np.zeros((z.size, 2 + len(orders), s + 1, s + 1), dtype=np.complex128)
        whole[:, :2] = constant
        for index, force in enumerate(forces(z)):
            whole[:, 2 + index, :, :s] = tests @ force
        at = z[:, None, None]
        last = (1.0 - at) * whole[..., s - 1] + at * whole[..., s]
        columns = np.concatenate([whole[..., : s - 1], last[..., None]], axis=3)
        behind = at * columns[..., s, :] - (1.0 - at) * columns[..., 0, :]
        return np.concatenate([columns[..., 1:s, :], behind[..., None, :]], axis=2)

    return patterns


def _baseline_patterns(method: Baseline, orders: tuple[float, ...]) -> Patterns:
    factors = _BASELINES[method.name]

    def patterns(z: ComplexArray) -> ComplexArray:
        by_stiffness, by_damping = factors(z)
        damping = [by_damping * (1.0 - z) ** order for order in orders]
        return np.stack([(1.0 - z) ** 2, by_stiffness, *damping], axis=1)[..., None, None]

    return patterns


def _sampled_forces(method: Method, tables: StepTables, orders: tuple[float, ...]) -> Forces:
    """Forces of backward differences: from increments to values at samples, and to forces."""
    at_points = tables.sample_basis[1:].T
    # the beginning of a step is the end of the step before
    carried = np.eye(tables.degree)[-1] - at_points

    def forces(z: ComplexArray) -> list[ComplexArray]:
        samples = at_points + z[:, None, None] * carried
        # A(alpha) stability: the symbol keeps away from the cut along the negative axis
        symbol, summed = symbol_at(method.bdf_order, z), 1.0 / (1.0 - z)
        return [(symbol**order * summed)[:, None, None] * samples for order in orders]

    return forces


def _staged_forces(method: Method, tables: StepTables, orders: tuple[float, ...]) -> Forces:
    r"""Forces of Runge-Kutta methods: from increments to stage coefficients, and to forces.

    Between coefficients :math:`\Delta(z)^{-1} = X + z / (1 - z) e_1 e_1^T`: near z = 1 one large
    entry is added to a matrix of moderate ones, whose small eigenvalues are not lost.
    """
    stages = stage_operator(method.cq, method.stages)
    samples = (stages.to_coefficients @ tables.slopes[1:].T).astype(np.complex128)

    def forces(z: ComplexArray) -> list[ComplexArray]:
        inverse_symbols = np.tile(stages.matrix.astype(np.complex128), (z.size, 1, 1))
        inverse_symbols[:, 0, 0] += z / (1.0 - z)
        values, vectors = np.linalg.eig(inverse_symbols)
        to_vectors = np.linalg.solve(vectors, np.broadcast_to(samples, (z.size, *samples.shape)))
        powers = [values[..., None] ** (1.0 - order) for order in orders]
        return [np.asarray(vectors @ (one * to_vectors)) for one in powers]

    return forces
