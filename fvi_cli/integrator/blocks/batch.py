"""Blocks of steps of a batch of linear systems: no loop over steps, and none over systems."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.blocks.history import BatchedChannel, BlockHistory
from fvi_cli.integrator.blocks.response import SampledSystems, sampled_response
from fvi_cli.integrator.blocks.sizes import BatchPlan, plan_batch
from fvi_cli.integrator.compensated import CompensatedSum

Array = NDArray[np.float64]

CHUNK_BLOCKS = 64
"""Blocks whose outputs are made by one matrix product."""
ADVANCED_EVERY = 8
"""So often, in blocks, it is told how far the steps are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchProblem:
    """What the steps of a batch of systems need.

    Parameters
    ----------
    system
        The q systems of e components each.
    n_steps
        N.
    position, momentum
        Start values, shape ``(q, e)``.
    first_offset
        Offset of the first samples, ``(q, m, e)``.
    moments
        Moments of what is known in advance, for some systems and a range of steps, shape
        ``(.., n, s + 1, e)``; None where nothing is.
    with_force, with_end
        Whether the damping force of every step is wanted, and that at the end of the last, which
        samples on the nodes have.
    limit
        Positions beyond which a system needs no more steps, shape ``(q,)``.
    stop_together
        Whether no system needs more steps once one is beyond its limit.
    """

    system: SampledSystems
    n_steps: int
    position: Array
    momentum: Array
    first_offset: Array
    moments: Callable[[slice, int, int], Array] | None
    with_force: bool
    with_end: bool
    limit: Array
    stop_together: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class BatchStepped:
    """What the steps gave; of meaning are the finished ones.

    Parameters
    ----------
    position, momentum
        Shape ``(q, N + 1, e)``.
    force
        Damping force of every step and at the end, ``(q, N + 1, m, e)``, where it was wanted.
    done
        Number of finished steps of each system, shape ``(q,)``.
    operations
        Multiply-adds that each system has spent on its memory, shape ``(q,)``.
    """

    position: Array
    momentum: Array
    force: Array | None
    done: NDArray[np.int64]
    operations: NDArray[np.int64]


def run_batch(problem: BatchProblem) -> BatchStepped | None:
    """All steps of all systems, as many at a time as stay in the cache.

    Returns
    -------
    BatchStepped
        None where the blocks would be too large.
    """
    system, n_steps = problem.system, problem.n_steps
    q, e, m = system.batch, system.coupled, system.samples
    plan = plan_batch(system.convolved, q, n_steps)
    if plan is None:
        return None
    position, momentum = np.empty((q, n_steps + 1, e)), np.empty((q, n_steps + 1, e))
    force = np.zeros((q, n_steps + 1, m, e)) if problem.with_force else None
    done, operations = np.zeros(q, dtype=np.int64), np.zeros(q, dtype=np.int64)
    for first in range(0, q, plan.width):
        part = slice(first, min(first + plan.width, q))
        blocks = _Blocks(
            _sliced(problem, part),
            plan,
            position[part],
            momentum[part],
            None if force is None else force[part],
        )
        done[part] = blocks.run()
        # all systems of a slice do the same
        operations[part] = blocks.operations
    return BatchStepped(
        position=position, momentum=momentum, force=force, done=done, operations=operations
    )


def _sliced(problem: BatchProblem, part: slice) -> BatchProblem:
    """Some of the systems."""
    if part.start == 0 and part.stop == problem.system.batch:
        return problem
    system = problem.system
    moments = problem.moments
    return replace(
        problem,
        system=replace(
            system,
            mass=system.mass[part],
            stiffness=None if system.stiffness is None else system.stiffness[part],
            channels=tuple(
                BatchedChannel(channel=c.channel, directions=c.directions[part])
                for c in system.channels
            ),
            offset=system.offset[part],
        ),
        position=problem.position[part],
        momentum=problem.momentum[part],
        first_offset=problem.first_offset[part],
        moments=None if moments is None else lambda _, first, last: moments(part, first, last),
        limit=problem.limit[part],
    )


class _Blocks:
    """State and matrices of the systems of one slice; writes into the arrays that it is given."""

    def __init__(
        self,
        problem: BatchProblem,
        plan: BatchPlan,
        position: Array,
        momentum: Array,
        force: Array | None,
    ) -> None:
        self._problem, self._system = problem, problem.system
        self._plan, self._block = plan, plan.block
        self._position, self._momentum, self._force = position, momentum, force
        system = problem.system
        response = sampled_response(system, plan.block, with_force=force is not None)
        q, e, m = system.batch, system.coupled, system.samples
        self._width = system.sample_size
        self._n_history = plan.far * self._width
        self._n_state = system.state_size
        self._n_first = self._n_history + self._n_state
        whole = plan.block * self._width
        columns = np.r_[: self._n_history, whole : response.carry.shape[2]]
        inside = np.concatenate(
            [
                response.samples[:, whole - self._n_history :],
                response.position[:, -e:],
                response.momentum[:, -e:],
                response.carry,
            ],
            axis=1,
        )[:, :, columns]
        self._sequential = np.ascontiguousarray(inside[:, :, : self._n_first])
        self._driven = np.ascontiguousarray(inside[:, :, self._n_first :].transpose(0, 2, 1))
        outputs = [response.position, response.momentum]
        if force is not None:
            outputs.append(response.force)
        joined = np.concatenate(outputs, axis=1)[:, :, columns]
        self._outputs = np.ascontiguousarray(joined.transpose(0, 2, 1))
        channels = system.channels if plan.is_damped else ()
        self._history = BlockHistory(channels, m, plan.block)
        state = np.zeros((q, self._n_state))
        state[:, :e], state[:, e : 2 * e] = problem.position, problem.momentum
        state[:, 2 * e : -1] = problem.first_offset.reshape(q, -1)
        state[:, -1] = 1.0
        self._state = state
        self._sum = CompensatedSum(state[:, : 2 * e])
        self._direct = 0

    @property
    def operations(self) -> int:
        """Multiply-adds, weight times sample, that each system has spent so far."""
        return self._direct + self._history.operations

    def run(self) -> int:
        """Advance until the end, or until no more steps are needed; the number of steps done."""
        problem, e = self._problem, self._system.coupled
        n_steps, block, q = problem.n_steps, self._block, self._system.batch
        total = self._plan.n_blocks
        self._position[:, 0], self._momentum[:, 0] = self._state[:, :e], self._state[:, e : 2 * e]
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, total, CHUNK_BLOCKS):
                count = min(CHUNK_BLOCKS, total - first)
                inputs = self._advance_chunk(first, count)
                output = np.matmul(inputs, self._outputs)
                begin, end = first * block, min((first + count) * block, n_steps)
                self._write(output, inputs, begin, end)
                if self._force is not None:
                    force = output[:, :, 2 * block * e :].reshape(q, count * block, -1, e)
                    wanted = min(count * block, n_steps + problem.with_end - begin)
                    self._force[:, begin : begin + wanted] = force[:, :wanted]
                if end < n_steps and self._is_over(end):
                    return end
            if self._force is not None and problem.with_end and n_steps % block == 0:
                self._force[:, n_steps] = self._force_at_end()
        return n_steps

    def _is_over(self, end: int) -> bool:
        """Whether the systems need no steps beyond this one."""
        farthest = np.abs(self._position[:, end]).max(axis=1)
        inside = (farthest <= self._problem.limit) & np.isfinite(self._momentum[:, end]).all(axis=1)
        return not (inside.all() if self._problem.stop_together else inside.any())

    def _force_at_end(self) -> Array:
        """Force on the first sample behind the last block, on the nodes, ``(q, m, e)``."""
        q, e = self._system.batch, self._system.coupled
        force = self._history.force(1)[:, 0]
        carry = self._state[:, 2 * e : -1].reshape(q, -1, e)
        for one in self._system.channels:
            force = force + np.matmul(one.channel.newest(carry), one.directions)
        return force

    def _write(self, output: Array, inputs: Array, begin: int, end: int) -> None:
        """Positions and momenta after every step, from the state at the start of its block."""
        q, e = self._system.batch, self._system.coupled
        count, size = output.shape[1], self._block * e
        at = self._n_history
        for place, target in enumerate((self._position, self._momentum)):
            change = output[:, :, place * size : (place + 1) * size]
            path = change.reshape(q, count, self._block, e)
            path = path + inputs[:, :, None, at + place * e : at + (place + 1) * e]
            target[:, begin + 1 : end + 1] = path.reshape(q, -1, e)[:, : end - begin]

    def _advance_chunk(self, first: int, count: int) -> Array:
        """Blocks `first` .. in sequence; returns all that went into them, ``(q, count, ...)``."""
        q, block, far = self._system.batch, self._block, self._plan.far
        e, m = self._system.coupled, self._system.samples
        inputs = np.zeros((q, count, self._outputs.shape[1]))
        driven: Array | None = None
        if self._problem.moments is not None:
            moments = self._moments(first * block, count * block)
            inputs[:, :, self._n_first :] = moments.reshape(q, count, -1)
            driven = np.matmul(inputs[:, :, self._n_first :], self._driven)
        damped = self._plan.is_damped
        for index in range(count):
            if index % ADVANCED_EVERY == 0:
                advanced((first + index) * block, self._problem.n_steps)
            row = inputs[:, index]
            if damped:
                row[:, : self._n_history] = self._history.force(far).reshape(q, -1)
            row[:, self._n_history : self._n_first] = self._state
            result = _apply(self._sequential, row[:, : self._n_first])
            if driven is not None:
                result = result + driven[:, index]
            self._move(result[:, self._n_history :], e)
            if damped:
                self._history.push(result[:, : self._n_history].reshape(q, far, m, e))
        self._direct += count * self._plan.block_operations
        return inputs

    def _move(self, change: Array, e: int) -> None:
        """Compensated sums of position and momentum; the carry is new."""
        self._sum.add(change[:, : 2 * e])
        self._state[:, : 2 * e] = self._sum.value
        self._state[:, 2 * e : -1] = change[:, 2 * e :]

    def _moments(self, first: int, count: int) -> Array:
        """All that is known in advance as moments, ``(q, count, s + 1, e)``, 0 after the end."""
        if self._problem.moments is None:  # pragma: no cover - checked by the caller
            raise ValueError("no moments")
        last = min(first + count, self._problem.n_steps)
        moments = self._problem.moments(slice(0, self._system.batch), first, last)
        if last - first < count:
            padded = np.zeros((moments.shape[0], count, *moments.shape[2:]))
            padded[:, : last - first] = moments
            moments = padded
        return np.ascontiguousarray(moments)


def _apply(matrix: Array, vector: Array) -> Array:
    """Matrix times vector for every system of the batch."""
    if matrix.shape[0] == 1:
        # one product without the overhead of a batch
        return np.asarray(matrix[0] @ vector[0])[None]
    return np.asarray(np.matmul(matrix, vector[..., None])[..., 0])
