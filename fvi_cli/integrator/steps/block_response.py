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
    test, weights = tables.test_weights[:-1], tables.weights
    basis, slopes = tables.basis[1:].T, tables.slopes[1:].T
    units = np.eye(width).reshape(s + 3, e, width)
    start_position = np.broadcast_to(units[s + 1], (q, e, width))
    start_momentum = np.broadcast_to(units[s + 2], (q, e, width))
    # changes are summed up on their own: beside a start of 1 their last digits would be lost, the
    # same ones in every block of a run
    moved, gained = np.zeros((q, e, width)), np.zeros((q, e, width))
    states = np.zeros((damping.decay.size, q * e * width))
    velocities = np.empty((q, block, r, e, width))
    ways = np.empty((q, block, r, e, width))
    ends = np.empty((q, block, 2, e, width))
    for index in range(block):
        loads = units[: s + 1] if index == 0 else None
        force = np.zeros((q, r, e, width))
        for response, direction in zip(damping.response, systems.directions, strict=True):
            own = (response @ states).reshape(r, q, e, width)
            force += np.einsum("rqac,qab->qrbc", own, direction)
        right = h * np.einsum("nr,qrac->qnac", test, force)
        right[:, 0] -= start_momentum + gained
        if loads is not None:
            right -= loads[:s]
        pull = None
        if systems.stiffness is not None:
            pull = np.einsum("qab,qbc->qac", systems.stiffness, start_position + moved)
            right += h * np.einsum("n,qac->qnac", test.sum(axis=1), pull)
        unknowns = np.matmul(inverse, right.reshape(q, s * e, width)).reshape(q, s, e, width)
        velocity = np.einsum("rn,qnac->qrac", slopes, unknowns)
        own_way = h * np.einsum("rn,qnac->qrac", basis, unknowns)
        for local, direction in zip(damping.local, systems.directions, strict=True):
            own = np.einsum("rk,qkac->qrac", local, velocity)
            force += np.einsum("qrac,qab->qrbc", own, direction)
        change = -h * np.einsum("r,qrac->qac", weights, force)
        if systems.stiffness is not None and pull is not None:
            change -= h * pull + h * np.einsum(
                "r,qab,qrbc->qac", weights, systems.stiffness, own_way
            )
        if loads is not None:
            change += loads.sum(axis=0)
        velocities[:, index] = velocity
        ways[:, index] = moved[:, None] + own_way
        moved = moved + h * unknowns[:, -1]
        gained = gained + change
        ends[:, index, 0], ends[:, index, 1] = moved, gained
        if damping.decay.size:
            driving = velocity.transpose(1, 0, 2, 3).reshape(r, q * e * width)
            states = damping.decay[:, None] * states + damping.intake @ driving
    return velocities, ways, ends


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
