r"""The increments of steps that were done block by block, as their balances need them.

Blocks keep positions, momenta and the damping force. With these the equations of a step (see
:mod:`fvi_cli.integrator.equal_steps.stepping`) do not look back, and those of all steps are solved
at once:

.. math:: \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu \nabla V(X_i)
          = h \sum_i \beta_i l_\nu(\chi_i) F_{i,k} - g_{k\nu} - p_k \delta_{\nu 0} .
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem

Array = NDArray[np.float64]

NEWTON_TOLERANCE = 1e-15
NEWTON_LIMIT = 50

CHUNK = 2048
"""Steps whose equations are solved at a time."""


def linear_increments(problem: StepProblem, decoupling: Decoupling, stepped: Stepped) -> Array:
    """Increments of all finished steps of a linear scene, shape ``(n, s, d)``.

    Parameters
    ----------
    problem
        Everything that the steps needed.
    decoupling
        Coordinates in which the scene falls apart.
    stepped
        Positions, momenta and damping force of the steps.
    """
    tables, h = problem.tables, problem.step_size
    potential = problem.scene.potential
    mass = decoupling.matrices(problem.scene.inertia.mass)
    q, e, _ = mass.shape
    s, n = tables.degree, stepped.position.shape[0] - 1
    matrix = np.einsum("nm,qab->qnamb", tables.mass_matrix / h, mass)
    right = _known_rows(problem, stepped)
    if isinstance(potential, QuadraticPotential):
        weighted = np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
        matrix -= h * np.einsum("nm,qab->qnamb", weighted, decoupling.matrices(potential.stiffness))
        pull = potential.gradient(stepped.position[:n])
        right += h * np.einsum("v,kd->kvd", tables.test_weights[:-1].sum(axis=1), pull)
    inverse = np.linalg.inv(matrix.reshape(q, s * e, s * e))
    columns = decoupling.forces(right).reshape(q, n, s * e)
    found = np.matmul(columns, inverse.transpose(0, 2, 1))
    return decoupling.scene_positions(found.reshape(q, n, s, e))


def nonlinear_increments(
    problem: StepProblem, potential: Potential, stepped: Stepped
) -> Array | None:
    """Increments of all finished steps of a nonlinear scene, by Newton's iteration on each.

    Parameters
    ----------
    problem, potential
        Everything that the steps needed.
    stepped
        Positions, momenta and damping force of the steps.

    Returns
    -------
    Array
        Shape ``(n, s, d)``; None where the iteration does not converge.
    """
    n, d = stepped.position.shape[0] - 1, problem.scene.dimension
    tables, h = problem.tables, problem.step_size
    right = _known_rows(problem, stepped)
    way = np.diff(stepped.position, axis=0)
    found = tables.control_points[1:, None] * way[:, None]
    linear = np.asarray(np.kron(tables.mass_matrix / h, problem.scene.inertia.mass), dtype=float)
    for first in range(0, n, CHUNK):
        part = slice(first, min(first + CHUNK, n))
        base = stepped.position[part, None]
        with np.errstate(all="ignore"):
            solved = _newton(problem, potential, linear, base, right[part], found[part])
        if solved is None:
            return None
        found[part] = solved
    return found.reshape(n, -1, d)


def _newton(
    problem: StepProblem,
    potential: Potential,
    linear: Array,
    base: Array,
    right: Array,
    increments: Array,
) -> Array | None:
    """Solve linear(delta) - h sum b l grad V(X) = right for some steps at once."""
    tables, h = problem.tables, problem.step_size
    count, s, d = increments.shape
    tested, inner = h * tables.test_weights[:-1], tables.basis[1:]
    previous = np.inf
    for _ in range(NEWTON_LIMIT):
        points = base + np.einsum("mi,kmd->kid", inner, increments)
        residual = (increments.reshape(count, -1) @ linear.T).reshape(count, s, d) - right
        residual -= np.einsum("ni,kid->knd", tested, potential.gradient(points))
        curvature = np.einsum(
            "ni,mi,kiab->knamb", tested, inner, potential.hessian(points), optimize=True
        )
        jacobian = linear - curvature.reshape(count, s * d, s * d)
        try:
            update = np.linalg.solve(jacobian, residual.reshape(count, s * d, 1))
        except np.linalg.LinAlgError:
            return None
        increments = increments - update.reshape(count, s, d)
        size = float(np.abs(update).max())
        scale = float(np.abs(increments).max()) + 1e-300
        if not np.isfinite(size):
            return None
        # steps of any length are converged when all that remains is round-off of the longest
        stalled = size >= 0.5 * previous and size <= 1e-9 * scale
        if size <= NEWTON_TOLERANCE * scale or stalled or size == 0:
            return increments
        previous = size
    return None


def _known_rows(problem: StepProblem, stepped: Stepped) -> Array:
    """What drives the increments but for the potential, shape ``(n, s, d)``."""
    n, s = stepped.position.shape[0] - 1, problem.tables.degree
    right = np.zeros((n, s, problem.scene.dimension))
    if stepped.end_force.shape[0]:
        weights = problem.step_size * problem.memory.force_weights[:-1]
        right += np.einsum("vm,kmd->kvd", weights, stepped.end_force[:n])
    right[:, 0] -= stepped.momentum[:n]
    if problem.moments is not None:
        right -= problem.moments[:n, :-1]
    return right
