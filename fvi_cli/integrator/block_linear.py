"""Linear scenes, block by block: no loop over steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.block_history import (
    BatchedChannel,
    GroupHistory,
    lag_kernel,
    reversed_strip,
)
from fvi_cli.integrator.block_response import LinearSystem, block_response
from fvi_cli.integrator.decoupling import Decoupling, decouple
from fvi_cli.integrator.stepping import Stepped, StepProblem
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]

LARGEST_DENSE = 2048
"""Block times samples times coupled components, at most."""
LARGEST_BATCH = 2**19
"""Entries of the matrices of all systems of a batch: large ones would not stay in the cache."""
LARGEST_STRIP = 2**20
"""Entries of the matrix that sums up a group's earlier blocks."""
CHUNK_BLOCKS = 64
"""Blocks whose outputs are made by one matrix product."""


@dataclass(frozen=True, kw_only=True)
class BlockSizes:
    """Steps per block, and blocks per group (a group's sums are direct)."""

    block: int
    blocks: int

    @property
    def group(self) -> int:
        """Steps per group."""
        return self.block * self.blocks


def block_sizes(system: LinearSystem, n_steps: int) -> BlockSizes | None:
    """Sizes found to be quick by measurement; None where even small blocks would be too large."""
    size = system.sample_size
    block = 128 if size == 1 else 64
    while block > 8 and (
        block * size > LARGEST_DENSE
        or (system.batch > 1 and system.batch * (block * size) ** 2 > LARGEST_BATCH)
    ):
        block //= 2
    if block * size > LARGEST_DENSE:
        return None
    while block > 8 and 32 * block > n_steps:
        block //= 2
    blocks = 8 if size == 1 else 4
    while blocks > 1 and system.batch * block * block * blocks * size * size > LARGEST_STRIP:
        blocks //= 2
    return BlockSizes(block=block, blocks=blocks)


def linear_system(problem: StepProblem, decoupling: Decoupling) -> LinearSystem:
    """The scene of `problem` in the coordinates of `decoupling`."""
    scene, memory = problem.scene, problem.memory
    potential = scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    return LinearSystem(
        mass=decoupling.matrices(scene.inertia.mass),
        stiffness=None if stiffness is None else decoupling.matrices(stiffness),
        channels=tuple(
            BatchedChannel(channel=c, directions=decoupling.matrices(c.direction))
            for c in memory.channels
        ),
        tables=problem.tables,
        sample_matrix=memory.sample_matrix,
        carry_matrix=memory.carry_matrix,
        force_weights=memory.force_weights,
        offset=decoupling.positions(memory.offset),
        step_size=problem.step_size,
    )


def run_linear_blocks(problem: StepProblem) -> Stepped | None:
    """All steps of a linear scene; None where its blocks would be too large.

    Returns
    -------
    Stepped
        As `run_steps` gives it, without the samples; with the damping force at the nodes only
        where the samples lie on them.
    """
    scene = problem.scene
    potential = scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    decoupling = decouple(scene.inertia.mass, stiffness, problem.memory)
    system = linear_system(problem, decoupling)
    sizes = block_sizes(system, problem.n_steps)
    if sizes is None:
        return None
    return _LinearBlocks(problem, decoupling, system, sizes).run()


class _LinearBlocks:
    """State and matrices of one run."""

    def __init__(
        self,
        problem: StepProblem,
        decoupling: Decoupling,
        system: LinearSystem,
        sizes: BlockSizes,
    ) -> None:
        self._problem, self._decoupling, self._system = problem, decoupling, system
        self._block, self._blocks = sizes.block, sizes.blocks
        response = block_response(system, sizes.block)
        q, e = system.batch, system.coupled
        self._width = system.sample_size
        self._on_nodes = problem.skip_first_kick and bool(system.channels)
        # a finite memory reaches from the last steps of a block to the first of the next
        self._far = min(sizes.block, max(system.memory - 1, 0))
        self._n_history = self._far * self._width
        self._n_state = system.state_size
        self._n_first = self._n_history + self._n_state
        whole = sizes.block * self._width
        columns = np.r_[: self._n_history, whole : response.state.shape[2]]
        inside = np.concatenate(
            [response.samples[:, whole - self._n_history :], response.state], axis=1
        )[:, :, columns]
        self._sequential = np.ascontiguousarray(inside[:, :, : self._n_first])
        self._driven = np.ascontiguousarray(inside[:, :, self._n_first :].transpose(0, 2, 1))
        outputs = [response.position, response.momentum]
        if self._on_nodes:
            outputs.append(response.force)
        joined = np.concatenate(outputs, axis=1)[:, :, columns]
        self._outputs = np.ascontiguousarray(joined.transpose(0, 2, 1))
        self._reach = 0
        self._strip: Array | None = None
        if system.memory > 1 and sizes.blocks > 1:
            self._reach = min(sizes.block * (sizes.blocks - 1), system.memory - 1)
            kernel = lag_kernel(system.channels, 0, self._far + self._reach, system.samples)
            self._strip = reversed_strip(kernel, self._far, self._reach)
        n_steps = problem.n_steps
        self._history = GroupHistory(
            system.channels if system.memory > 1 else (), system.samples, sizes.group, n_steps
        )
        state = np.zeros((q, self._n_state))
        state[:, :e] = decoupling.positions(problem.position)
        state[:, e : 2 * e] = decoupling.forces(problem.momentum)
        state[:, 2 * e : -1] = decoupling.positions(problem.memory.first_offset).reshape(q, -1)
        state[:, -1] = 1.0
        self._state = state
        self._lost = np.zeros((q, 2 * e))
        self.operations = 0
        self._has_moments = not (
            problem.moments is None
            and problem.extra_force is None
            and problem.memory.known_force is None
            and problem.position_shift is None
            and not (problem.skip_first_kick and np.any(problem.memory.first_offset != 0))
        )

    def run(self) -> Stepped:
        problem, e = self._problem, self._system.coupled
        n_steps, block, q = problem.n_steps, self._block, self._system.batch
        total = -(-n_steps // block)
        group = block * self._blocks
        if self._on_nodes and n_steps % block == 0 and n_steps % group != 0:
            # one block more gives the force at the end
            total += 1
        positions = np.empty((q, n_steps + 1, e))
        momenta = np.empty((q, n_steps + 1, e))
        positions[:, 0], momenta[:, 0] = self._state[:, :e], self._state[:, e : 2 * e]
        forces = np.zeros((q, n_steps + 1, self._system.samples, e)) if self._on_nodes else None
        done = n_steps
        with np.errstate(over="ignore", invalid="ignore"):
            per_chunk = CHUNK_BLOCKS - CHUNK_BLOCKS % self._blocks
            for first in range(0, total, per_chunk):
                count = min(per_chunk, total - first)
                inputs = self._advance_chunk(first, count)
                output = np.matmul(inputs, self._outputs)
                begin, end = first * block, min((first + count) * block, n_steps)
                self._write(output, inputs, positions, momenta, begin, end)
                if forces is not None:
                    force = output[:, :, 2 * block * e :].reshape(q, count * block, -1, e)
                    wanted = min(count * block, n_steps + 1 - begin)
                    forces[:, begin : begin + wanted] = force[:, :wanted]
                if not np.isfinite(self._state).all():
                    finite = np.isfinite(positions[:, : end + 1]) & np.isfinite(
                        momenta[:, : end + 1]
                    )
                    whole = finite.all(axis=(0, 2))
                    if not whole.all():
                        done = int(np.argmin(whole))
                        break
                reached = self._decoupling.scene_positions(positions[:, end])
                if end < n_steps and np.abs(reached).max() > self._problem.stop_beyond:
                    done = end
                    break
        if forces is not None and done == n_steps and n_steps % group == 0:
            forces[:, done] = self._force_after_groups()
        return self._stepped(positions, momenta, forces, done)

    def _force_after_groups(self) -> Array:
        """Force on the first sample after the last group, on the nodes, ``(q, 1, e)``."""
        q, e, n_steps = self._system.batch, self._system.coupled, self._problem.n_steps
        total = np.zeros((q, 1, e))
        carry = self._state[:, 2 * e : -1]
        for batched in self._system.channels:
            weights = batched.channel.weights[: n_steps + 1]
            reach = weights.size - 1
            past = self._history.samples[:, 0, :, n_steps - reach : n_steps] @ weights[:0:-1]
            total[:, 0] += np.einsum("qa,qab->qb", past + weights[0] * carry, batched.directions)
            self.operations += q * e * reach
        return total

    def _write(
        self, output: Array, inputs: Array, positions: Array, momenta: Array, begin: int, end: int
    ) -> None:
        """Running sums inside every block, from the state at its start."""
        q, e = self._system.batch, self._system.coupled
        count, size = output.shape[1], self._block * e
        at = self._n_history
        for place, target in enumerate((positions, momenta)):
            change = output[:, :, place * size : (place + 1) * size]
            path = np.cumsum(change.reshape(q, count, self._block, e), axis=2)
            path += inputs[:, :, None, at + place * e : at + (place + 1) * e]
            target[:, begin + 1 : end + 1] = path.reshape(q, -1, e)[:, : end - begin]

    def _advance_chunk(self, first: int, count: int) -> Array:
        """Blocks `first` .. in sequence; returns all that went into them, ``(q, count, ...)``."""
        q, block, blocks = self._system.batch, self._block, self._blocks
        width, e = self._width, self._system.coupled
        inputs = np.zeros((q, count, self._outputs.shape[1]))
        driven: Array | None = None
        if self._has_moments:
            moments = self._moments(first * block, count * block)
            inputs[:, :, self._n_first :] = moments.reshape(q, count, -1)
            driven = np.matmul(inputs[:, :, self._n_first :], self._driven)
        samples = np.zeros((q, blocks * block * width))
        whole, begin = block * width, self._n_history
        damped = self._system.memory > 1
        strip = self._strip
        force: Array | None = None
        for index in range(count):
            place = (first + index) % blocks
            group = (first + index) // blocks
            row = inputs[:, index]
            if damped:
                if place == 0 or force is None:
                    force = self._history.force_on(group).reshape(q, blocks, whole)
                known = force[:, place, :begin]
                if place and strip is not None:
                    reach = min(self._reach, place * block) * width
                    past = samples[:, place * whole - reach : place * whole]
                    known = known + _apply(strip[:, :, strip.shape[2] - reach :], past)
                    self.operations += q * begin * reach
                row[:, :begin] = known
            row[:, begin : self._n_first] = self._state
            result = _apply(self._sequential, row[:, : self._n_first])
            if driven is not None:
                result = result + driven[:, index]
            self._move(result[:, begin:], e)
            if damped:
                end = (place + 1) * whole
                samples[:, end - begin : end] = result[:, :begin]
                if place == blocks - 1:
                    shape = (q, blocks * block, self._system.samples, e)
                    self._history.finish(group, samples.reshape(shape))
        if damped:
            # what a block sums over its own steps stands in its matrix
            own = sum(min(index + 1, self._system.memory) for index in range(block))
            self.operations += q * count * own * width * width
        return inputs

    def _move(self, change: Array, e: int) -> None:
        """Compensated sums of position and momentum; the carry is new."""
        value = self._state[:, : 2 * e]
        corrected = change[:, : 2 * e] - self._lost
        total = value + corrected
        self._lost = (total - value) - corrected
        self._state[:, : 2 * e] = total
        self._state[:, 2 * e : -1] = change[:, 2 * e :]

    def _moments(self, first: int, count: int) -> Array:
        """All that is known in advance as moments, ``(q, count, s + 1, e)``, 0 after the end."""
        problem = self._problem
        last = min(first + count, problem.n_steps)
        moments = known_moments(problem, first, last)
        if last - first < count:
            padded = np.zeros((count, *moments.shape[1:]))
            padded[: last - first] = moments
            moments = padded
        return np.ascontiguousarray(self._decoupling.forces(moments))

    def _stepped(
        self, positions: Array, momenta: Array, forces: Array | None, done: int
    ) -> Stepped:
        problem, n_steps = self._problem, self._problem.n_steps
        failure = ""
        last = positions[:, done], momenta[:, done]
        if not all(np.isfinite(value).all() for value in last):
            time = done * problem.step_size
            failure = f"not finite after step {done - 1}, t = {time:.6g}"
        m, d = self._system.samples, problem.scene.dimension
        end_force = np.zeros((0, m, d))
        if forces is not None:
            end_force = self._decoupling.scene_forces(forces[:, : done + 1])
            for known in (problem.memory.known_force, problem.extra_force):
                if known is not None:
                    end_force = end_force + known[: done + 1]
            # the first kick is left out; after a failure there is none at the end
            end_force[0] = 0.0
            if done < n_steps:
                end_force[done] = 0.0
        return Stepped(
            position=self._decoupling.scene_positions(positions[:, : done + 1]),
            momentum=self._decoupling.scene_forces(momenta[:, : done + 1]),
            samples=np.zeros((0, m, d)),
            end_force=end_force,
            operations=self.operations + self._history.operations,
            newton=NewtonRecord(),
            failure=failure,
        )


def _apply(matrix: Array, vector: Array) -> Array:
    """Matrix times vector for every system of the batch."""
    if matrix.shape[0] == 1:
        # one product without the overhead of a batch
        return np.asarray(matrix[0] @ vector[0])[None]
    return np.asarray(np.matmul(matrix, vector[..., None])[..., 0])


def known_moments(problem: StepProblem, first: int, last: int) -> Array:
    """Moments of all that is known in advance for steps `first` to `last`, ``(n, s + 1, d)``."""
    tables, memory, h = problem.tables, problem.memory, problem.step_size
    moments = np.zeros((last - first, tables.degree + 1, problem.scene.dimension))
    if problem.moments is not None:
        moments += problem.moments[first:last]
    to_moments = h * memory.force_weights
    start = 1 if first == 0 and problem.skip_first_kick else 0
    for force in (memory.known_force, problem.extra_force):
        if force is not None:
            moments[start:] -= np.einsum("ni,kid->knd", to_moments, force[first + start : last])
    if start:
        # the block counts the force of the first sample; it is taken away again
        for channel in memory.channels:
            moments[0] += to_moments @ (channel.newest(memory.first_offset) @ channel.direction)
    potential = problem.scene.potential
    if problem.position_shift is not None and isinstance(potential, QuadraticPotential):
        pull = problem.position_shift[first:last] @ potential.stiffness
        moments -= h * np.einsum("ni,kid->knd", tables.test_weights, pull)
    return moments
