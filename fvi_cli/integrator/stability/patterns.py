r"""The equations of one step as numbers that do not depend on the scene.

With :math:`x_k, p_k, \delta_k \sim z^{-k}` the step equations in momentum form become a linear
system for position, momentum and increments,

.. math::
   (1 - z) x - z \delta^s &= 0 \\
   (1 - z) p + z h \Big[ K \Big(x + \sum_{i,\nu} b_i l_\nu(c_i) \delta^\nu\Big)
     + \sum_i \beta_i F_i \Big] &= 0 \\
   \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu K X_i
     - h \sum_i \beta_i l_\nu F_i + p\, \delta_{\nu 0} &= 0,

where :math:`F = \sum_j h^{-\gamma_j} \gamma_p(z)^{\gamma_j} / (1 - z) \, U \mu_j` for backward
differences, and likewise with :math:`\Delta(z)^{\gamma_j - 1}` for Runge-Kutta methods. Its
determinant is analytic in :math:`|z| < 1`, and a zero z there is a mode that grows by
:math:`1 / |z|` in a step.

The system is

.. math:: A_0 \otimes 1 + A_1 \otimes M + A_2 \otimes h^2 K
          + \sum_j A_{2+j} \otimes h^{2 - \gamma_j} \mu_j

with small matrices :math:`A_i(z)`, the patterns, in which momenta are counted in units of mass / h.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.integrator.memory.stages import StageOperator
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.step_tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.bdf import symbol_at
from fvi_cli.mathematics.runge_kutta import tableau

Patterns = Callable[[ComplexArray], ComplexArray]
Forces = Callable[[ComplexArray], list[ComplexArray]]
"""Forces of the increments at points z, ``(k, m, s)`` for each order."""

IDENTITY, MASS, STIFFNESS, DAMPING = 0, 1, 2, 3
"""Places of the patterns; those of the damping orders begin at the last one."""

LARGEST_CONDITION = 1e6
"""Eigenvectors worse conditioned than this belong to eigenvalues that meet."""


_BASELINE_SIZES = {"explicit-euler": 2, "implicit-euler": 2, "gruenwald-letnikov": 1}
"""Unknowns of a step of those baselines whose step equations are known here."""


def has_patterns(method: AnyMethod) -> bool:
    """Whether the step equations of `method` are known here; those of some baselines are not."""
    return not isinstance(method, Baseline) or method.name in _BASELINE_SIZES


def pattern_size(method: AnyMethod) -> int:
    """Rows of a pattern: position, momentum and the increments of a step."""
    return _BASELINE_SIZES[method.name] if isinstance(method, Baseline) else method.degree + 2


@functools.lru_cache(maxsize=64)
def step_patterns(method: AnyMethod, orders: tuple[float, ...]) -> Patterns:
    """The patterns for these orders of damping, ``(k,)`` z to ``(k, 3 + len(orders), n, n)``.

    Raises
    ------
    ValueError
        For a method without :func:`has_patterns`.
    """
    if not has_patterns(method):
        raise ValueError(f"method: the step equations of {method_name(method)} are not known here")
    if isinstance(method, Baseline):
        if method.name == "gruenwald-letnikov":
            return _central_patterns(orders)
        return _euler_patterns(method, orders)
    tables = step_tables(method)
    force_weights = tables.sample_test_weights
    if method.is_runge_kutta:
        stages = StageOperator(tableau=tableau(method.cq, method.stages))
        force_weights = force_weights @ stages.to_values
        forces = _staged_forces(stages, tables, orders)
    else:
        forces = _sampled_forces(method, tables, orders)
    s = tables.degree
    n = s + 2
    constant = np.zeros((DAMPING, n, n))
    linear = np.zeros((DAMPING, n, n))
    x, p, u = 0, 1, slice(2, n)
    constant[IDENTITY, x, x], linear[IDENTITY, x, x] = 1.0, -1.0
    linear[IDENTITY, x, n - 1] = -1.0
    constant[IDENTITY, p, p], linear[IDENTITY, p, p] = 1.0, -1.0
    constant[IDENTITY, 2, p] = 1.0
    constant[MASS, u, u] = tables.mass_matrix
    linear[STIFFNESS, p, x] = 1.0
    linear[STIFFNESS, p, u] = tables.weights @ tables.basis[1:].T
    constant[STIFFNESS, u, x] = -tables.test_weights[:-1].sum(axis=1)
    constant[STIFFNESS, u, u] = -np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
    momentum_weights = force_weights.sum(axis=0)

    def patterns(z: ComplexArray) -> ComplexArray:
        at = z[:, None, None]
        result = np.zeros((z.size, DAMPING + len(orders), n, n), dtype=np.complex128)
        result[:, :DAMPING] = constant + at[..., None] * linear
        for index, force in enumerate(forces(z)):
            result[:, DAMPING + index, u, u] = -(force_weights[:-1] @ force)
            result[:, DAMPING + index, p, u] = z[:, None] * (momentum_weights @ force)
        return result

    return patterns


def _central_patterns(orders: tuple[float, ...]) -> Patterns:
    """Central differences of the positions, with the backward differences of fractional order."""

    def patterns(z: ComplexArray) -> ComplexArray:
        result = np.zeros((z.size, DAMPING + len(orders), 1, 1), dtype=np.complex128)
        result[:, MASS, 0, 0] = (1.0 - z) ** 2
        result[:, STIFFNESS, 0, 0] = z
        for index, order in enumerate(orders):
            result[:, DAMPING + index, 0, 0] = z * (1.0 - z) ** order
        return result

    return patterns


def _euler_patterns(method: Baseline, orders: tuple[float, ...]) -> Patterns:
    late = method.name == "explicit-euler"

    def patterns(z: ComplexArray) -> ComplexArray:
        shift = z if late else np.ones_like(z)
        result = np.zeros((z.size, DAMPING + len(orders), 2, 2), dtype=np.complex128)
        result[:, IDENTITY, 0, 0] = 1.0 - z
        result[:, IDENTITY, 0, 1] = -shift
        result[:, MASS, 1, 1] = 1.0 - z
        result[:, STIFFNESS, 1, 0] = shift
        for index, order in enumerate(orders):
            result[:, DAMPING + index, 1, 1] = shift * (1.0 - z) ** (order - 1.0)
        return result

    return patterns


def _sampled_forces(method: Method, tables: StepTables, orders: tuple[float, ...]) -> Forces:
    """Of backward differences: from increments to values at the sample points, and to forces."""
    at_points = tables.sample_basis[1:].T
    # where the step began is what the steps before have left behind
    carried = np.eye(tables.degree)[-1] - at_points

    def forces(z: ComplexArray) -> list[ComplexArray]:
        samples = at_points + z[:, None, None] * carried
        # A(alpha) stability: the symbol keeps away from the cut along the negative axis
        symbol = symbol_at(method.bdf_order, z)
        factors = [symbol**order / (1.0 - z) for order in orders]
        return [np.asarray(factor[:, None, None] * samples) for factor in factors]

    return forces


def _staged_forces(stages: StageOperator, tables: StepTables, orders: tuple[float, ...]) -> Forces:
    """Of Runge-Kutta methods: from increments to coefficients of the stages, and to forces."""
    samples = (stages.to_coefficients @ tables.slopes[1:].T).astype(np.complex128)

    def forces(z: ComplexArray) -> list[ComplexArray]:
        if all(order == 1.0 for order in orders):
            return [np.tile(samples, (z.size, 1, 1)) for _ in orders]
        powers = _symbol_powers(stages, z, [order - 1.0 for order in orders])
        return [np.asarray(power @ samples) for power in powers]

    return forces


def _symbol_powers(
    stages: StageOperator, z: ComplexArray, exponents: Sequence[float]
) -> list[ComplexArray]:
    r"""Powers of the symbol :math:`\Delta(z)` between coefficients, each ``(n, m, m)``.

    There :math:`\Delta(z)^{-1} = X + z / (1 - z) e_1 e_1^T`: near z = 1 one large entry beside a
    matrix of moderate ones, whose small eigenvalues are not drowned in it.
    """
    matrices: ComplexArray = np.tile(stages.matrix.astype(np.complex128), (z.size, 1, 1))
    matrices[:, 0, 0] += z / (1.0 - z)
    if stages.n_stages == 1:
        return [np.asarray(matrices**-exponent) for exponent in exponents]
    values, vectors = np.linalg.eig(matrices)
    try:
        inverses = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        inverses = np.full_like(vectors, np.inf)
    # Frobenius norms: the product bounds the condition from above
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = [(np.abs(one) ** 2).sum(axis=(1, 2)) for one in (vectors, inverses)]
        poor = np.flatnonzero(~(sizes[0] * sizes[1] < LARGEST_CONDITION**2))
    inverses[poor] = 0.0
    found = [
        np.asarray((vectors * values[:, None, :] ** -exponent) @ inverses, dtype=np.complex128)
        for exponent in exponents
    ]
    if poor.size:
        from scipy.linalg import fractional_matrix_power

        for power, exponent in zip(found, exponents, strict=True):
            for index in poor:
                power[index] = fractional_matrix_power(matrices[index], -exponent)
    return found
