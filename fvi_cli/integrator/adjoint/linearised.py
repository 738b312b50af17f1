r"""The discrete equations of a run, linearised along its trajectory, and solved in both directions.

In the notation of :mod:`fvi_cli.integrator.steps.step` a disturbance of the scene changes P by
:math:`\partial P`, Q - F by :math:`\partial Q` and the load vectors by :math:`\partial g`. With
:math:`\delta P = M \delta v + C \delta q`, :math:`\delta Q = C^T \delta v + S \delta q` and the
damping force of :math:`\delta v` itself, every step has the matrix of Newton's last iteration,

.. math:: J\, \delta U + E\, \delta q_n + e_0\, \delta p_n - h \sum_i b_i l_\nu \delta F^{past}_i
          + \sum_i b_i (l_\nu' \partial P_i + h l_\nu \partial Q_i) + \partial g_\nu = 0.

Forwards this gives what a disturbance does to the trajectory, one column for each. Backwards, with
transposed matrices and with the states of the damping run backwards, it gives what *all*
disturbances do to one number: the mirror equation of the restricted Hamilton's principle (Hariz
Belgacem, Jimenez, Ober-Bloebaum, arXiv 2403.18362), on the same mesh.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.memory import RunMemory, TermTables
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import tableau

LARGEST_STEP = 1500
"""Stages times components up to which steps are linearised: matrices of that size are inverted."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """What p changes of a scene do to the equations of a run of n steps; the last axis is p.

    Parameters
    ----------
    momentum, force
        Change of P and of Q - F at the stages with the motion held fixed, ``(n, r, d, p)``.
    damping
        Change of F alone, of the same shape; None: it does not change.
    loads
        Change of the load vectors, ``(n, s + 1, d, p)``; None: they do not change.
    position, velocity, start_momentum
        Change of the initial data, ``(d, p)``.
    """

    momentum: Array
    force: Array
    loads: Array | None
    position: Array
    velocity: Array
    start_momentum: Array
    damping: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """What p disturbances do to a trajectory.

    Parameters
    ----------
    position, momentum
        Changes at the points of the mesh, ``(n + 1, d, p)``.
    unknowns
        Changes of the steps' unknowns U, velocities, ``(n, s, d, p)``.
    """

    position: Array
    momentum: Array
    unknowns: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Cotangent:
    """What one number changes by, for unit disturbances: the parts of :class:`Disturbance`."""

    momentum: Array
    force: Array
    loads: Array
    position: Array
    velocity: Array
    start_momentum: Array
    damping: Array | None = None

    def along(self, change: Disturbance) -> Array:
        """The derivatives of that number, shape ``(p,)``."""
        total = np.einsum("nra,nrap->p", self.momentum, change.momentum)
        total += np.einsum("nra,nrap->p", self.force, change.force)
        if change.loads is not None:
            total += np.einsum("nsa,nsap->p", self.loads, change.loads)
        if self.damping is not None and change.damping is not None:
            total += np.einsum("nra,nrap->p", self.damping, change.damping)
        total += self.position @ change.position + self.velocity @ change.velocity
        return np.asarray(total + self.start_momentum @ change.start_momentum)


@dataclass(frozen=True, kw_only=True, eq=False)
class _StepMatrices:
    """Matrices of steps: of every step, or of every size where all steps of a size are alike.

    Parameters
    ----------
    of_step
        Which of them is a step's, shape ``(n,)``.
    inverse
        Inverse of J, ``(k, s d, s d)``.
    by_position
        E, ``(k, s d, d)``.
    gain_by_unknowns, gain_by_position
        What the conservative forces and the local damping add to the momentum,
        ``(k, d, s d)`` and ``(k, d, d)``.
    """

    of_step: NDArray[np.intp]
    inverse: Array
    by_position: Array
    gain_by_unknowns: Array
    gain_by_position: Array


class LinearisedRun:
    """A finished run of a Runge-Kutta method, ready for tangents and adjoints.

    Parameters
    ----------
    scene, method
        What was integrated and how.
    steps
        All steps of the run.

    Attributes
    ----------
    memory
        Its damping.
    step_solves
        Systems of one step solved so far, a matrix with several right-hand sides counted once.

    Raises
    ------
    ValueError
        For steps with too many unknowns, or whose linearised equations have no unique solution.
    """

    def __init__(self, scene: Scene, method: Method, steps: RunSteps) -> None:
        size = steps.tables.degree * scene.dimension
        if size > LARGEST_STEP:
            raise ValueError(
                f"derivatives: {size} unknowns in a step; steps of at most {LARGEST_STEP} are "
                "linearised"
            )
        self.scene, self.steps = scene, steps
        self.dynamics = dynamics_of(scene)
        self._operator = StageOperator(tableau=tableau(method.cq, method.stages))
        self.memory = RunMemory(scene, self._operator, steps.step_size)
        self.step_solves = 0
        sizes, self.of_size = np.unique(steps.step_size, return_inverse=True)
        self.terms = self.memory.tables(sizes)
        tables = steps.tables
        self.to_velocity = np.ascontiguousarray(tables.slopes[1:].T)
        self.to_position = np.ascontiguousarray(tables.basis[1:].T)
        self.rate_test = tables.weights * tables.slopes[:-1]
        self.test = np.ascontiguousarray(tables.test_weights[:-1])
        try:
            self._matrices = self._linearise(sizes)
        except np.linalg.LinAlgError:
            raise ValueError(
                "derivatives: the linearised equations of a step have no unique solution"
            ) from None

    @property
    def velocity(self) -> Array:
        """Stage velocities, ``(n, r, d)``."""
        return self.steps.velocity

    def _linearise(self, sizes: Array) -> _StepMatrices:
        steps, tables = self.steps, self.steps.tables
        is_linear = self.dynamics.is_linear
        chosen = np.unique(self.of_size, return_index=True)[1] if is_linear else slice(None)
        of_step = self.of_size if is_linear else np.arange(steps.n_steps)
        h = steps.step_size[chosen][:, None, None, None, None]
        found = self.dynamics.derivatives(
            steps.stage_position[chosen], steps.velocity[chosen], steps.stage_time[chosen]
        )
        v, q, d = self.to_velocity, self.to_position, self.scene.dimension
        size, b = tables.degree * d, tables.weights
        rate, test = self.rate_test, self.test
        # matrices of P and Q by q and v, times test functions, times the way to U
        total = _assembled(rate, v, found.mass)
        total = total + h**2 * _assembled(test, q, found.stiffness)
        h3, only = h[..., 0], b[None]
        gain = h3**2 * _assembled(only, q, found.stiffness)[:, 0]
        if not is_linear:
            turned = found.mixed.swapaxes(-1, -2)
            total += h * (_assembled(rate, q, found.mixed) + _assembled(test, v, turned))
            gain += h3 * _assembled(only, v, turned)[:, 0]
        by_position = np.einsum("ni,xiab->xnab", rate, found.mixed)
        by_position = by_position + h3 * np.einsum("ni,xiab->xnab", test, found.stiffness)
        own = np.einsum("i,xiab->xab", b, found.stiffness) * h[:, 0, 0]
        if self.memory.n_terms:
            local = np.array([one.local for one in self.terms])[self.of_size[chosen]]
            damped = np.tensordot(local @ v, self.memory.matrices, axes=(1, 0))
            total -= h * np.einsum("ni,ximab->xnamb", test, damped)
            gain -= h3 * np.einsum("i,ximab->xamb", b, damped)
        return _StepMatrices(
            of_step=of_step,
            inverse=np.asarray(np.linalg.inv(total.reshape(-1, size, size)), dtype=float),
            by_position=by_position.reshape(-1, size, d),
            gain_by_unknowns=gain.reshape(-1, d, size),
            gain_by_position=own,
        )

    def tangent(self, change: Disturbance) -> Tangent:
        """What disturbances do to the trajectory."""
        steps, memory, matrices = self.steps, self.memory, self._matrices
        n, s, d = steps.n_steps, steps.tables.degree, self.scene.dimension
        p, b = change.position.shape[-1], steps.tables.weights
        sizes = steps.step_size[:, None, None, None]
        right = np.einsum("ni,xiap->xnap", self.rate_test, change.momentum)
        right += sizes * np.einsum("ni,xiap->xnap", self.test, change.force)
        gains = sizes[:, 0] * np.einsum("i,xiap->xap", b, change.force)
        if change.loads is not None:
            right += change.loads[:, :-1]
            gains += change.loads.sum(axis=1)
        position, momentum = change.position.copy(), change.start_momentum.copy()
        states = memory.first_states(change.velocity).reshape(memory.n_terms, memory.n_rates, d * p)
        carried = np.where(memory.is_relative[:, None], change.velocity.reshape(1, -1), 0.0)
        positions, momenta = np.empty((2, n + 1, d, p))
        unknowns = np.empty((n, s, d, p))
        positions[0], momenta[0] = position, momentum
        for index in range(n):
            h, which = steps.step_size[index], matrices.of_step[index]
            load, gain = right[index], gains[index]
            terms = self.terms[self.of_size[index]]
            if memory.n_terms:
                past = self._past(terms, states, carried).reshape(memory.n_terms, b.size, d, p)
                force = np.einsum("kiap,kab->ibp", past, memory.matrices)
                load = load - h * np.tensordot(self.test, force, axes=1)
                gain = gain - h * np.tensordot(b, force, axes=1)
            load = load.reshape(s * d, p) + matrices.by_position[which] @ position
            load[:d] += momentum
            own = -(matrices.inverse[which] @ load)
            momentum = momentum + gain + matrices.gain_by_unknowns[which] @ own
            momentum += matrices.gain_by_position[which] @ position
            shaped = own.reshape(s, d, p)
            position = position + h * shaped[-1]
            if memory.n_terms:
                velocity = self.to_velocity @ own.reshape(s, d * p)
                states = terms.decay[:, None] * states + terms.intake @ velocity
            positions[index + 1], momenta[index + 1], unknowns[index] = position, momentum, shaped
        self.step_solves += n
        return Tangent(position=positions, momentum=momenta, unknowns=unknowns)

    @staticmethod
    def _past(terms: TermTables, states: Array, carried: Array) -> Array:
        """Force of the past of every term without its matrix, ``(K, m, d p)``."""
        past = terms.response @ states
        left = terms.local.sum(axis=2) + terms.response.sum(axis=2)
        return np.asarray(past - left[:, :, None] * carried[:, None, :])

    def adjoint(self, position: Array, unknowns: Array, damping: Array | None = None) -> Cotangent:
        """What disturbances of all kinds do to one number.

        Parameters
        ----------
        position, unknowns
            Derivatives of that number by the positions at the points of the mesh,
            ``(n + 1, d)``, and by the steps' unknowns, ``(n, s, d)``.
        damping
            Its derivatives by the force F of all damping at the stages, ``(n, r, d)``; None: it
            does not depend on it.
        """
        steps, memory, matrices = self.steps, self.memory, self._matrices
        n, s, d = steps.n_steps, steps.tables.degree, self.scene.dimension
        b, r = steps.tables.weights, steps.tables.points.size
        momenta, forces = np.empty((n, r, d)), np.empty((n, r, d))
        loads = np.empty((n, s + 1, d))
        by_position, by_momentum, by_velocity = position[n].copy(), np.zeros(d), np.zeros(d)
        states = np.zeros((memory.n_terms, memory.n_rates, d))
        for index in range(n - 1, -1, -1):
            h, which = steps.step_size[index], matrices.of_step[index]
            terms = self.terms[self.of_size[index]]
            own = unknowns[index].copy()
            own[-1] += h * by_position
            if memory.n_terms:
                pulled = terms.intake.T @ states.sum(axis=0)
                drawn = np.zeros(())
                if damping is not None:
                    drawn = np.einsum("ib,kab->kia", damping[index], memory.matrices)
                    pulled += np.einsum("kij,kia->ja", terms.local, drawn)
                own += self.to_velocity.T @ pulled
            flat = own.ravel() + by_momentum @ matrices.gain_by_unknowns[which]
            multiplier = -(flat @ matrices.inverse[which])
            by_position = by_position + position[index]
            by_position += by_momentum @ matrices.gain_by_position[which]
            by_position += multiplier @ matrices.by_position[which]
            shaped = multiplier.reshape(s, d)
            force = h * (self.test.T @ shaped + b[:, None] * by_momentum)
            momenta[index], forces[index] = self.rate_test.T @ shaped, force
            loads[index, :-1], loads[index, -1] = shaped + by_momentum, by_momentum
            by_momentum = by_momentum + shaped[0]
            if memory.n_terms:
                past = drawn - np.einsum("ib,kab->kia", force, memory.matrices)
                states = terms.decay[:, None] * states
                states += terms.response.transpose(0, 2, 1) @ past
                left = terms.local.sum(axis=2) + terms.response.sum(axis=2)
                kept = np.einsum("ki,kia->ka", left, past)
                by_velocity = by_velocity - kept[memory.is_relative].sum(axis=0)
        by_velocity = by_velocity + states[memory.is_relative].sum(axis=(0, 1))
        self.step_solves += n
        return Cotangent(
            momentum=momenta,
            force=forces,
            loads=loads,
            position=by_position,
            velocity=by_velocity,
            start_momentum=by_momentum,
            damping=damping,
        )

    @cached_property
    def damping_forces(self) -> tuple[Array, Array]:
        """As :meth:`RunMemory.forces` of the scene that was run."""
        start = self.scene.initial_velocity
        return self.memory.forces(self.terms, self.of_size.tolist(), self.velocity, start)

    @property
    def damping_force(self) -> Array:
        """Force F of all damping at the stages, ``(n, r, d)``."""
        found = np.einsum("knia,kab->nib", self.damping_forces[0], self.memory.matrices)
        return np.asarray(found)

    def damping_changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """What disturbances do to the force F of all damping at the stages, ``(n, r, d, p)``."""
        d, p = change.velocity.shape
        velocity = np.einsum("rs,nsdp->nrdp", self.to_velocity, tangent.unknowns)
        plain, _ = self.memory.forces(
            self.terms,
            self.of_size.tolist(),
            velocity.reshape(*velocity.shape[:2], d * p),
            change.velocity.ravel(),
        )
        shaped = plain.reshape(*plain.shape[:3], d, p)
        found = np.einsum("kniap,kab->nibp", shaped, self.memory.matrices)
        return np.asarray(found if change.damping is None else found + change.damping)

    def law_forces(self, scene: Scene) -> Array:
        """Forces of the relaxation laws of another scene on the motion of this run."""
        memory = RunMemory(replace(scene, damping=()), self._operator, self.steps.step_size)
        tables = memory.tables(np.unique(self.steps.step_size))
        start = scene.initial_velocity
        plain, _ = memory.forces(tables, self.of_size.tolist(), self.velocity, start)
        return np.asarray(np.einsum("knia,kab->nib", plain, memory.matrices))


def _assembled(left: Array, right: Array, matrices: Array) -> Array:
    """Sums over i of left_ni right_im matrix_xiab, shape ``(x, n, d, m, d)``."""
    n, m, (x, r, d, _) = left.shape[0], right.shape[1], matrices.shape
    weights = (left[:, None, :] * right.T).reshape(n * m, r)
    found = weights @ np.reshape(matrices, (x, r, d * d))
    return np.asarray(found.reshape(x, n, m, d, d).transpose(0, 1, 3, 2, 4))
