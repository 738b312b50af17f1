r"""What a step of every system makes of the forces on it, as matrices.

With :math:`w_i` the way from the beginning of the step to its stage i, every system is taken as a
linear one with stiffness :math:`K_i`, and what else pulls at its stages,

.. math:: f_i = \nabla V(q + w_i) - K_i w_i + \text{the damping's past},

enters like a force: for a linear scene that is :math:`K q`, for others it depends on the way and is
iterated. Inputs are f and the momentum at the beginning, outputs the step's polynomial U and the
change of the momentum. Where the damping does not act at the stages, its past is an input of its
own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.engine.algebra import kronecker
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class StepResponse:
    """Matrices of a step of every system.

    Rows are U, ``(s, e)``, and the change of the momentum, ``(e,)``.

    Parameters
    ----------
    forces
        Columns: f at the stages, ``(r, e)``, the past where it acts, ``(m, e)``, unless that is at
        the stages, and the momentum, ``(e,)``; shape ``((s + 1) e, n e, q)``.
    loads
        Columns: load vectors of known forces, ``(s + 1, e)``; shape ``((s + 1) e, (s + 1) e, q)``.
    singular
        Systems whose steps have no unique solution: their matrices are zero, shape ``(q,)``.
    """

    forces: Array
    loads: Array
    singular: NDArray[np.bool_]


def step_response(
    mass: Array,
    curvature: Array,
    damping: tuple[tuple[Array, Array | None], ...],
    tables: StepTables,
    sampling: ForceSampling,
    step_size: float,
) -> StepResponse:
    """Matrices of steps of one size.

    Parameters
    ----------
    mass
        M, shape ``(e, e, q)``.
    curvature
        K at the stages, shape ``(r, e, e, q)``.
    damping
        Local block ``(m, inputs, q)`` and direction ``(e, e, q)`` of every slot; None: it is one.
    tables, sampling, step_size
        Numbers of the method, where the damping acts, and h.
    """
    h, s, r = step_size, tables.degree, tables.points.size
    e, q = mass.shape[0], mass.shape[2]
    test, ways = tables.test_weights[:-1], tables.basis[1:].T
    weights, unit = tables.weights, np.eye(e)
    # systems first: every product below is one of its own for each of them
    masses = np.moveaxis(mass, -1, 0)
    bends = np.moveaxis(curvature, -1, 0)
    matrix: Array = tables.mass_matrix[:, None, :, None] * masses[:, None, :, None, :]
    pulls = np.zeros((q, e, s, e))
    for stage in range(r):
        bend = bends[:, stage]
        shape = h**2 * np.outer(test[:, stage], ways[stage])
        matrix = matrix - shape[:, None, :, None] * bend[:, None, :, None, :]
        pulls -= (h**2 * weights[stage]) * ways[stage][:, None] * bend[:, :, None, :]
    for local, direction in damping:
        block = np.ascontiguousarray(np.moveaxis(local, -1, 0))
        along = unit[None]
        if direction is not None:
            along = np.ascontiguousarray(np.moveaxis(direction, -1, 0).transpose(0, 2, 1))
        tested = h * (sampling.test @ block @ sampling.driving)
        matrix = matrix - tested[:, :, None, :, None] * along[:, None, :, None, :]
        kicks = h * (sampling.weights @ block @ sampling.driving)
        pulls -= kicks[:, None, :, None] * along[:, :, None, :]
    inverse, singular = _inverses(matrix.reshape(q, s * e, s * e))
    pull = pulls.reshape(q, e, s * e)
    if not sampling.at_stages:
        test = np.concatenate([test, sampling.test], axis=1)
        weights = np.concatenate([weights, sampling.weights])
    by_force = inverse @ kronecker(h * test, unit)
    by_momentum = -inverse[:, :, :e]
    by_load = np.concatenate([-inverse, np.zeros((q, s * e, e))], axis=2)
    motion = np.concatenate([by_force, by_momentum], axis=2)
    kick = pull @ motion
    kick[:, :, :-e] -= kronecker(h * weights[None], unit)
    push = pull @ by_load + kronecker(np.ones((1, s + 1)), unit)
    forces = np.concatenate([motion, kick], axis=1)
    loads = np.concatenate([by_load, push], axis=1)
    forces[singular], loads[singular] = 0.0, 0.0
    return StepResponse(forces=_last(forces), loads=_last(loads), singular=singular)


def _inverses(matrices: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Inverse matrices, zero where there is none, and where that is."""
    singular = np.asarray(~np.isfinite(matrices).all(axis=(1, 2)))
    matrices = np.where(singular[:, None, None], np.eye(matrices.shape[1]), matrices)
    inverse: Array
    try:
        inverse = np.asarray(np.linalg.inv(matrices), dtype=float)
    except np.linalg.LinAlgError:
        inverse = np.zeros_like(matrices)
        for index, matrix in enumerate(matrices):
            try:
                inverse[index] = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                singular[index] = True
    singular |= ~np.isfinite(inverse).all(axis=(1, 2))
    inverse[singular] = 0.0
    return inverse, singular


def _last(matrices: Array) -> Array:
    return np.ascontiguousarray(np.moveaxis(matrices, 0, -1))
