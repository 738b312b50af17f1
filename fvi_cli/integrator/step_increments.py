r"""The increments of steps that were done block by block, as their balances need them.

Blocks keep positions, momenta and the damping force. With these the equations of a step (see
:mod:`fvi_cli.integrator.stepping`) do not look back, and those of all steps are solved at once:

.. math:: \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu \nabla V(X_i)
          = h \sum_i \beta_i l_\nu(\chi_i) F_{i,k} - g_{k\nu} - p_k \delta_{\nu 0} .
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.block_linear import run_linear_blocks
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.engine import choose_route, scene_decoupling, sums_directly
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stepped_history import SteppedHistory
from fvi_cli.integrator.stepping import Stepped, StepProblem, run_steps

Array = NDArray[np.float64]


def run_with_increments(problem: StepProblem, method: Method) -> Stepped:
    """All steps with their increments: linear scenes by blocks, others one after the other.

    Parameters
    ----------
    problem
        Everything that the steps need.
    method
        Its history says whether every sum of the memory is written out.
    """
    scene, memory, n_steps = problem.scene, problem.memory, problem.n_steps
    if not sums_directly(method.history, n_steps):
        decoupling = scene_decoupling(scene, [channel.direction for channel in memory.channels])
        samples, damped = memory.sample_matrix.shape[1], bool(memory.channels)
        route = choose_route(scene, method.history, n_steps, samples, decoupling, damped=damped)
        if route == "linear blocks" and decoupling is not None:
            stepped = run_linear_blocks(replace(problem, keep_force=True), decoupling)
            if stepped is not None:
                found = linear_increments(problem, decoupling, stepped)
                return replace(stepped, increments=found)
    history = None
    if memory.channels and method.history != "direct":
        history = SteppedHistory(memory, n_steps, scene.dimension)
    return run_steps(problem, history, keep_increments=True)


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
    right = np.zeros((n, s, problem.scene.dimension))
    if stepped.end_force.shape[0]:
        weights = h * problem.memory.force_weights[:-1]
        right += np.einsum("vm,kmd->kvd", weights, stepped.end_force[:n])
    right[:, 0] -= stepped.momentum[:n]
    if problem.moments is not None:
        right -= problem.moments[:n, :-1]
    if isinstance(potential, QuadraticPotential):
        weighted = np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
        matrix -= h * np.einsum("nm,qab->qnamb", weighted, decoupling.matrices(potential.stiffness))
        pull = potential.gradient(stepped.position[:n])
        right += h * np.einsum("v,kd->kvd", tables.test_weights[:-1].sum(axis=1), pull)
        if problem.position_shift is not None:
            pull = potential.gradient(problem.position_shift[:n])
            right += h * np.einsum("vi,kid->kvd", tables.test_weights[:-1], pull)
    inverse = np.linalg.inv(matrix.reshape(q, s * e, s * e))
    columns = decoupling.forces(right).reshape(q, n, s * e)
    found = np.matmul(columns, inverse.transpose(0, 2, 1))
    return decoupling.scene_positions(found.reshape(q, n, s, e))
