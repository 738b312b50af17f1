"""Blocks of steps of nonlinear scenes with the history as a sum of exponentials.

Every block of the memory is cut into blocks of Newton's iteration as long as they contract, down
to single steps with their own Jacobians. How it is cut depends on the steps before it only through
what a checkpoint holds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.block_history import BatchedChannel, lag_kernel, reversed_strip
from fvi_cli.integrator.block_newton import (
    GROWING_ITERATIONS,
    LEAST_BLOCK,
    REFRESH_AFTER,
    newton_block,
)
from fvi_cli.integrator.checkpoint import Checkpoint
from fvi_cli.integrator.exponential_history import (
    ExponentialHistory,
    ExponentialKernel,
    ExponentialStates,
)
from fvi_cli.integrator.exponential_march import (
    CHUNK,
    IterationState,
    Marched,
    checkpoint_after,
)
from fvi_cli.integrator.frozen_laws import BlockInputs, frozen_law, frozen_matrices
from fvi_cli.integrator.frozen_response import FrozenResponse
from fvi_cli.integrator.known_forces import KnownForces
from fvi_cli.integrator.known_motion import KnownMotion
from fvi_cli.integrator.step_solver import StepSolver
from fvi_cli.integrator.stepping import StepFailedError, StepProblem, step_solver

Array = NDArray[np.float64]


@dataclass(kw_only=True, eq=False)
class _Chunk:
    """The chunk at work: what drives it, and what has come of it so far."""

    first: int
    stepper: StepSolver
    moments: Array
    shift: Array | None
    motion: KnownMotion | None
    position: Array
    momentum: Array
    iterations: list[int]


class NewtonMarch:
    """Blocks of a nonlinear scene.

    Parameters
    ----------
    problem
        The steps, with the weights of one block at least.
    known
        Forces that are known in advance.
    kernel
        Weights as exponentials; None without memory.
    block
        Steps per block of the memory.
    start
        Where to go on; None: at the start.
    """

    def __init__(
        self,
        problem: StepProblem,
        known: KnownForces,
        kernel: ExponentialKernel | None,
        block: int,
        start: Checkpoint | None,
    ) -> None:
        self._problem, self._known = problem, known
        self.block = block
        memory, d = problem.memory, problem.scene.dimension
        self._d, self._m = d, problem.tables.sample_points.size
        self._size = self._m * d
        self._channels = tuple(
            BatchedChannel(channel=c, directions=c.direction[None]) for c in memory.channels
        )
        self._history: ExponentialHistory | None = None
        self._strip = np.zeros((0, 0))
        if kernel is not None:
            states = None
            if start is not None:
                states = ExponentialStates(values=start.states, lost=start.states_lost)
            directions = tuple(c.directions for c in self._channels)
            self._history = ExponentialHistory(kernel, directions, block, states)
            kernel_of_lags = lag_kernel(self._channels, 0, 2 * block, self._m)
            self._strip = reversed_strip(kernel_of_lags, block, block)[0]
        # 0: blocks would be too large, every step is taken alone
        most = newton_block(problem.scene, self._m, problem.n_steps) or 0
        self._largest = min(most, block) if min(most, block) >= LEAST_BLOCK else 0
        self._value = np.concatenate([problem.position, problem.momentum])
        self._lost = np.zeros(2 * d)
        self._guess = np.zeros((1, d if problem.scene.lagrangian is None else 2 * d))
        self._count = self._ceiling = self._largest
        self._excess = 0
        shift = None if known.shift is None else known.shift(0, 1)[0, 0]
        motion = None if known.motion is None else known.motion(0, 1)
        stiffness = self._frozen(0, shift, None if motion is None else motion.place(0, 0))
        if start is not None:
            self._value = start.position_and_momentum[0].copy()
            self._lost = start.lost[0].copy()
            self._guess, stiffness = start.guess.copy(), start.stiffness.copy()
            self._count, self._ceiling, self._excess = (int(number) for number in start.pace)
        self._stiffness = stiffness
        self._response: FrozenResponse | None = None

    @property
    def operations(self) -> int:
        """Multiply-adds spent on the memory of earlier blocks."""
        return 0 if self._history is None else self._history.operations

    def chunk(self, first: int, begin: int, end: int) -> Marched:
        """Steps `begin` to `end` of the chunk from `first` on, whole blocks."""
        problem, d = self._problem, self._d
        last = min(first + CHUNK, problem.n_steps)
        shift = None if self._known.shift is None else self._known.shift(first, last)
        moments = self._known.moments(first, last)
        motion = None if self._known.motion is None else self._known.motion(first, last)
        local = replace(
            problem,
            moments=moments,
            position_shift=shift,
            known_motion=motion,
            first_step=first,
        )
        if moments is None:
            moments = np.zeros((last - first, problem.tables.degree + 1, d))
        chunk = _Chunk(
            first=first,
            stepper=step_solver(local),
            moments=moments,
            shift=shift,
            motion=motion,
            position=np.zeros((last - first, d)),
            momentum=np.zeros((last - first, d)),
            iterations=[],
        )
        if begin == first:
            self._ceiling = self._largest
        done, failure = begin - first, ""
        while done < end - first and not failure:
            reached = min(done + self.block, end - first)
            done, failure = self._memory_block(chunk, done, reached)
        return Marched(
            position=chunk.position,
            momentum=chunk.momentum,
            finished=done,
            iterations=tuple(chunk.iterations),
            failure=failure,
        )

    def _memory_block(self, chunk: _Chunk, begin: int, end: int) -> tuple[int, str]:
        """Steps `begin` to `end` of the chunk; how far they came, and what stopped them."""
        samples = np.zeros((self.block, self._size))
        force = np.zeros((self.block, self._size))
        if self._history is not None:
            force = self._history.known().reshape(self.block, self._size)
        done, alone = begin, self._largest == 0
        while done < end:
            place, left = done - begin, end - done
            count = 0 if alone else self._count
            while count > left:
                count //= 2
            if count >= LEAST_BLOCK:
                if self._newton_block(chunk, done, count, force, samples, place):
                    done += count
                elif self._count < LEAST_BLOCK:
                    # the rest of the block in single steps
                    self._count = self._ceiling = LEAST_BLOCK
                    alone = True
                continue
            failure = self._step(chunk, done, force, samples, place)
            if failure.startswith("step"):
                return done, failure
            done += 1
            if failure:
                return done, failure
        if self._history is not None and end - begin == self.block:
            self._history.push(samples.reshape(1, self.block, self._m, self._d))
        return done, ""

    def _known_force(self, force: Array, samples: Array, place: int, count: int) -> Array:
        """Force of all finished samples on the next `count` steps, ``(count, m d)``."""
        known = force[place : place + count]
        if place and self._history is not None:
            reach = place * self._size
            strip = self._strip[: count * self._size, self._strip.shape[1] - reach :]
            known = known + (strip @ samples[:place].ravel()).reshape(count, self._size)
        return np.asarray(known)

    def _newton_block(
        self, chunk: _Chunk, done: int, count: int, force: Array, samples: Array, place: int
    ) -> bool:
        """Attempt `count` steps; whether they are done."""
        if self._response is None:
            self._response = FrozenResponse(
                self._problem,
                frozen_law(self._problem, self._stiffness),
                self._channels,
                self._largest,
                with_force=False,
            )
        d, shift, motion = self._d, chunk.shift, chunk.motion
        carry = self._problem.memory.offset.ravel()
        found = self._response.attempt(
            BlockInputs(
                known=self._known_force(force, samples, place, count),
                state=np.concatenate([self._value, carry, [1.0]]),
                moments=chunk.moments[done : done + count],
                remainder=self._guess,
                first=chunk.first + done,
                shift=None if shift is None else shift[done : done + count],
                motion=None if motion is None else motion.steps(done, done + count),
            )
        )
        if found is None:
            self._count = self._ceiling = count // 2
            return False
        chunk.position[done : done + count] = self._value[:d] + found.path
        chunk.momentum[done : done + count] = self._value[d:] + found.momentum_path
        samples[place : place + count] = found.samples
        self._move(np.concatenate([found.path[-1], found.momentum_path[-1]]))
        self._guess = found.remainder.copy()
        chunk.iterations.extend([len(found.changes), *[0] * (count - 1)])
        if len(found.changes) <= GROWING_ITERATIONS and count == self._count:
            self._count = min(2 * count, max(self._ceiling, LEAST_BLOCK))
        self._excess += len(found.changes) - 4
        if self._excess > REFRESH_AFTER:
            end = done + count - 1
            self._stiffness = self._frozen(
                chunk.first + end + 1,
                None if shift is None else shift[end, -1],
                None if motion is None else motion.place(end, -1),
            )
            self._response, self._excess = None, 0
        return True

    def _step(self, chunk: _Chunk, done: int, force: Array, samples: Array, place: int) -> str:
        """One step with its own Jacobian; in words what went wrong, if anything."""
        problem, memory, d = self._problem, self._problem.memory, self._d
        known = self._known_force(force, samples, place, 1).reshape(self._m, d)
        position, momentum = self._value[:d].copy(), self._value[d:].copy()
        guess = chunk.stepper.free_motion(done, position, momentum)
        step = chunk.first + done
        try:
            increments, _, change, residuals = chunk.stepper.advance(
                done, position, momentum, known, memory.offset, guess
            )
        except StepFailedError as error:
            chunk.iterations.append(len(error.residuals))
            return f"step {step}, t = {step * problem.step_size:.6g}: {error}"
        chunk.iterations.append(len(residuals))
        samples[place] = (memory.sample_matrix.T @ increments + memory.offset).ravel()
        self._move(np.concatenate([increments[-1], change]))
        chunk.position[done], chunk.momentum[done] = self._value[:d], self._value[d:]
        if not np.isfinite(self._value).all():
            return f"not finite after step {step}, t = {(step + 1) * problem.step_size:.6g}"
        return ""

    def _frozen(self, step: int, shift: Array | None, motion: tuple[Array, Array] | None) -> Array:
        """The matrices of a linear response from a step on, close to where the run is."""
        position, momentum = self._value[: self._d], self._value[self._d :]
        if shift is not None:
            position = position + shift
        if motion is not None:
            position, momentum = position + motion[0], momentum + motion[1]
        time = step * self._problem.step_size
        return frozen_matrices(self._problem, position, momentum, time)

    def _move(self, change: Array) -> None:
        """Compensated sums of position and momentum."""
        corrected = change - self._lost
        total = self._value + corrected
        self._lost = (total - self._value) - corrected
        self._value = total

    def checkpoint(self, case: str, step: int) -> Checkpoint:
        """The state after `step` steps."""
        pace = np.array([self._count, self._ceiling, self._excess], dtype=np.int64)
        return checkpoint_after(
            self._problem,
            case,
            step,
            self._value[None],
            self._lost[None],
            self._history,
            IterationState(guess=self._guess, stiffness=self._stiffness, pace=pace),
        )
