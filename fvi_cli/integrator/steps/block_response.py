r"""What a block of B equal steps of a linear scene gives, as dense matrices.

The scene is linear with constant matrices M, K and D: its own, or those that stand for a nonlinear
one while Newton's iteration works on what is left. Into a block go load vectors
:math:`g_{k\nu}` of every step, positions and momenta at its beginning. The force of the past
enters by its load vectors :math:`-h \sum_i b_i l_\nu(c_i) F_i`; what the damping of the block's own
steps does is in the matrices.

All matrices follow from the response to inputs of the first step, for which the steps are done once
with unit inputs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.convolution.damping import DampingTables
from fvi_cli.integrator.step_tables import StepTables

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystems:
    """A batch of q independent linear systems of e coupled components each.

    Parameters
    ----------
    mass, stiffness
        M and K, shape ``(q, e, e)``; K None where there is none.
    directions
        D of every direction of the damping, each of shape ``(q, e, e)``.
    """

    mass: Array
    stiffness: Array | None
    directions: tuple[Array, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers q and e."""
        return int(self.mass.shape[0]), int(self.mass.shape[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockResponse:
    """Matrices of a block of B steps, for each of q systems.

    Columns are the load vectors, ``(B, s + 1, e)``, then position and momentum at the beginning,
    ``(2, e)``.

    Parameters
    ----------
    velocity
        Rows: velocities at the quadrature points, ``(B, r, e)``.
    way
        Rows: positions at the quadrature points relative to the beginning, ``(B, r, e)``.
    ends
        Rows: changes of position and of momentum since the beginning, after every step,
        ``(B, 2, e)``.
    """

    velocity: Array
    way: Array
    ends: Array


def step_matrix(
    systems: LinearSystems, damping: DampingTables, tables: StepTables, step_size: float
) -> Array:
    """Derivative of the equations of a step by its unknowns, shape ``(q, s e, s e)``."""
    h, test = step_size, tables.test_weights[:-1]
    basis, slopes = tables.basis[1:].T, tables.slopes[1:].T
    q, e = systems.shape
    s = tables.degree
    total = np.einsum("nm,qab->qnamb", tables.mass_matrix, systems.mass)
    if systems.stiffness is not None:
        total -= h**2 * np.einsum("nm,qab->qnamb", test @ basis, systems.stiffness)
    for local, direction in zip(damping.local, systems.directions, strict=True):
        # forces are rows times directions: F = (W V) D
        total -= h * np.einsum("nm,qba->qnamb", test @ local @ slopes, direction)
    return np.asarray(total.reshape(q, s * e, s * e))


def block_response(
    systems: LinearSystems,
    damping: DampingTables,
    tables: StepTables,
    step_size: float,
    block: int,
) -> BlockResponse:
    """Matrices of a block of `block` steps of size `step_size`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a step have no unique solution.
    """
    velocity, way, ends = _impulses(systems, damping, tables, step_size, block)
    return BlockResponse(
        velocity=_dense(velocity, tables, block),
        way=_dense(way, tables, block),
        ends=_dense(ends, tables, block),
    )


def _impulses(
    systems: LinearSystems,
    damping: DampingTables,
    tables: StepTables,
    step_size: float,
    block: int,
) -> tuple[Array, Array, Array]:
    """Outputs of every step for unit inputs in the first, each ``(q, B, rows, e, columns)``."""
    h, (q, e) = step_size, systems.shape
    s, r = tables.degree, tables.points.size
    width = (s + 3) * e
    inverse = np.linalg.inv(step_matrix(systems, damping, tables, h))
    test, weights = h * tables.test_weights[:-1], h * tables.weights
    basis, slopes = h * tables.basis[1:].T, tables.slopes[1:].T
    units = np.eye(width).reshape(s + 3, e * width)
    start_position, start_momentum = units[s + 1], units[s + 2]
    pulled = np.zeros((q, e * width))
    stiffness = None
    if systems.stiffness is not None:
        # what the stiffness of a step's own way adds to its change of momentum
        stiffness = systems.stiffness
        pulled = _along(stiffness, np.broadcast_to(start_position, (q, 1, e * width)), e)[:, 0]
    own_pull = weights @ basis
    # changes are summed up on their own: beside a start of 1 their last digits would be lost, the
    # same ones in every block of a run
    moved, gained = np.zeros((q, e * width)), np.zeros((q, e * width))
    states = np.zeros((q, damping.decay.size, e * width))
    velocities = np.empty((q, block, r, e * width))
    ways = np.empty((q, block, r, e * width))
    ends = np.empty((q, block, 2, e * width))
    test_sum = test.sum(axis=1)[:, None]
    for index in range(block):
        force = np.zeros((q, r, e * width))
        for response, direction in zip(damping.response, systems.directions, strict=True):
            force += _along(direction, response @ states, e)
        right = test @ force
        right[:, 0] -= start_momentum + gained
        if index == 0:
            right -= units[:s]
        if stiffness is not None:
            pull = pulled + _along(stiffness, moved[:, None], e)[:, 0]
            right += test_sum * pull[:, None]
        unknowns = np.matmul(inverse, right.reshape(q, s * e, width)).reshape(q, s, e * width)
        velocity = slopes @ unknowns
        for local, direction in zip(damping.local, systems.directions, strict=True):
            force += _along(direction, local @ velocity, e)
        change = -(weights @ force)
        if stiffness is not None:
            change -= h * pull + _along(stiffness, (own_pull @ unknowns)[:, None], e)[:, 0]
        if index == 0:
            change += units[: s + 1].sum(axis=0)
        velocities[:, index] = velocity
        np.add(moved[:, None], basis @ unknowns, out=ways[:, index])
        moved = moved + h * unknowns[:, -1]
        gained = gained + change
        ends[:, index, 0], ends[:, index, 1] = moved, gained
        if damping.decay.size:
            states = damping.decay[:, None] * states + damping.intake @ velocity
    shape = (q, block, -1, e, width)
    return velocities.reshape(shape), ways.reshape(shape), ends.reshape(shape)


def _along(matrices: Array, values: Array, coupled: int) -> Array:
    """Symmetric matrices ``(q, e, e)`` on the components of values ``(q, rows, e width)``."""
    if coupled == 1:
        return np.asarray(matrices * values)
    q, rows, size = values.shape
    parts = values.reshape(q, rows, coupled, size // coupled)
    return np.asarray(np.matmul(matrices[:, None], parts).reshape(values.shape))


def _dense(impulses: Array, tables: StepTables, block: int) -> Array:
    """From the response to the first step's inputs that to all, ``(q, rows, columns)``."""
    q, _, rows, e, width = impulses.shape
    loads = (tables.degree + 1) * e
    total = np.zeros((q, block, rows * e, block * loads + 2 * e))
    own = impulses.reshape(q, block, rows * e, width)
    for first in range(block):
        total[:, first:, :, first * loads : (first + 1) * loads] = own[
            :, : block - first, :, :loads
        ]
    total[..., block * loads :] = own[..., loads:]
    return total.reshape(q, block * rows * e, -1)
