r"""One step after the other: the discrete Euler-Lagrange equations in momentum form.

For the increments :math:`\delta^1..\delta^s` of step k (Hariz Belgacem, Jimenez, Ober-Bloebaum,
arXiv 2403.18362, section "Higher order approximations of the action", with the fractional action
sampled at :math:`\chi_i` with weights :math:`\beta_i`), rows :math:`\nu = 0..s-1`:

.. math:: \frac1h \sum_{i,\mu} b_i l_\nu' l_\mu' M \delta^\mu - h \sum_i b_i l_\nu \nabla V(X_i)
          + g_{k\nu} - h \sum_i \beta_i l_\nu(\chi_i) F_{i,k} + p_k \delta_{\nu 0} = 0

and, because the basis sums to one, the momentum follows without cancellation:

.. math:: p_{k+1} = p_k - h \sum_i b_i \nabla V(X_i) + \sum_\nu g_{k\nu} - h \sum_i \beta_i F_{i,k}.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.equal_steps.direct_history import DirectHistory
from fvi_cli.integrator.equal_steps.general_stepping import GeneralStepper
from fvi_cli.integrator.equal_steps.problem import (
    History,
    StepFailedError,
    Stepped,
    StepProblem,
    noted,
)
from fvi_cli.integrator.equal_steps.step_solver import StepSolver
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]

NEWTON_TOLERANCE = 1e-12
NEWTON_LIMIT = 50


def step_solver(problem: StepProblem) -> StepSolver:
    """What solves the steps of `problem`."""
    if problem.scene.lagrangian is not None:
        return GeneralStepper(problem, problem.scene.lagrangian)
    return Stepper(problem)


class Stepper:
    """Matrices of one step of a scene with a constant mass matrix."""

    def __init__(self, problem: StepProblem) -> None:
        self._problem = problem
        tables, memory, h = problem.tables, problem.memory, problem.step_size
        d = problem.scene.dimension
        s = tables.degree
        self._shape = (s, d)
        # unknowns ordered (nu, component)
        linear = np.kron(tables.mass_matrix / h, problem.scene.inertia.mass)
        for channel in memory.channels:
            response = channel.newest(memory.sample_matrix.T)
            linear -= h * np.kron(memory.force_weights[:-1] @ response, channel.direction.T)
        self._linear = linear
        self._stiffness: Array | None = None
        self._potential: Potential | None = problem.scene.potential
        self._weighted_basis = np.einsum("ni,mi->inm", tables.test_weights[:-1], tables.basis[1:])
        if isinstance(self._potential, QuadraticPotential):
            self._stiffness = self._potential.stiffness
            linear = linear - h * np.kron(self._weighted_basis.sum(axis=0), self._stiffness)
        self._inverse = np.linalg.inv(linear) if problem.scene.is_linear else None

    @property
    def first_guess(self) -> Array:
        """Increments of free motion from the start values, shape ``(s, d)``."""
        return self.free_motion(0, self._problem.position, self._problem.momentum)

    def free_motion(self, index: int, position: Array, momentum: Array) -> Array:
        """Increments with the velocity that belongs to `momentum`, shape ``(s, d)``."""
        velocity = np.linalg.solve(self._problem.scene.inertia.mass, momentum)
        return self._problem.step_size * np.outer(self._problem.tables.control_points[1:], velocity)

    def damping_force(self, known: Array, offset: Array, increments: Array) -> Array:
        """As :class:`~fvi_cli.integrator.equal_steps.step_solver.StepSolver` has it."""
        force = known
        sample = self._problem.memory.sample_matrix.T @ increments + offset
        for channel in self._problem.memory.channels:
            force = force + channel.newest(sample) @ channel.direction
        return force

    def advance(
        self,
        index: int,
        position: Array,
        momentum: Array,
        known: Array,
        offset: Array,
        guess: Array,
    ) -> tuple[Array, Array, Array, tuple[float, ...]]:
        """Solve step `index`, as a `StepSolver` does."""
        problem = self._problem
        tables, h = problem.tables, problem.step_size
        moments = None if problem.moments is None else problem.moments[index]
        force = self.damping_force(known, offset, np.zeros(self._shape))
        right = h * problem.memory.force_weights[:-1] @ force
        right[0] -= momentum
        if moments is not None:
            right -= moments[:-1]
        residuals: tuple[float, ...] = ()
        if self._inverse is not None:
            if self._stiffness is not None:
                pull = np.broadcast_to(
                    position @ self._stiffness, (tables.points.size, self._shape[1])
                )
                right += h * tables.test_weights[:-1] @ pull
            increments = (self._inverse @ right.ravel()).reshape(self._shape)
        else:
            increments, residuals = self._newton(position, right, guess)
        force = self.damping_force(known, offset, increments)
        change = -h * problem.memory.momentum_weights @ force
        if self._potential is not None:
            points = position + tables.basis[1:].T @ increments
            change = change - h * tables.weights @ self._potential.gradient(points)
        if moments is not None:
            change = change + moments.sum(axis=0)
        return increments, force, change, residuals

    def _newton(self, base: Array, right: Array, guess: Array) -> tuple[Array, tuple[float, ...]]:
        """Solve linear(delta) - h sum b l grad V(X) = right with the exact Jacobian."""
        potential, tables, h = self._potential, self._problem.tables, self._problem.step_size
        if potential is None:  # pragma: no cover - linear scenes never come here
            raise ValueError("Newton's iteration needs a potential")
        s, d = self._shape
        increments = guess.copy()
        residuals: list[float] = []
        previous = math.inf
        for _ in range(NEWTON_LIMIT):
            points = base + tables.basis[1:].T @ increments
            gradient = potential.gradient(points)
            residual = (self._linear @ increments.ravel()).reshape(s, d) - right
            residual -= h * tables.test_weights[:-1] @ gradient
            curvature = np.einsum("inm,iab->namb", self._weighted_basis, potential.hessian(points))
            jacobian = self._linear - h * curvature.reshape(s * d, s * d)
            residuals.append(float(np.abs(residual).max()))
            if not math.isfinite(residuals[-1]):
                place = ", ".join(f"{value:.4g}" for value in base)
                raise StepFailedError(
                    "the force of the potential is not finite (no real number, or a division by "
                    f"zero) near q = [{place}]; take a smaller step if the motion itself stays "
                    "away from there",
                    tuple(residuals),
                )
            try:
                update = np.linalg.solve(jacobian, residual.ravel()).reshape(s, d)
            except np.linalg.LinAlgError:
                break
            increments -= update
            size = float(np.abs(update).max())
            scale = float(np.abs(increments).max()) + 1e-300
            stalled = size >= 0.5 * previous and size <= 1e-9 * scale
            if size <= NEWTON_TOLERANCE * scale or stalled or size == 0:
                return increments, tuple(residuals)
            previous = size
        raise StepFailedError(
            f"Newton's iteration did not converge in {len(residuals)} iterations "
            f"(residuals {residuals[0]:.1e} .. {residuals[-1]:.1e}); take a smaller step",
            tuple(residuals),
        )


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
    stepper = step_solver(problem)
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
    guess = stepper.first_guess
    offset = memory.first_offset
    newton = NewtonRecord()
    failure = ""
    done = 0
    damped = bool(memory.channels) or problem.extra_force is not None
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
            forces[done] = _known(problem, history, done)
            forces[done] = stepper.damping_force(forces[done], offset, np.zeros((tables.degree, d)))
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
    if problem.extra_force is not None:
        known = known + problem.extra_force[index]
    return known
