r"""Response of a linear scene over a block of steps, as dense matrices.

The steps of a linear scene are linear and the same for every step, so that what a block of B steps
gives is a matrix times what goes into it. Inputs, in this order:

- the force of older samples on each step, ``(B, m, e)``,
- the state before the block: position, momentum, the newest step's part of the first sample
  :math:`C^T\delta_{-1} + \text{offset}`, and the number 1 for what is constant, ``(2e + m e + 1)``,
- the moments of the known force, ``(B, s + 1, e)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.convolved import Convolved
from fvi_cli.integrator.blocks.history import (
    BatchedChannel,
    convolved_of,
    lag_kernel,
    reversed_strip,
)
from fvi_cli.integrator.step_tables import StepTables

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystem:
    """A batch of q independent linear systems of e coupled components each.

    Parameters
    ----------
    mass, stiffness
        Shape ``(q, e, e)``; no stiffness: None.
    channels
        Damping.
    tables
        Numbers of the method.
    sample_matrix, carry_matrix
        E and C of the samples, shape ``(s, m)``.
    force_weights
        Weights of the force samples in every row, shape ``(s + 1, m)``.
    offset
        Constant part of the samples, shape ``(q, m, e)``.
    step_size
        h.
    """

    mass: Array
    stiffness: Array | None
    channels: tuple[BatchedChannel, ...]
    tables: StepTables
    sample_matrix: Array
    carry_matrix: Array
    force_weights: Array
    offset: Array
    step_size: float

    @property
    def batch(self) -> int:
        """Number q of systems."""
        return int(self.mass.shape[0])

    @property
    def coupled(self) -> int:
        """Number e of components of each."""
        return int(self.mass.shape[1])

    @property
    def samples(self) -> int:
        """Number m of samples per step."""
        return int(self.sample_matrix.shape[1])

    @property
    def sample_size(self) -> int:
        """Numbers m e in the samples of a step."""
        return self.samples * self.coupled

    @property
    def state_size(self) -> int:
        """Numbers in the state before a block."""
        return 2 * self.coupled + self.sample_size + 1

    @property
    def convolved(self) -> Convolved:
        """Sizes of what is convolved in each of them."""
        channels = tuple(one.channel for one in self.channels)
        return convolved_of(channels, self.samples, self.coupled)


@dataclass(frozen=True, kw_only=True, eq=False)
class Impulses:
    """Outputs of every step for unit inputs in the first, shape ``(q, B, size, inputs)``."""

    samples: Array
    position: Array
    momentum: Array
    carry: Array
    force: Array
    points: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockResponse:
    """Dense matrices of a block of B steps, each of shape ``(q, outputs, inputs)``.

    They are made when they are asked for, from the responses to inputs in the first step.

    Parameters
    ----------
    system
        The systems.
    block
        B.
    impulses
        Outputs of every step for unit inputs in the first.
    """

    system: LinearSystem
    block: int
    impulses: Impulses

    @cached_property
    def samples(self) -> Array:
        """To the samples, ``(B, m, e)``."""
        return self._dense(self.impulses.samples)

    @cached_property
    def position(self) -> Array:
        """To the increments of position of every step, ``(B, e)``."""
        return self._dense(self.impulses.position)

    @cached_property
    def momentum(self) -> Array:
        """To the increments of momentum of every step, ``(B, e)``."""
        return self._dense(self.impulses.momentum)

    @cached_property
    def force(self) -> Array:
        """To the damping force of every step, ``(B, m, e)``."""
        return self._dense(self.impulses.force)

    @cached_property
    def points(self) -> Array:
        """To the positions at the quadrature points relative to the start, ``(B, r, e)``."""
        return self._dense(self.impulses.points)

    @cached_property
    def carry(self) -> Array:
        """To the carry after every step, ``(B, m, e)``."""
        carry = self._dense(self.impulses.carry)
        offset = self.system.offset.reshape(self.system.batch, -1)
        # the offset of the next step
        constant = self.block * self.system.sample_size + self.system.state_size - 1
        carry[:, :, constant] += np.tile(offset, (1, self.block))
        return carry

    @cached_property
    def state(self) -> Array:
        """To the increments of position and momentum over the block and the carry after it."""
        q, e = self.system.batch, self.system.coupled
        return np.concatenate(
            [
                self.position.reshape(q, self.block, e, -1).sum(axis=1),
                self.momentum.reshape(q, self.block, e, -1).sum(axis=1),
                self.carry[:, -self.system.sample_size :],
            ],
            axis=1,
        )

    def _dense(self, response: Array) -> Array:
        me, n_state = self.system.sample_size, self.system.state_size
        q, size = self.system.batch, response.shape[2]
        parts = (
            _toeplitz(response[..., :me]),
            response[..., me : me + n_state].reshape(q, self.block * size, n_state),
            _toeplitz(response[..., me + n_state :]),
        )
        return np.concatenate(parts, axis=-1)


def block_response(system: LinearSystem, block: int) -> BlockResponse:
    """Matrices of `block` steps, from the responses to unit inputs in the first step."""
    impulses = _first_step_responses(system, block)
    return BlockResponse(system=system, block=block, impulses=impulses)


def _first_step_responses(system: LinearSystem, block: int) -> Impulses:
    """Step a matrix of right-hand sides through the block."""
    tables, h = system.tables, system.step_size
    q, e, m, s = system.batch, system.coupled, system.samples, tables.degree
    r, me = tables.points.size, system.sample_size
    columns = me + system.state_size + (s + 1) * e
    inputs = np.eye(columns)
    at_state = me + np.arange(system.state_size)
    first_force = np.broadcast_to(inputs[:me], (q, me, columns))
    position = np.broadcast_to(inputs[at_state[:e]], (q, e, columns)).copy()
    momentum = np.broadcast_to(inputs[at_state[e : 2 * e]], (q, e, columns)).copy()
    carry = np.broadcast_to(inputs[at_state[2 * e : -1]], (q, me, columns)).copy()
    constant = inputs[at_state[-1]]
    first_moments = inputs[me + system.state_size :].reshape(s + 1, e, columns)

    weighted = np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
    linear = np.einsum("nm,qab->qnamb", tables.mass_matrix / h, system.mass)
    newest = np.zeros((q, me, me))
    reversed_lags = np.zeros((q, me, 0))
    if system.channels:
        kernel = lag_kernel(system.channels, 0, block, m)
        newest = kernel[:, 0]
        if block > 1:
            reversed_lags = reversed_strip(kernel, 1, block - 1)
    to_sample = np.kron(system.sample_matrix.T, np.eye(e))
    to_carry = np.kron(system.carry_matrix.T, np.eye(e))
    to_rows = h * np.kron(system.force_weights[:-1], np.eye(e))
    to_change = -h * np.kron(system.force_weights.sum(axis=0)[None], np.eye(e))
    to_points = np.kron(tables.basis[1:].T, np.eye(e))
    matrix = linear.reshape(q, s * e, s * e) - to_rows @ newest @ to_sample
    if system.stiffness is not None:
        pull = np.einsum("nm,qab->qnamb", weighted, system.stiffness)
        matrix = matrix - h * pull.reshape(q, s * e, s * e)
    inverse = np.linalg.inv(matrix)

    samples = np.zeros((q, block, me, columns))
    steps = np.zeros((q, block, e, columns))
    changes = np.zeros((q, block, e, columns))
    carries = np.zeros((q, block, me, columns))
    forces = np.zeros((q, block, me, columns))
    points = np.zeros((q, block, r * e, columns))
    travelled = np.zeros((q, e, columns))
    for index in range(block):
        force = newest @ carry
        if index == 0:
            force = force + first_force
        elif system.channels:
            past = samples[:, :index].reshape(q, index * me, columns)
            force = force + reversed_lags[:, :, (block - 1 - index) * me :] @ past
        right = to_rows @ force
        right[:, :e] -= momentum
        if index == 0:
            right -= first_moments[:-1].reshape(s * e, columns)
        if system.stiffness is not None:
            pull = system.stiffness @ position
            row_weights = h * tables.test_weights[:-1].sum(axis=1)
            right += (row_weights[:, None, None] * pull[:, None]).reshape(q, s * e, columns)
        increments = inverse @ right
        sample = to_sample @ increments
        force = force + newest @ sample
        change = to_change @ force
        inner = to_points @ increments
        if system.stiffness is not None:
            mean = np.einsum("i,qiac->qac", tables.weights, inner.reshape(q, r, e, columns))
            change = change - h * (system.stiffness @ (position + mean))
        if index == 0:
            change = change + first_moments.sum(axis=0)
        samples[:, index] = sample + carry
        step = increments[:, -e:]
        steps[:, index], changes[:, index], forces[:, index] = step, change, force
        points[:, index] = (travelled[:, None] + inner.reshape(q, r, e, columns)).reshape(
            q, r * e, columns
        )
        carries[:, index] = carry_end = to_carry @ increments
        # the next step's offset is constant
        carry = carry_end + system.offset.reshape(q, me, 1) * constant
        position = position + step
        travelled = travelled + step
        momentum = momentum + change
    return Impulses(
        samples=samples,
        position=steps,
        momentum=changes,
        carry=carries,
        force=forces,
        points=points,
    )


def _toeplitz(response: Array) -> Array:
    """Block lower triangular Toeplitz matrix of impulse responses ``(q, B, rows, columns)``."""
    q, block, rows, columns = response.shape
    result = np.zeros((q, block, rows, block, columns))
    for first in range(block):
        result[:, first:, :, first] = response[:, : block - first]
    return result.reshape(q, block * rows, block * columns)
