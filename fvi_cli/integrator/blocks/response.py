r"""What a block of B steps gives where samples are convolved, as dense matrices.

Inputs, in this order:

- the force of older samples on each step, ``(B, m, e)``,
- the state before the block: position, momentum, the newest step's part of the first sample
  :math:`C^T\delta_{-1} + \text{offset}`, and the number 1 for what is constant, ``(2e + m e + 1)``,
- the moments of the known force, ``(B, s + 1, e)``.

A known force F enters as moments :math:`-h \sum_i w_{\nu i} F_i`; the first sample's part and the
constant ones act by the force that they make on every step of the block. So all follows from the
response to moments and state (:mod:`fvi_cli.integrator.steps.block_response`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.convolved import Convolved
from fvi_cli.integrator.blocks.history import BatchedChannel, convolved_of, lag_kernel
from fvi_cli.integrator.equal_steps.weights import Channel, Memory
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.block_response import LinearSystems, OwnDamping, block_response
from fvi_cli.integrator.steps.step import ForceSampling

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledSystems:
    """A batch of q independent linear systems of e coupled components each.

    Parameters
    ----------
    mass, stiffness
        Shape ``(q, e, e)``; no stiffness: None.
    channels
        Damping.
    tables
        Numbers of the method.
    memory
        Weights, and how samples follow from increments, the same for all systems.
    offset
        Constant part of the samples, shape ``(q, m, e)``.
    step_size
        h.
    """

    mass: Array
    stiffness: Array | None
    channels: tuple[BatchedChannel, ...]
    tables: StepTables
    memory: Memory
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
        return int(self.memory.sample_matrix.shape[1])

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
        return convolved_of(self.memory.channels, self.samples, self.coupled)


def lag_damping(memory: Memory, step_size: float) -> OwnDamping:
    """Damping by the weights of all lags, on unknowns that are increments over the step size."""
    channels, m = memory.channels, memory.sample_matrix.shape[1]
    return OwnDamping(
        sampling=ForceSampling(
            test=memory.force_weights[:-1],
            weights=memory.momentum_weights,
            driving=memory.sample_matrix.T,
        ),
        local=tuple(step_size * one.weights[0] * np.eye(m) for one in channels),
        past=lambda block, shape: _Lags([step_size * toeplitz(c, block) for c in channels], shape),
        carry=memory.carry_matrix.T,
    )


class _Lags:
    def __init__(self, weights: list[Array], shape: tuple[int, int, int]) -> None:
        self._weights, self._shape = weights, shape
        self._samples = np.empty((shape[0], 0, shape[1] * shape[2]))

    def force(self) -> tuple[Array, ...]:
        count = self._samples.shape[1]
        return tuple(
            (weights[count, :count] @ self._samples).reshape(self._shape)
            for weights in self._weights
        )

    def push(self, samples: Array) -> None:
        if self._weights:
            newest = samples.reshape(self._shape[0], 1, -1)
            self._samples = np.concatenate([self._samples, newest], axis=1)


def toeplitz(channel: Channel, block: int) -> Array:
    """Weights of the lag from column to row, shape ``(B, B)``, zero above the diagonal."""
    weights = np.zeros(block)
    weights[: channel.memory] = channel.weights[:block]
    lags = np.arange(block)[:, None] - np.arange(block)
    return np.where(lags >= 0, weights[lags], 0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledResponse:
    """Dense matrices of a block of B steps, each of shape ``(q, outputs, inputs)``.

    Parameters
    ----------
    samples
        To the samples, ``(B, m, e)``.
    position, momentum
        To the changes of position and momentum since the beginning, after every step, ``(B, e)``.
    carry
        To the carry after the last step, ``(m, e)``.
    force
        To the damping force of every step, ``(B, m, e)``, where it was wanted.
    """

    samples: Array
    position: Array
    momentum: Array
    carry: Array
    force: Array


def sampled_response(system: SampledSystems, block: int, *, with_force: bool) -> SampledResponse:
    """Matrices of `block` steps.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a step have no unique solution.
    """
    tables, h, me = system.tables, system.step_size, system.sample_size
    q, e, m = system.batch, system.coupled, system.samples
    raw = block_response(
        LinearSystems(
            mass=system.mass,
            stiffness=system.stiffness,
            directions=tuple(one.directions for one in system.channels),
        ),
        lag_damping(system.memory, h),
        tables,
        h,
        block,
        with_force=with_force,
    )
    offset = system.offset.reshape(q, me, 1)
    # the force on every step of the first sample's part, and of the constant ones
    of_carry, of_offset = np.zeros((q, block * me, me)), np.zeros((q, block * me, 1))
    if system.channels:
        kernel = lag_kernel(system.channels, block, m)
        of_carry = kernel.reshape(q, block * me, me)
        late = np.cumsum(kernel[:, :-1] @ offset[:, None], axis=1)
        of_offset[:, me:] = late.reshape(q, -1, 1)
    width = block * (tables.degree + 1) * e

    def by_inputs(rows: Array) -> Array:
        """Columns of the inputs from those of moments and state."""
        start, driven = rows[..., width:], rows[..., :width]
        moments = driven.reshape(q, rows.shape[1], block, tables.degree + 1, e)
        known = -h * np.einsum("qrkne,nm->qrkme", moments, system.memory.force_weights)
        known = known.reshape(q, rows.shape[1], block * me)
        return np.concatenate([known, start, known @ of_carry, known @ of_offset, driven], axis=-1)

    first = block * me
    constant = first + system.state_size - 1
    carried = slice(constant - me, constant)
    samples, carry = by_inputs(h * raw.samples), by_inputs(h * raw.carry[:, -me:])
    samples[:, :me, carried] += np.eye(me)
    samples[:, me:, constant] += np.tile(offset[..., 0], (1, block - 1))
    carry[..., constant] += offset[..., 0]
    force = by_inputs(raw.force)
    if with_force:
        force[..., :first] += np.eye(first)
        force[..., carried] += of_carry
        force[..., constant] += of_offset[..., 0]
    ends = by_inputs(raw.ends).reshape(q, block, 2, e, -1)
    return SampledResponse(
        samples=samples,
        position=ends[:, :, 0].reshape(q, block * e, -1),
        momentum=ends[:, :, 1].reshape(q, block * e, -1),
        carry=carry,
        force=force,
    )
