r"""One step after the other by backward differences.

The equations of a step are those of :mod:`fvi_cli.integrator.steps.step`, in which the damping
force acts where its samples are: with increments :math:`\delta = h U` and the samples
:math:`E^T \delta + \text{offset}` (Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv 2403.18362,
section "Higher order approximations of the action").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.convolution.damping import Damping, DampingTables, Direction, no_damping
from fvi_cli.integrator.equal_steps.direct_history import DirectHistory
from fvi_cli.integrator.equal_steps.problem import History, Stepped, StepProblem, noted
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.steps.step import ForceSampling, StepFailedError, StepSolver
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]

NO_STATES: Array = np.zeros((0, 0))


class NewestWeights(Damping):
    """The newest weights as the local blocks of a step; what is finished comes from outside."""

    def __init__(self, problem: StepProblem) -> None:
        channels, d = problem.memory.channels, problem.scene.dimension
        self.directions = tuple(
            Direction(matrix=one.direction, inner=one.direction, terms=(), factors=(), rate=0.0)
            for one in channels
        )
        self.reach, self.n_remembered = None, d
        self._stages = problem.tables.sample_points.size
        self._local = tuple(one.weights[0] * np.eye(self._stages) for one in channels)

    def tables(self, step_size: float) -> DampingTables:
        """Local blocks on velocities; no states."""
        local = tuple(step_size * one for one in self._local)
        return replace(no_damping(self._stages, self.n_remembered), local=local)


class Stepper:
    """Solves the steps of a problem one by one.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a linear step have no unique solution.
    """

    def __init__(self, problem: StepProblem) -> None:
        self._problem, memory = problem, problem.memory
        self._dynamics = dynamics_of(problem.scene)
        self._solver = StepSolver(
            self._dynamics,
            NewestWeights(problem),
            problem.tables,
            ForceSampling(
                test=memory.force_weights[:-1],
                weights=memory.momentum_weights,
                driving=memory.sample_matrix.T,
            ),
        )
        self._at = self._solver.matrices(problem.step_size)

    def free_motion(self, index: int, position: Array, momentum: Array) -> Array:
        """Increments of step `index` if nothing acted on it, shape ``(s, d)``."""
        h = self._problem.step_size
        with np.errstate(all="ignore"):
            velocity = self._dynamics.velocity(position, momentum, index * h)
        velocity = np.where(np.isfinite(velocity), velocity, 0.0)
        return np.outer(h * self._problem.tables.control_points[1:], velocity)

    def newest_force(self, known: Array, samples: Array) -> Array:
        """Known force, plus the newest weights times the newest samples, ``(m, d)``."""
        for channel in self._problem.memory.channels:
            known = known + channel.newest(samples) @ channel.direction
        return known

    def advance(
        self,
        index: int,
        position: Array,
        momentum: Array,
        known: Array,
        offset: Array,
        guess: Array,
    ) -> tuple[Array, Array, Array, tuple[float, ...]]:
        """Solve step `index`: increments, damping force, momentum increment, residuals.

        Raises
        ------
        StepFailedError
            If Newton's iteration does not converge.
        """
        problem, h = self._problem, self._problem.step_size
        found = self._solver.solve(
            self._at,
            index * h,
            position,
            momentum,
            NO_STATES,
            None if problem.moments is None else problem.moments[index],
            guess / h,
            past=self.newest_force(known, offset),
        )
        increments = h * found.unknowns
        return increments, found.damping_force, found.momentum_change, found.residuals


def run_steps(
    problem: StepProblem, history: History | None = None, *, keep_increments: bool = False
) -> Stepped:
    """All steps, one after the other, until the end or until the numbers cease to be finite.

    Parameters
    ----------
    problem
        Everything that the steps need.
    history
        Sums up the memory; None: directly.
    keep_increments
        Keep the increments of every step.
    """
    tables, memory, n_steps = problem.tables, problem.memory, problem.n_steps
    d, m = problem.scene.dimension, tables.sample_points.size
    stepper = Stepper(problem)
    if history is None:
        history = DirectHistory(memory, n_steps, d)
    positions = np.empty((n_steps + 1, d))
    momenta = np.empty((n_steps + 1, d))
    samples = np.empty((n_steps, m, d))
    forces = np.zeros((n_steps + 1, m, d))
    kept = np.empty((n_steps if keep_increments else 0, tables.degree, d))
    position = CompensatedSum(problem.position)
    momentum = CompensatedSum(problem.momentum)
    positions[0], momenta[0] = position.value, momentum.value
    guess = stepper.free_motion(0, problem.position, problem.momentum)
    offset = memory.first_offset
    newton = NewtonRecord()
    failure = ""
    done = 0
    damped = bool(memory.channels) or memory.known_force is not None
    inner = tables.sample_basis[1:].T
    with np.errstate(over="ignore", invalid="ignore"):
        for index in range(n_steps):
            if index % STRIDE == 0:
                advanced(index, n_steps)
            known = _known(problem, history, index) if damped else forces[0]
            newest = offset
            if problem.skip_first_kick and index == 0:
                # explicit sampling only: no force of the newest sample either
                known = newest = forces[0]
            try:
                increments, force, change, residuals = stepper.advance(
                    index, position.value, momentum.value, known, newest, guess
                )
            except StepFailedError as error:
                newton = noted(newton, index, error.residuals)
                failure = f"step {index}, t = {index * problem.step_size:.6g}: {error}"
                break
            newton = noted(newton, index, residuals)
            if damped:
                history.push(memory.sample_matrix.T @ increments + offset)
                forces[index] = force
            samples[index] = position.value - problem.position + inner @ increments
            if keep_increments:
                kept[index] = increments
            position.add(increments[-1])
            momentum.add(change)
            positions[index + 1], momenta[index + 1] = position.value, momentum.value
            done = index + 1
            if not (np.isfinite(position.value).all() and np.isfinite(momentum.value).all()):
                failure = (
                    f"not finite after step {index}, t = {(index + 1) * problem.step_size:.6g}"
                )
                break
            offset = memory.offset + memory.carry_matrix.T @ increments
            guess = tables.extrapolation @ increments
            if np.abs(position.value).max() > problem.stop_beyond:
                break
        if damped and done == n_steps:
            forces[done] = stepper.newest_force(_known(problem, history, done), offset)
    return Stepped(
        position=positions[: done + 1],
        momentum=momenta[: done + 1],
        samples=samples[:done],
        end_force=forces[: done + 1],
        operations=history.operations,
        newton=newton,
        failure=failure,
        increments=kept[:done] if keep_increments else None,
    )


def _known(problem: StepProblem, history: History, index: int) -> Array:
    known = history.known()
    if problem.memory.known_force is not None:
        known = known + problem.memory.known_force[index]
    return known
