r"""Blocks of equal steps of linear scenes, without a loop over steps.

Where the scene is one system with few states, the states of the damping, position and momentum
together obey one linear recurrence from block to block, and all that is not that recurrence is one
matrix product for many blocks. A batch of systems shares the tables of the damping; each has its
own dense matrices for the steps of a block.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.convolution.damping import LONGEST_BLOCK, Damping, DampingTables
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.block_memory import BlockMemory
from fvi_cli.integrator.steps.block_response import (
    LinearSystems,
    block_response,
    own_damping,
)
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array

LARGEST_RECURRENCE = 300
"""Numbers in the state of a recurrence, at most."""
SMALL_RECURRENCE = 200
"""Beyond, it takes more blocks to pay for the matrix."""
LARGEST_DENSE = 1024
"""Steps of a block times stages times components, at most."""
LARGEST_BATCH = 2**22
"""Numbers in the matrices of a batch, at most."""
LEAST_BLOCK = 4
LEAST_STEPS = 8
"""Steps of one system that pay for the matrices of a block."""
LEAST_RECURRENCE = 24
"""Blocks that pay for the matrix of a recurrence."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockSteps:
    """What a number of steps gave.

    Parameters
    ----------
    position, momentum
        After every step, shape ``(n, d)``.
    driving
        What drove the damping force in every step, shape ``(n, inputs, d)``; only where it was
        wanted.
    """

    position: Array
    momentum: Array
    driving: Array


def block_length(
    stages: int, batch: int, coupled: int, n_steps: int, most: int = LONGEST_BLOCK
) -> int:
    """Steps of a block, up to `most`, for `n_steps` equal steps; 0: they are done one by one."""
    block = most
    while block >= LEAST_BLOCK and (
        block * stages * coupled > LARGEST_DENSE
        or (batch > 1 and batch * (block * stages * coupled) ** 2 > LARGEST_BATCH)
        or block * block > 4 * n_steps
    ):
        block //= 2
    if batch == 1 and n_steps < LEAST_STEPS:
        return 0
    return block if LEAST_BLOCK <= block <= n_steps else 0


def is_recurrence(batch: int, coupled: int, n_states: int, n_blocks: int, of_run: int) -> bool:
    """Whether so many blocks of one system are taken as a recurrence of its whole state.

    Parameters
    ----------
    batch, coupled, n_states
        Systems, components of each, and states of the damping.
    n_blocks, of_run
        Blocks in a row, and those of their size in the run.
    """
    size = (n_states + 2) * coupled
    pays = n_blocks >= LEAST_RECURRENCE and (size <= SMALL_RECURRENCE or of_run >= size // 4)
    return batch == 1 and pays and size <= LARGEST_RECURRENCE


def memory_operations(
    n_steps: int,
    block: int,
    batch: int,
    coupled: int,
    stages: int,
    n_states: int,
    per_step: int,
    of_run: int,
) -> int:
    """Multiply-adds of the memory in `n_steps` steps in blocks.

    Parameters
    ----------
    n_steps, block
        Number of steps, and steps of a block.
    batch, coupled
        Systems, and components of each.
    stages, n_states, per_step
        Stages of the method, states of the damping, and what a single step takes.
    of_run
        Steps of their size in the run.
    """
    n_blocks, rest = divmod(n_steps, block)
    if not is_recurrence(batch, coupled, n_states, n_blocks, of_run // block) or per_step == 0:
        return n_steps * per_step
    size = (n_states + 2) * coupled
    outputs = block * (stages + 2) * coupled
    return n_blocks * size * (size + outputs) + rest * per_step


@dataclass(frozen=True, kw_only=True, eq=False)
class _Recurrence:
    """From the state of a block to what it adds, and to its steps: ends and what drives them."""

    change: Array
    driven: Array
    outputs: Array
    drivings: Array


class LinearBlocks:
    """Equal steps of one size of a linear scene.

    Parameters
    ----------
    systems, decoupling
        Independent systems and the coordinates in which the scene falls apart into them.
    damping, at, sampling
        The damping, if any, its numbers for this step size, and where it acts.
    tables, step_size
        Numbers of the method, and h.
    block, of_run
        Steps of a block, and of this size in the whole run.
    """

    def __init__(
        self,
        systems: LinearSystems,
        decoupling: Decoupling,
        damping: Damping | None,
        at: DampingTables,
        sampling: ForceSampling,
        tables: StepTables,
        step_size: float,
        block: int,
        of_run: int,
    ) -> None:
        self._of_run = of_run
        self._decoupling, self._damping, self._tables = decoupling, damping, tables
        self._h, self.block = step_size, block
        self._q, self._e = systems.shape
        self._m, self._inputs = sampling.weights.size, sampling.driving.shape[0]
        self._rows = tables.degree + 1
        self._directions = systems.directions
        self._response = block_response(
            systems, own_damping(damping, at, sampling), tables, step_size, block
        )
        self._to_loads = -step_size * sampling.to_loads
        # load vectors of the constant force
        self._constant = self._to_loads @ at.constant_force
        self._memory: BlockMemory | None = None
        if damping is not None and at.step is not None:
            self._memory = BlockMemory(damping, at, block)
        self._n_states = 0 if self._memory is None else self._memory.responses[0].shape[1]

    def advance(
        self,
        position: CompensatedSum,
        momentum: CompensatedSum,
        states: Array,
        n_steps: int,
        loads: Array | None,
        *,
        with_driving: bool,
    ) -> tuple[BlockSteps, Array]:
        """Do `n_steps` steps; position and momentum move on.

        Parameters
        ----------
        position, momentum
            Of the scene, shape ``(d,)``.
        states
            Of the damping, shape ``(J, columns)``.
        n_steps
            Any number.
        loads
            Load vectors of known forces, shape ``(n_steps, s + 1, d)``.
        with_driving
            Whether what drove the damping force is wanted; otherwise it may be left out.

        Returns
        -------
        BlockSteps, Array
            What the steps gave, and the states after them.
        """
        d = position.value.size
        q, e, block = self._q, self._e, self.block
        forces, states_after = self._known_loads(states, n_steps, loads)
        z = np.ascontiguousarray(
            self._decoupling.positions(states[:, :d]).transpose(1, 0, 2).reshape(-1, q * e)
        )
        ends_position = self._decoupling.positions(position.value)
        ends_momentum = self._decoupling.forces(momentum.value)
        start = np.concatenate([ends_position, ends_momentum], axis=1)
        n_blocks, rest = divmod(n_steps, block)
        parts = []
        if n_blocks:
            driven = None if forces is None else forces[:, : n_blocks * block]
            if is_recurrence(q, e, self._n_states, n_blocks, self._of_run // block):
                ends, driving, z, start = self._recur(
                    z, start, n_blocks, driven, with_driving=with_driving
                )
            else:
                ends, driving, z, start = self._repeat(z, start, n_blocks, driven)
            parts.append((ends, driving))
        if rest:
            driven = None if forces is None else forces[:, n_blocks * block :]
            ends, driving, z, start = self._one(z, start, rest, driven)
            parts.append((ends, driving))
        ends = np.concatenate([part[0] for part in parts], axis=1)
        driving = np.concatenate([part[1] for part in parts], axis=1)
        steps = BlockSteps(
            position=self._decoupling.scene_positions(ends[..., :e]),
            momentum=self._decoupling.scene_forces(ends[..., e:]),
            driving=self._decoupling.scene_positions(driving),
        )
        after = states_after
        if z.size:
            moved = z.reshape(-1, q, e).transpose(1, 0, 2)
            after[:, :d] = self._decoupling.scene_positions(moved)
        position.add(steps.position[-1] - position.value)
        momentum.add(steps.momentum[-1] - momentum.value)
        return steps, after

    def _known_loads(
        self, states: Array, n_steps: int, loads: Array | None
    ) -> tuple[Array | None, Array]:
        """All load vectors that are known beforehand, ``(q, n, s + 1, e)``; states to fill in."""
        after = states.copy()
        memory, damping = self._memory, self._damping
        constant = self._constant
        if memory is not None and damping is not None and damping.has_column:
            done, carried = 0, states[:, -1]
            parts = []
            while done < n_steps:
                count = min(self.block, n_steps - done)
                parts.append(memory.carried_force(carried, count))
                carried = memory.carried_after(carried, count)
                done += count
            after[:, -1] = carried
            own = np.einsum("nr,krd->knd", self._to_loads, np.concatenate(parts))
            loads = own if loads is None else loads + own
        if constant.any():
            own = np.broadcast_to(constant, (n_steps, *constant.shape))
            loads = own if loads is None else loads + own
        if loads is None:
            return None, after
        return self._decoupling.forces(loads), after

    @cached_property
    def _recurrence(self) -> _Recurrence:
        """Matrices of one system: w = (states, position, momentum) from block to block."""
        e, block, n_states = self._e, self.block, self._n_states
        loads = block * self._rows * e
        to_driving, ends = self._response.samples[0], self._response.ends[0]
        size = n_states * e + 2 * e
        # from w to the load vectors of the past
        past = np.zeros((loads, n_states * e))
        if self._memory is not None:
            for response, direction in zip(self._memory.responses, self._directions, strict=True):
                by_stage = response.reshape(block, self._m, n_states)
                rows = np.einsum("nr,brj->bnj", self._to_loads, by_stage)
                past += np.einsum("bnj,ca->bnajc", rows, direction[0]).reshape(loads, n_states * e)
        outputs = np.concatenate([ends[:, :loads] @ past, ends[:, loads:]], axis=1)
        drivings = np.concatenate([to_driving[:, :loads] @ past, to_driving[:, loads:]], axis=1)
        change = np.zeros((size, size))
        driven = np.zeros((size, loads))
        if self._memory is not None:
            kernel = self._memory.kernel(block)
            intake = np.kron(kernel.intake, np.eye(e))
            change[: n_states * e] = intake @ drivings
            change[: n_states * e, : n_states * e] += np.kron(kernel.change_of_all(), np.eye(e))
            driven[: n_states * e] = intake @ to_driving[:, :loads]
        change[n_states * e :] = outputs[-2 * e :]
        driven[n_states * e :] = ends[-2 * e :, :loads]
        return _Recurrence(change=change, driven=driven, outputs=outputs, drivings=drivings)

    def _recur(
        self, z: Array, start: Array, n_blocks: int, loads: Array | None, *, with_driving: bool
    ) -> tuple[Array, Array, Array, Array]:
        """Whole blocks of one system: ends ``(1, n, 2 e)``, drivings, states, state."""
        e, block, matrices = self._e, self.block, self._recurrence
        size = matrices.change.shape[0]
        path = np.empty((n_blocks, size))
        value = np.concatenate([z.ravel(), start[0]])
        lost = np.zeros(size)
        flat = None if loads is None else loads[0].reshape(n_blocks, -1)
        driven = None if flat is None else flat @ matrices.driven.T
        for index in range(n_blocks):
            path[index] = value
            change = matrices.change @ value
            if driven is not None:
                change += driven[index]
            change -= lost
            total = value + change
            lost = (total - value) - change
            value = total
        width = block * self._rows * e
        ends = path @ matrices.outputs.T
        if flat is not None:
            ends += flat @ self._response.ends[0][:, :width].T
        driving = np.zeros((n_blocks if with_driving else 0, block * self._inputs * e))
        if with_driving:
            driving += path @ matrices.drivings.T
            if flat is not None:
                driving += flat @ self._response.samples[0][:, :width].T
        ends = ends.reshape(n_blocks, block, 2 * e) + path[:, None, -2 * e :]
        return (
            ends.reshape(1, n_blocks * block, 2 * e),
            driving.reshape(1, -1, self._inputs, e),
            value[: -2 * e].reshape(z.shape),
            value[None, -2 * e :],
        )

    def _repeat(
        self, z: Array, start: Array, n_blocks: int, loads: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """Whole blocks of a batch, one after the other."""
        found = []
        for index in range(n_blocks):
            own = None
            if loads is not None:
                own = loads[:, index * self.block : (index + 1) * self.block]
            ends, driving, z, start = self._one(z, start, self.block, own)
            found.append((ends, driving))
        return (
            np.concatenate([one[0] for one in found], axis=1),
            np.concatenate([one[1] for one in found], axis=1),
            z,
            start,
        )

    def _one(
        self, z: Array, start: Array, count: int, loads: Array | None
    ) -> tuple[Array, Array, Array, Array]:
        """One block of `count` steps."""
        q, e, m, inputs = self._q, self._e, self._m, self._inputs
        width, every = count * self._rows * e, self.block * self._rows * e
        given = np.zeros((q, width + 2 * e))
        if loads is not None:
            given[:, :width] = loads.reshape(q, width)
        given[:, width:] = start
        if self._memory is not None:
            force = np.zeros((q, count, m, e))
            for response, direction in zip(self._memory.responses, self._directions, strict=True):
                own = (response[: count * m] @ z).reshape(count, m, q, e).transpose(2, 0, 1, 3)
                if e == 1:
                    force += own * direction[:, None]
                else:
                    force += np.matmul(own, direction[:, None])
            given[:, :width] += np.einsum("nr,qkre->qkne", self._to_loads, force).reshape(q, -1)
        if count == self.block:
            to_driving, ends = self._response.samples, self._response.ends
        else:
            columns = np.r_[0:width, every : every + 2 * e]
            to_driving = self._response.samples[:, : count * inputs * e][:, :, columns]
            ends = self._response.ends[:, : count * 2 * e][:, :, columns]
        driving = _times(to_driving, given).reshape(q, count, inputs, e)
        path = _times(ends, given).reshape(q, count, 2 * e) + start[:, None]
        if self._memory is not None:
            kernel = self._memory.kernel(count)
            z = kernel.after(z, driving.transpose(1, 2, 0, 3).reshape(count * inputs, q * e))
        return path, driving, z, path[:, -1]


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrix times vector for every system."""
    if matrices.shape[0] == 1:
        return np.asarray(matrices[0] @ vectors[0])[None]
    return np.asarray(np.matmul(matrices, vectors[..., None])[..., 0])
