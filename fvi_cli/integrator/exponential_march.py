"""Blocks of steps of linear scenes with the history as a sum of exponentials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.block_history import BatchedChannel
from fvi_cli.integrator.block_response import LinearSystem, block_response
from fvi_cli.integrator.block_sizes import LARGEST_BATCH, LARGEST_DENSE
from fvi_cli.integrator.checkpoint import Checkpoint
from fvi_cli.integrator.decoupling import Decoupling, decouple
from fvi_cli.integrator.exponential_history import (
    ExponentialHistory,
    ExponentialKernel,
    ExponentialStates,
)
from fvi_cli.integrator.known_forces import KnownForces
from fvi_cli.integrator.stepping import StepProblem

Array = NDArray[np.float64]

CHUNK = 4096
"""Steps whose known forces and results are in memory at a time; a multiple of every block."""
LARGEST_BLOCK = 64
LEAST_BLOCK = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Marched:
    """What a part of a chunk gave.

    Parameters
    ----------
    position, momentum
        At the ends of the steps of the whole chunk, shape ``(n, d)``; of meaning are the
        `finished` steps only.
    finished
        Number of steps of the chunk that are done, counted from its first.
    iterations
        Of Newton's method, one number per step that took any.
    failure
        In words what stopped the steps; empty otherwise.
    """

    position: Array
    momentum: Array
    finished: int
    iterations: tuple[int, ...] = ()
    failure: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class IterationState:
    """What Newton's iteration takes from one block to the next, as in `Checkpoint`."""

    guess: Array
    stiffness: Array
    pace: NDArray[np.int64]


class March(Protocol):
    """A run that can be advanced by blocks."""

    block: int

    @property
    def operations(self) -> int:
        """Multiply-adds spent on the memory."""

    def chunk(self, first: int, begin: int, end: int) -> Marched:
        """Steps `begin` to `end` of the chunk that starts with step `first`."""

    def checkpoint(self, case: str, step: int) -> Checkpoint:
        """The state after `step` steps, a multiple of the block."""


def block_length(size: int, batch: int) -> int:
    """Steps per block, for `size` numbers in the samples of a step and `batch` systems."""
    block = LARGEST_BLOCK
    while block > LEAST_BLOCK and (
        block * size > LARGEST_DENSE or (batch > 1 and batch * (block * size) ** 2 > LARGEST_BATCH)
    ):
        block //= 2
    return block


class LinearMarch:
    """Blocks of a linear scene: two products for the memory and one for the steps.

    Parameters
    ----------
    problem
        The steps, with the weights of one block at least.
    known
        Forces that are known in advance.
    decoupling
        Coordinates of the steps.
    kernel
        Weights as exponentials; None without memory.
    block
        Steps per block.
    start
        Where to go on; None: at the start.
    """

    def __init__(
        self,
        problem: StepProblem,
        known: KnownForces,
        decoupling: Decoupling,
        kernel: ExponentialKernel | None,
        block: int,
        start: Checkpoint | None,
    ) -> None:
        self._problem, self._known, self._decoupling = problem, known, decoupling
        self.block = block
        scene, memory = problem.scene, problem.memory
        potential = scene.potential
        stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
        directions = tuple(decoupling.matrices(c.direction) for c in memory.channels)
        system = LinearSystem(
            mass=decoupling.matrices(scene.inertia.mass),
            stiffness=None if stiffness is None else decoupling.matrices(stiffness),
            channels=tuple(
                BatchedChannel(channel=c, directions=d)
                for c, d in zip(memory.channels, directions, strict=True)
            ),
            tables=problem.tables,
            sample_matrix=memory.sample_matrix,
            carry_matrix=memory.carry_matrix,
            force_weights=memory.force_weights,
            offset=decoupling.positions(memory.offset),
            step_size=problem.step_size,
        )
        response = block_response(system, block)
        q, e = system.batch, system.coupled
        self._q, self._e, self._m = q, e, system.samples
        self._width = block * system.sample_size
        self._driven_at = self._width + system.state_size
        inside = np.concatenate([response.samples, response.state], axis=1)
        self._inside = np.ascontiguousarray(inside[:, :, : self._driven_at])
        self._driven = np.ascontiguousarray(inside[:, :, self._driven_at :].transpose(0, 2, 1))
        outputs = np.concatenate([response.position, response.momentum], axis=1)
        self._outputs = np.ascontiguousarray(outputs.transpose(0, 2, 1))
        self._history: ExponentialHistory | None = None
        if kernel is not None:
            states = None
            if start is not None:
                states = ExponentialStates(values=start.states, lost=start.states_lost)
            self._history = ExponentialHistory(kernel, directions, block, states)
        self._state = np.zeros((q, system.state_size))
        self._state[:, 2 * e : -1] = decoupling.positions(memory.first_offset).reshape(q, -1)
        self._state[:, -1] = 1.0
        self._lost = np.zeros((q, 2 * e))
        if start is None:
            self._state[:, :e] = decoupling.positions(problem.position)
            self._state[:, e : 2 * e] = decoupling.forces(problem.momentum)
        else:
            self._state[:, : 2 * e] = start.position_and_momentum
            self._lost[:] = start.lost

    @property
    def operations(self) -> int:
        """Multiply-adds spent on the memory of earlier blocks."""
        return 0 if self._history is None else self._history.operations

    def chunk(self, first: int, begin: int, end: int) -> Marched:
        """Steps `begin` to `end` of the chunk from `first` on, whole blocks."""
        q, e, block = self._q, self._e, self.block
        n_steps = self._problem.n_steps
        # the same shapes whatever part of the chunk is done: the same rounding
        count = -(-(min(first + CHUNK, n_steps) - first) // block)
        inputs, driven = self._inputs(first, count)
        for index in range((begin - first) // block, -(-(end - first) // block)):
            row = inputs[:, index]
            if self._history is not None:
                row[:, : self._width] = self._history.known().reshape(q, -1)
            row[:, self._width : self._driven_at] = self._state
            result = _apply(self._inside, row[:, : self._driven_at])
            if driven is not None:
                result += driven[:, index]
            self._move(result[:, self._width :])
            if self._history is not None:
                samples = result[:, : self._width].reshape(q, block, self._m, e)
                self._history.push(samples)
        output = np.matmul(inputs, self._outputs)
        paths = []
        for place in range(2):
            change = output[:, :, place * block * e : (place + 1) * block * e]
            path = np.cumsum(change.reshape(q, count, block, e), axis=2)
            at = self._width + place * e
            path += inputs[:, :, None, at : at + e]
            paths.append(path.reshape(q, count * block, e))
        position = self._decoupling.scene_positions(paths[0])
        momentum = self._decoupling.scene_forces(paths[1])
        finished, failure = end - first, ""
        if not np.isfinite(self._state).all():
            done = slice(begin - first, end - first)
            finite = np.isfinite(position[done]).all(axis=1) & np.isfinite(momentum[done]).all(
                axis=1
            )
            if not finite.all():
                finished = begin - first + int(np.argmin(finite)) + 1
                step = first + finished - 1
                failure = (
                    f"not finite after step {step}, t = {(step + 1) * self._problem.step_size:.6g}"
                )
        return Marched(position=position, momentum=momentum, finished=finished, failure=failure)

    def _inputs(self, first: int, count: int) -> tuple[Array, Array | None]:
        """Room for all that goes into the blocks of a chunk, with the moments in their place."""
        q = self._q
        inputs = np.zeros((q, count, self._outputs.shape[1]))
        last = min(first + count * self.block, self._problem.n_steps)
        moments = self._known.moments(first, last)
        if moments is None:
            return inputs, None
        padded = np.zeros((count * self.block, *moments.shape[1:]))
        padded[: last - first] = moments
        driving = np.ascontiguousarray(self._decoupling.forces(padded)).reshape(q, count, -1)
        inputs[:, :, self._driven_at :] = driving
        return inputs, np.matmul(driving, self._driven)

    def _move(self, change: Array) -> None:
        """Compensated sums of position and momentum; the carry is new."""
        e = self._e
        value = self._state[:, : 2 * e]
        corrected = change[:, : 2 * e] - self._lost
        total = value + corrected
        self._lost = (total - value) - corrected
        self._state[:, : 2 * e] = total
        self._state[:, 2 * e : -1] = change[:, 2 * e :]

    def checkpoint(self, case: str, step: int) -> Checkpoint:
        """The state after `step` steps."""
        return checkpoint_after(
            self._problem,
            case,
            step,
            self._state[:, : 2 * self._e],
            self._lost,
            self._history,
        )


def checkpoint_after(
    problem: StepProblem,
    case: str,
    step: int,
    value: Array,
    lost: Array,
    history: ExponentialHistory | None,
    iteration: IterationState | None = None,
) -> Checkpoint:
    """The state after `step` steps."""
    empty = np.zeros((0, 0))
    states = ExponentialStates(values=empty, lost=empty) if history is None else history.states
    if iteration is None:
        iteration = IterationState(guess=empty, stiffness=empty, pace=np.zeros(0, dtype=np.int64))
    return Checkpoint(
        case=case,
        n_steps=problem.n_steps,
        step_size=problem.step_size,
        step=step,
        position_and_momentum=value.copy(),
        lost=lost.copy(),
        states=states.values,
        states_lost=states.lost,
        guess=iteration.guess.copy(),
        stiffness=iteration.stiffness.copy(),
        pace=iteration.pace.copy(),
    )


def _apply(matrix: Array, vector: Array) -> Array:
    """Matrix times vector for every system of the batch."""
    if matrix.shape[0] == 1:
        # one product without the overhead of a batch
        return np.asarray(matrix[0] @ vector[0])[None]
    return np.asarray(np.matmul(matrix, vector[..., None])[..., 0])


def linear_decoupling(problem: StepProblem) -> Decoupling:
    """Coordinates in which a linear scene falls apart."""
    potential = problem.scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    return decouple(problem.scene.inertia.mass, stiffness, problem.memory)
