"""Nonlinear scenes, block by block: Newton's iteration with a frozen linear response.

A block whose fixed point (:mod:`fvi_cli.integrator.steps.newton_blocks`) does not contract is
halved, down to single steps with their own Jacobians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.blocks.convolved import Convolved, pairs
from fvi_cli.integrator.blocks.history import BatchedChannel, BlockHistory
from fvi_cli.integrator.blocks.linear import known_moments
from fvi_cli.integrator.blocks.response import lag_damping, toeplitz
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem, noted
from fvi_cli.integrator.equal_steps.stepping import Stepper
from fvi_cli.integrator.steps.block_lengths import (
    LARGEST_DENSE,
    LEAST_BLOCK,
    BlockLengths,
    newton_block,
)
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.steps.newton_blocks import FrozenBlocks, frozen_law
from fvi_cli.integrator.steps.step import StepFailedError
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class NewtonPlan:
    """How the steps of a nonlinear scene are done in blocks.

    Parameters
    ----------
    convolved, n_steps
        What is convolved, and N.
    block
        Steps of the largest block.
    """

    convolved: Convolved
    n_steps: int
    block: int

    @property
    def is_damped(self) -> bool:
        """Whether anything is remembered."""
        return self.convolved.memory > 1

    @property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory in a step, inside of its block as of half the largest one.

        So they do not depend on how the steps were cut into blocks; attempts that failed are work
        of Newton's iteration.
        """
        if not self.is_damped:
            return 0
        inside = pairs(self.block, self.convolved.memory) // self.block + 1
        return inside * self.convolved.size**2 + self.convolved.operations_per_step

    @property
    def operations(self) -> int:
        """Multiply-adds of the memory in the whole run."""
        return self.n_steps * self.operations_per_step


def plan_newton(scene: Scene, convolved: Convolved, n_steps: int) -> NewtonPlan | None:
    """Blocks of a nonlinear scene; None for others and where the smallest would be too large.

    Parameters
    ----------
    scene
        What is integrated.
    convolved, n_steps
        As for :class:`NewtonPlan`.
    """
    size = convolved.size
    if scene.is_linear or scene.lagrangian is not None or LEAST_BLOCK * size > LARGEST_DENSE:
        return None
    # even on few steps blocks are quicker than one step after the other
    block = max(newton_block(size, n_steps), LEAST_BLOCK)
    return NewtonPlan(convolved=convolved, n_steps=n_steps, block=block)


def run_newton_blocks(problem: StepProblem, plan: NewtonPlan) -> Stepped:
    """All steps of a nonlinear scene as planned.

    Returns
    -------
    Stepped
        As `run_steps` gives it, without the samples; with the damping force only where it is
        kept, or where the samples lie on the nodes.
    """
    return _NewtonBlocks(problem, plan).run()


class _NewtonBlocks:
    """State and matrices of one run."""

    def __init__(self, problem: StepProblem, plan: NewtonPlan) -> None:
        self._problem, self._plan = problem, plan
        memory, d = problem.memory, problem.scene.dimension
        self._d, self._m = d, problem.tables.sample_points.size
        channels = tuple(
            BatchedChannel(channel=c, directions=c.direction[None]) for c in memory.channels
        )
        self._damped, self._with_end = plan.is_damped, problem.skip_first_kick
        self._with_force = bool(memory.channels) and (self._with_end or problem.keep_force)
        self._history = BlockHistory(channels if self._damped else (), self._m, plan.block)
        self._stepper = Stepper(problem)
        self._state = np.concatenate(
            [problem.position, problem.momentum, memory.first_offset.ravel(), [1.0]]
        )
        self._sum = CompensatedSum(self._state[: 2 * d])
        self._lengths = BlockLengths(plan.block)
        self._newton = NewtonRecord()
        self._remainder = np.zeros(d)
        self._own = [(toeplitz(c, plan.block), c.direction) for c in memory.channels]
        self._freeze()

    def run(self) -> Stepped:
        problem, d = self._problem, self._d
        n_steps = problem.n_steps
        positions, momenta = np.empty((n_steps + 1, d)), np.empty((n_steps + 1, d))
        forces = np.zeros((n_steps + 1, self._m, d)) if self._with_force else None
        positions[0], momenta[0] = problem.position, problem.momentum
        done, failure = 0, ""
        with np.errstate(all="ignore"):
            while done < n_steps and not failure:
                advanced(done, n_steps)
                count = self._lengths.trial(n_steps - done)
                if count and self._block(done, count, positions, momenta, forces):
                    done += count
                elif not count:
                    failure = self._step(done, positions, momenta, forces)
                    done += 0 if failure.startswith("step") else 1
                else:
                    continue
                if np.abs(positions[done]).max() > problem.stop_beyond:
                    break
        if forces is not None and self._with_end and done == n_steps and not failure:
            carry = self._state[2 * d : -1].reshape(self._m, d)
            forces[done] = self._stepper.newest_force(self._known(1)[0], carry)
        return self._stepped(positions, momenta, forces, done, failure)

    def _known(self, count: int) -> Array:
        """Force of all finished samples on the next `count` steps, ``(count, m, d)``."""
        return np.asarray(self._history.force(count)[0])

    def _freeze(self) -> None:
        """Linear response with the second derivatives at the state that is reached."""
        problem = self._problem
        law = frozen_law(
            dynamics_of(problem.scene),
            self._state[: self._d],
            self._state[self._d : 2 * self._d],
            0.0,
            problem.scene.inertia.mass,
        )
        self._frozen = FrozenBlocks(
            law,
            tuple(one.direction for one in problem.memory.channels),
            lag_damping(problem.memory, problem.step_size),
            problem.tables,
            problem.step_size,
            self._plan.block,
        )
        self._lengths.renewed()

    def _block(
        self, done: int, count: int, positions: Array, momenta: Array, forces: Array | None
    ) -> bool:
        """Attempt `count` steps; whether they are done."""
        d, h, memory = self._d, self._problem.step_size, self._problem.memory
        # what earlier steps and constants add to the samples acts as a known force
        added = np.broadcast_to(memory.offset, (count, self._m, d)).copy()
        added[0] = self._state[2 * d : -1].reshape(self._m, d)
        known = self._known(count)
        loads = known_moments(self._problem, done, done + count)
        if self._own:
            acting = known + self._own_force(added)
            loads = loads - h * np.einsum("nm,kmd->knd", memory.force_weights, acting)
        position, momentum = self._state[:d], self._state[d : 2 * d]
        found = self._frozen.attempt(0.0, position, momentum, loads, self._remainder, count)
        if found is None:
            self._lengths.failed(count)
            return False
        positions[done + 1 : done + count + 1] = position + found.way
        momenta[done + 1 : done + count + 1] = momentum + found.momentum_change
        samples = h * found.samples + added
        if forces is not None:
            forces[done : done + count] = known + self._own_force(samples)
        if self._damped:
            self._history.push(samples[None])
        self._move(np.concatenate([found.way[-1], found.momentum_change[-1]]))
        self._state[2 * d : -1] = (h * found.carry + memory.offset).ravel()
        self._remainder = found.remainder
        self._newton = noted(self._newton, done, found.changes)
        self._lengths.contracted(count, len(found.changes))
        if self._lengths.is_stale:
            self._freeze()
        return True

    def _own_force(self, samples: Array) -> Array:
        """Force of the samples of a block on its steps, both of shape ``(n, m, d)``."""
        total, count = np.zeros_like(samples), samples.shape[0]
        flat = samples.reshape(count, -1)
        for weights, direction in self._own:
            total += (weights[:count, :count] @ flat).reshape(samples.shape) @ direction
        return total

    def _move(self, change: Array) -> None:
        self._sum.add(change)
        self._state[: 2 * self._d] = self._sum.value

    def _step(self, done: int, positions: Array, momenta: Array, forces: Array | None) -> str:
        """One step with its own Jacobian; in words what went wrong, if anything."""
        problem, d, memory = self._problem, self._d, self._problem.memory
        shape = (self._m, d)
        position, momentum = self._state[:d].copy(), self._state[d : 2 * d].copy()
        offset = self._state[2 * d : -1].reshape(shape).copy()
        finished = known = self._known(1)[0]
        if memory.known_force is not None:
            known = known + memory.known_force[done]
        guess = self._stepper.free_motion(done, position, momentum)
        acting, newest = known, offset
        if problem.skip_first_kick and done == 0:
            acting = newest = np.zeros(shape)
        try:
            found = self._stepper.advance(done, position, momentum, acting, newest, guess)
        except StepFailedError as error:
            self._newton = noted(self._newton, done, error.residuals)
            return f"step {done}, t = {done * problem.step_size:.6g}: {error}"
        increments, force, change, residuals = found
        self._newton = noted(self._newton, done, residuals)
        if self._damped:
            sample = memory.sample_matrix.T @ increments + offset
            self._history.push(sample[None, None])
        if forces is not None:
            # what is known in advance is added at the end
            forces[done] = force - (known - finished)
        self._move(np.concatenate([increments[-1], change]))
        carry = memory.carry_matrix.T @ increments + memory.offset
        self._state[2 * d : -1] = carry.ravel()
        positions[done + 1], momenta[done + 1] = self._state[:d], self._state[d : 2 * d]
        if not np.isfinite(self._state[: 2 * d]).all():
            return f"not finite after step {done}, t = {(done + 1) * problem.step_size:.6g}"
        return ""

    def _stepped(
        self, positions: Array, momenta: Array, forces: Array | None, done: int, failure: str
    ) -> Stepped:
        problem = self._problem
        end_force = np.zeros((0, self._m, self._d))
        if forces is not None:
            end_force = forces[: done + 1]
            if problem.memory.known_force is not None:
                end_force = end_force + problem.memory.known_force[: done + 1]
            if problem.skip_first_kick:
                end_force[0] = 0.0
            if done < problem.n_steps or failure:
                end_force[done] = 0.0
        return Stepped(
            position=positions[: done + 1],
            momentum=momenta[: done + 1],
            samples=np.zeros((0, self._m, self._d)),
            end_force=end_force,
            operations=done * self._plan.operations_per_step,
            newton=self._newton,
            failure=failure,
        )
