r"""Steps of a Lagrangian whose mass matrix is not constant.

With the points :math:`X_i = x_d(c_i h; k)` and velocities :math:`V_i = x_d'(c_i h; k)` of step k
the discrete Euler-Lagrange equations in momentum form (Hariz Belgacem, Jimenez, Ober-Bloebaum,
arXiv 2403.18362, section "Higher order approximations of the action", with the fractional action
sampled at :math:`\chi_i` with weights :math:`\beta_i`) are, for rows :math:`\nu = 0..s-1`,

.. math:: \sum_i b_i \bigl[l_\nu'(c_i)\, \partial_v L(X_i, V_i, t_i)
          + h\, l_\nu(c_i)\, \partial_q L(X_i, V_i, t_i)\bigr]
          + g_{k\nu} - h \sum_i \beta_i l_\nu(\chi_i) F_{i,k} + p_k \delta_{\nu 0} = 0

and, because the basis sums to one,

.. math:: p_{k+1} = p_k + h \sum_i b_i\, \partial_q L + \sum_\nu g_{k\nu}
          - h \sum_i \beta_i F_{i,k}.

"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.integrator.equal_steps.problem import StepFailedError, StepProblem

Array = NDArray[np.float64]

NEWTON_TOLERANCE = 1e-13
NEWTON_LIMIT = 50
ROUND_OFF = 1e-13


@dataclass(frozen=True, kw_only=True, eq=False)
class _Forces:
    """What L gives on the points of a step."""

    rows: Array
    change: Array
    jacobian: Array


class GeneralStepper:
    """Tables of one step; `advance` solves its equations by Newton's iteration."""

    def __init__(self, problem: StepProblem, lagrangian: Lagrangian) -> None:
        self._problem, self._lagrangian = problem, lagrangian
        tables, memory, h = problem.tables, problem.memory, problem.step_size
        d = lagrangian.dimension
        self._shape = (tables.degree, d)
        self._positions = tables.basis[1:].T
        self._velocities = tables.slopes[1:].T / h
        self._values = h * tables.weights * tables.basis
        self._rates = tables.weights * tables.slopes
        # weights of the second derivatives between row nu and unknown mu, by point
        test, rate = self._values[:-1].T, self._rates[:-1].T
        self._by_mass = np.einsum("in,im->inm", rate, self._velocities)
        self._by_mixed = np.einsum("in,im->inm", rate, self._positions)
        self._by_transposed = np.einsum("in,im->inm", test, self._velocities)
        self._by_stiffness = np.einsum("in,im->inm", test, self._positions)
        damping = np.zeros((tables.degree * d, tables.degree * d))
        for channel in memory.channels:
            response = channel.newest(memory.sample_matrix.T)
            damping += h * np.kron(memory.force_weights[:-1] @ response, channel.direction.T)
        self._damping = damping

    @property
    def first_guess(self) -> Array:
        """Increments of uniform motion from the start values, shape ``(s, d)``."""
        return self._uniform(self._problem.scene.initial_velocity)

    def free_motion(self, index: int, position: Array, momentum: Array) -> Array:
        """Increments with the velocity that belongs to `momentum`, shape ``(s, d)``."""
        time = index * self._problem.step_size
        with np.errstate(all="ignore"):
            velocity = self._lagrangian.velocity(position, momentum, time)
        return self._uniform(np.where(np.isfinite(velocity), velocity, 0.0))

    def _uniform(self, velocity: Array) -> Array:
        h = self._problem.step_size
        return np.outer(h * self._problem.tables.control_points[1:], velocity)

    def damping_force(self, known: Array, offset: Array, increments: Array) -> Array:
        """F of a step: finished history, plus the newest weight times the newest sample."""
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
        h, weights = problem.step_size, problem.memory.force_weights
        force = self.damping_force(known, offset, np.zeros(self._shape))
        right = h * weights[:-1] @ force
        right[0] -= momentum
        change = np.zeros(self._shape[1])
        if problem.moments is not None:
            right -= problem.moments[index, :-1]
            change = change + problem.moments[index].sum(axis=0)
        with np.errstate(all="ignore"):
            increments, forces, residuals = self._newton(index, position, right, guess)
        force = self.damping_force(known, offset, increments)
        change = change - h * problem.memory.momentum_weights @ force
        return increments, force, change + forces.change, residuals

    def _newton(
        self, index: int, base: Array, right: Array, guess: Array
    ) -> tuple[Array, _Forces, tuple[float, ...]]:
        """Solve rows(delta) - damping delta = right with the exact Jacobian."""
        increments = guess.copy()
        residuals: list[float] = []
        previous = math.inf
        reach = float(np.abs(base).max())
        for _ in range(NEWTON_LIMIT):
            forces = self._forces(index, base, increments)
            residual = forces.rows - right
            residual -= (self._damping @ increments.ravel()).reshape(self._shape)
            jacobian = forces.jacobian - self._damping
            residuals.append(float(np.abs(residual).max()))
            if not (math.isfinite(residuals[-1]) and np.isfinite(jacobian).all()):
                raise StepFailedError(
                    "the Lagrangian or a derivative of it is not finite near "
                    f"q = {_shown(base + increments[-1])}",
                    tuple(residuals),
                )
            try:
                update = np.linalg.solve(jacobian, residual.ravel()).reshape(self._shape)
            except np.linalg.LinAlgError:
                break
            increments -= update
            size = float(np.abs(update).max())
            scale = float(np.abs(increments).max())
            stalled = size >= 0.5 * previous and size <= max(1e-9 * scale, ROUND_OFF * reach)
            if size <= NEWTON_TOLERANCE * scale or stalled or size == 0:
                # the momentum must belong to the increments that are kept
                return increments, self._forces(index, base, increments), tuple(residuals)
            previous = size
        raise StepFailedError(
            f"Newton's iteration did not converge in {len(residuals)} iterations "
            f"(residuals {residuals[0]:.1e} .. {residuals[-1]:.1e}); take a smaller step, or see "
            f"whether the mass matrix is singular near q = {_shown(base)}",
            tuple(residuals),
        )

    def _forces(self, index: int, base: Array, increments: Array) -> _Forces:
        problem = self._problem
        position = base + self._positions @ increments
        velocity = self._velocities @ increments
        time = (index + problem.tables.points) * problem.step_size
        at = self._lagrangian.derivatives(position, velocity, time)
        jacobian = np.einsum("inm,iab->namb", self._by_mass, at.mass)
        jacobian += np.einsum("inm,iab->namb", self._by_mixed, at.mixed)
        jacobian += np.einsum("inm,iba->namb", self._by_transposed, at.mixed)
        jacobian += np.einsum("inm,iab->namb", self._by_stiffness, at.stiffness)
        size = self._shape[0] * self._shape[1]
        return _Forces(
            rows=self._rates[:-1] @ at.momentum + self._values[:-1] @ at.force,
            change=self._values.sum(axis=0) @ at.force,
            jacobian=jacobian.reshape(size, size),
        )


def _shown(position: Array) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in position) + "]"
