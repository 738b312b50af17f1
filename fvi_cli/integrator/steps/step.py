r"""One step of a Galerkin variational integrator on any mesh.

The trajectory on a step is :math:`x(t_n + \tau h) = q_n + h \sum_{\nu=1}^{s} l_\nu(\tau) U_\nu`;
the unknowns U have the unit of a velocity, so that nothing is lost to round-off when h is small.
With P and Q of :mod:`~fvi_cli.integrator.steps.dynamics` at the quadrature points
:math:`(c_i, b_i)`, load vectors :math:`g_\nu = h \int l_\nu f` and damping forces
:math:`F_i`, the discrete Euler-Lagrange equations in momentum form are, for
:math:`\nu = 0 .. s - 1`,

.. math:: \sum_i b_i \bigl[l_\nu'(c_i) P_i + h\, l_\nu(c_i) (Q_i - F_i)\bigr]
          + g_\nu + p_n \delta_{\nu 0} = 0,

and, because the basis sums to one,
:math:`q_{n+1} = q_n + h U_s`, :math:`p_{n+1} = p_n + \sum_\nu g_\nu + h \sum_i b_i (Q_i - F_i)`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, dense, form, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.convolution.damping import Damping, DampingTables, no_damping
from fvi_cli.integrator.engine.algebra import kronecker, solver_of
from fvi_cli.integrator.failure import StepFailedError
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.dynamics import General, Separable
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import NOISE, UNIT, Mask, judge

QUADRATIC_TOLERANCE = 1e-15
"""Part of the unknowns that Newton's next update may have: then the residual decides."""
NEWTON_LIMIT = 40
NEWTON_HALVINGS = 20
"""Updates into places without forces are halved at most so often."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StepResult:
    """What solving a step gave.

    Parameters
    ----------
    unknowns
        U, shape ``(s, d)``, in the unit of a velocity.
    velocity
        At the quadrature points, shape ``(r, d)``.
    driving
        What drives the damping force, shape ``(inputs, d)``.
    damping_force
        F where it is sampled, shape ``(m, d)``.
    momentum_change
        p_{n+1} - p_n, shape ``(d,)``.
    residuals
        Sizes of Newton's residuals, in the unit of a momentum; empty for linear scenes.
    """

    unknowns: Array
    velocity: Array
    driving: Array
    damping_force: Array
    momentum_change: Array
    residuals: tuple[float, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceSampling:
    """Where the damping force of a step acts, and what drives it.

    Parameters
    ----------
    to_loads
        Weights of the force in the load vectors, shape ``(s + 1, m)``.
    weights
        The same in the change of the momentum, shape ``(m,)``.
    driving
        From U to what drives the force, shape ``(inputs, s)``.
    at_stages
        Whether it acts at the quadrature points, driven by the velocities there.
    """

    to_loads: Array
    weights: Array
    driving: Array
    at_stages: bool = False

    @property
    def test(self) -> Array:
        """Weights of the force in the equations, shape ``(s, m)``."""
        return self.to_loads[:-1]


def sampling_of(method: Method, tables: StepTables) -> ForceSampling:
    """At the quadrature points; for backward differences at their samples, driven by U."""
    if method.is_runge_kutta:
        return ForceSampling(
            to_loads=tables.test_weights,
            weights=tables.weights,
            driving=np.ascontiguousarray(tables.slopes[1:].T),
            at_stages=True,
        )
    return ForceSampling(
        to_loads=tables.sample_test_weights,
        weights=tables.sample_test_weights.sum(axis=0),
        driving=np.eye(tables.degree),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class StepMatrices:
    """Matrices of one step size.

    Parameters
    ----------
    step_size
        h.
    damping
        Local blocks and responses of the states.
    constant
        Derivative of the equations by U as far as it does not change: mass of linear parts and
        the local damping, shape ``(s d, s d)``; None for linear scenes.
    solve
        What solves the equations of linear scenes; None for others.
    """

    step_size: float
    damping: DampingTables
    constant: Array | None
    solve: Solve | None


class StepSolver:
    """Solves steps of one scene by one method.

    Parameters
    ----------
    dynamics
        The conservative part.
    damping
        Fractional damping; None: there is none.
    tables
        Numbers of the method.
    sampling
        Where the damping force acts.
    """

    def __init__(
        self,
        dynamics: Separable | General,
        damping: Damping | None,
        tables: StepTables,
        sampling: ForceSampling,
    ) -> None:
        self.dynamics, self.damping, self.tables = dynamics, damping, tables
        self._shape = (tables.degree, dynamics.dimension)
        self._size = tables.degree * dynamics.dimension
        self.to_velocity = np.ascontiguousarray(tables.slopes[1:].T)
        self._to_position = np.ascontiguousarray(tables.basis[1:].T)
        self._rate_test = tables.weights * tables.slopes[:-1]
        self._test = np.ascontiguousarray(tables.test_weights[:-1])
        self.sampling = sampling
        self._test_sum = self._test.sum(axis=1)[:, None]
        self._separable = dynamics if isinstance(dynamics, Separable) else None
        self._mass: Form = np.zeros((0, 0))
        self._stiffness: Form | None = None
        if self._separable is not None:
            self._mass = form(self._separable.inertia.form)
            potential = self._separable.potential
            if isinstance(potential, QuadraticPotential):
                self._stiffness = form(potential.form)
        rate, test = self._rate_test.T, self._test.T
        velocity, position = self.to_velocity, self._to_position
        self._by_mass = np.einsum("in,im->inm", rate, velocity)
        self._by_mixed = np.einsum("in,im->inm", rate, position)
        self._by_transposed = np.einsum("in,im->inm", test, velocity)
        self._by_stiffness = np.einsum("in,im->inm", test, position)

    def velocity_of(self, driving: Array) -> Array:
        """Velocities at the quadrature points of steps from what drove their damping force."""
        return driving if self.sampling.at_stages else np.asarray(self.to_velocity @ driving)

    def matrices(self, step_size: float) -> StepMatrices:
        """Matrices of steps of this size.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the equations of a linear step have no unique solution.
        """
        h, d = step_size, self._shape[1]
        if self.damping is None:
            damping = no_damping(self.sampling.weights.size, d)
            directions: tuple[Form, ...] = ()
        else:
            damping = self.damping.tables(h)
            directions = tuple(one.matrix for one in self.damping.directions)
        parts: list[tuple[Array, Form]] = []
        if self._separable is not None:
            parts.append((self.tables.mass_matrix, self._mass))
        if self._stiffness is not None:
            parts.append((-(h**2) * (self._test @ self._to_position), self._stiffness))
        for local, direction in zip(damping.local, directions, strict=True):
            acting = self.sampling.test @ local @ self.sampling.driving
            parts.append((-h * acting, direction))
        if self.dynamics.is_linear:
            return StepMatrices(step_size=h, damping=damping, constant=None, solve=solver_of(parts))
        constant = np.zeros((self._size, self._size))
        for small, large in parts:
            constant += kronecker(small, dense(large))
        return StepMatrices(step_size=h, damping=damping, constant=constant, solve=None)

    def solve(
        self,
        at: StepMatrices,
        time: float,
        position: Array,
        momentum: Array,
        states: Array,
        loads: Array | None,
        guess: Array | None,
        *,
        past: Array | None = None,
    ) -> StepResult:
        """Solve the step from `time` on.

        Parameters
        ----------
        at
            Matrices of its step size.
        time, position, momentum, states
            Where it begins.
        loads
            Load vectors g of the known force, shape ``(s + 1, d)``; None: no such force.
        guess
            First guess of U for nonlinear scenes, shape ``(s, d)``.
        past
            Force of the past at the stages, shape ``(m, d)``; None: that of the states.

        Raises
        ------
        StepFailedError
            If Newton's iteration does not converge, or meets numbers that are not finite.
        """
        h, damping = at.step_size, self.damping
        right = np.zeros(self._shape)
        history: Array | None = None
        if damping is not None:
            history = damping.history_force(at.damping, states) if past is None else past
            history = history + at.damping.constant_force
            right += h * self.sampling.test @ history
        right[0] -= momentum
        if loads is not None:
            right -= loads[:-1]
        residuals: tuple[float, ...] = ()
        pulls: Array | None = None
        if at.solve is not None:
            if self._stiffness is not None:
                right += h * self._test_sum * times(position, self._stiffness)
            unknowns = at.solve(right.ravel()).reshape(self._shape)
        else:
            with np.errstate(all="ignore"):
                unknowns, pulls, residuals = self._newton(at, time, position, right, guess)
        velocity = driving = self.to_velocity @ unknowns
        change = np.zeros(self._shape[1])
        force = np.zeros_like(velocity)
        if damping is not None and history is not None:
            if not self.sampling.at_stages:
                driving = self.sampling.driving @ unknowns
            force = history + damping.local_force(at.damping, driving)
            change -= h * self.sampling.weights @ force
        if self._stiffness is not None:
            pulls = -times(position + h * (self._to_position @ unknowns), self._stiffness)
        if pulls is not None:
            change += h * self.tables.weights @ pulls
        if loads is not None:
            change += loads.sum(axis=0)
        return StepResult(
            unknowns=unknowns,
            velocity=velocity,
            driving=driving,
            damping_force=force,
            momentum_change=change,
            residuals=residuals,
        )

    def _equations(
        self, constant: Array, unknowns: Array, points: Array, times: Array, h: float, right: Array
    ) -> tuple[Array, Array]:
        """Residual of the equations and forces at the points, with first derivatives only."""
        residual = (constant @ unknowns.ravel()).reshape(self._shape) - right
        if self._separable is not None and self._separable.potential is not None:
            force = -self._separable.potential.gradient(points)
        else:
            momentum, force = self.dynamics.forces(points, self.to_velocity @ unknowns, times)
            residual += self._rate_test @ momentum
        return residual + h * self._test @ force, force

    def _jacobian(
        self, constant: Array, unknowns: Array, points: Array, times: Array, h: float
    ) -> Array:
        """Derivative of the equations by the unknowns, shape ``(s d, s d)``."""
        if self._separable is not None and self._separable.potential is not None:
            full = np.einsum(
                "inm,iab->namb", self._by_stiffness, self._separable.potential.hessian(points)
            )
            full *= -(h**2)
        else:
            found = self.dynamics.derivatives(points, self.to_velocity @ unknowns, times)
            full = np.einsum("inm,iab->namb", self._by_mass, found.mass)
            full += h * np.einsum("inm,iab->namb", self._by_mixed, found.mixed)
            full += h * np.einsum("inm,iba->namb", self._by_transposed, found.mixed)
            full += h**2 * np.einsum("inm,iab->namb", self._by_stiffness, found.stiffness)
        return np.asarray(constant + full.reshape(self._size, self._size))

    def _newton(
        self, at: StepMatrices, time: float, position: Array, right: Array, guess: Array | None
    ) -> tuple[Array, Array, tuple[float, ...]]:
        """Solve the equations with their exact Jacobian: unknowns, forces and residuals.

        An update after which the next one is expected to be round-off ends the iteration if the
        residual behind it calls for no more than that.
        """
        h, constant = at.step_size, at.constant
        if constant is None:
            raise ValueError("matrices: those of a linear scene")
        unknowns = np.zeros(self._shape) if guess is None else guess.copy()
        times = time + h * self.tables.points
        origin = np.abs(position) / h
        residuals: list[float] = []
        jacobian: Array = constant
        update: Array = np.zeros(self._shape)
        previous = np.full(self._shape[1], np.nan)
        expects_end, halvings = False, 0

        def floor(_: Mask) -> Array:
            try:
                inverse = np.abs(np.linalg.inv(jacobian))
            except np.linalg.LinAlgError:
                return np.zeros(self._shape[1])
            # rounded positions and velocities, through the second derivatives
            rough = np.abs(jacobian - constant) @ (np.abs(unknowns) + origin).ravel()
            rough += np.abs(constant) @ np.abs(unknowns).ravel() + np.abs(right).ravel()
            rough += (h * np.abs(self._test) @ np.abs(force)).ravel()
            noise = (inverse @ rough).reshape(self._shape) + np.abs(unknowns)
            return np.asarray(UNIT * (noise.max(axis=0) + origin))

        while len(residuals) < NEWTON_LIMIT:
            points = position + h * (self._to_position @ unknowns)
            residual, force = self._equations(constant, unknowns, points, times, h, right)
            size = float(np.abs(residual).max())
            scale = np.abs(unknowns).max(axis=0) + origin
            if expects_end and math.isfinite(size):
                left = np.linalg.solve(jacobian, residual.ravel()).reshape(self._shape)
                change = np.abs(left).max(axis=0)
                if judge(change, change, scale, floor, power=0, tolerance=NOISE * UNIT)[0].all():
                    return unknowns, force, tuple(residuals)
            fresh = self._jacobian(constant, unknowns, points, times, h)
            if not (math.isfinite(size) and np.isfinite(fresh).all()):
                halvings += 1
                if not update.any() or halvings > NEWTON_HALVINGS:
                    raise StepFailedError(
                        "the force is not finite (no real number, or a division by zero) near "
                        f"q = {_shown(points[-1])}; take a smaller step if the motion itself "
                        "stays away from there",
                        (*residuals, size),
                    )
                update = 0.5 * update
                unknowns += update
                previous, expects_end = np.full(self._shape[1], np.nan), False
                continue
            jacobian = fresh
            residuals.append(size)
            try:
                update = np.asarray(np.linalg.solve(jacobian, residual.ravel())).reshape(
                    self._shape
                )
            except np.linalg.LinAlgError:
                break
            unknowns -= update
            change, scale = np.abs(update).max(axis=0), np.abs(unknowns).max(axis=0) + origin
            known = judge(
                change, previous, scale, floor, power=2, tolerance=QUADRATIC_TOLERANCE, slow=0.5
            )
            expects_end = bool(known[0].all())
            previous = change
        raise StepFailedError(
            f"Newton's iteration did not converge in {len(residuals)} iterations "
            f"(residuals {residuals[0]:.1e} .. {residuals[-1]:.1e}); take a smaller step, or see "
            f"whether the mass matrix is singular near q = {_shown(position)}",
            tuple(residuals),
        )


def _shown(position: Array) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in position) + "]"
