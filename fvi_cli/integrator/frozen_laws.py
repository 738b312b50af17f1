"""What nonlinear scenes are beyond a linear one that stands for them, at the points of the rule."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.potential import Potential
from fvi_cli.integrator.known_motion import KnownMotion
from fvi_cli.integrator.stepping import StepProblem

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockInputs:
    """What goes into a block of n steps.

    Parameters
    ----------
    known
        Force of older samples on each step, shape ``(n, m d)``.
    state
        Position, momentum, carry and the number 1.
    moments
        Moments of known forces, shape ``(n, s + 1, d)``.
    remainder
        Guess of what is left of the forces, the same at all points, shape ``(1, w)``.
    first
        Number of the first step.
    shift
        Known part of the position at the quadrature points, ``(n, r, d)``; None: zero.
    motion
        The same for a general Lagrangian.
    """

    known: Array
    state: Array
    moments: Array
    remainder: Array
    first: int
    shift: Array | None = None
    motion: KnownMotion | None = None


class FrozenLaw(Protocol):
    """A linear scene, and what is left of the forces of a nonlinear one.

    Attributes
    ----------
    matrices
        What is constant, as it is kept in a checkpoint.
    mass, stiffness
        Of the linear scene, shape ``(d, d)``.
    has_rates
        Whether what is left depends on velocities as well.
    to_moments
        From what is left at the r points of a step, w numbers at each, to moments, shape
        ``((s + 1) d, r w)``.
    """

    matrices: Array
    mass: Array
    stiffness: Array
    has_rates: bool
    to_moments: Array

    def remainder(self, inputs: BlockInputs, points: Array, previous: Array) -> Array:
        """What is left, shape ``(n, r, w)``.

        Parameters
        ----------
        inputs
            The block.
        points
            Positions relative to the start of the block, with `has_rates` followed by h times the
            velocities, shape ``(n, r, w)``.
        previous
            What was left before, of which the `points` came.
        """


class PotentialLaw:
    r"""What is left of the force of a potential, :math:`\nabla V(X) - K X`.

    Parameters
    ----------
    problem, potential
        The steps and what makes them nonlinear.
    stiffness
        K, shape ``(d, d)``.
    """

    has_rates = False

    def __init__(self, problem: StepProblem, potential: Potential, stiffness: Array) -> None:
        self._potential = potential
        self.matrices = self.stiffness = stiffness
        self.mass = problem.scene.inertia.mass
        unit = np.eye(problem.scene.dimension)
        by_value = np.kron(problem.tables.test_weights, unit)
        self.to_moments: Array = np.asarray(-problem.step_size * by_value)

    def remainder(self, inputs: BlockInputs, points: Array, previous: Array) -> Array:
        """See :class:`FrozenLaw`."""
        position = inputs.state[: self.mass.shape[0]] + points
        known = inputs.shift
        true = self._potential.gradient(position if known is None else position + known)
        return np.asarray(true - position @ self.stiffness)


class LagrangianLaw:
    r"""What is left of a Lagrangian: :math:`\partial_v L - M V` and :math:`\partial_q L + K X`.

    The momentum P of the linear scene at a point comes of integrals of forces. The velocity that
    belongs to it, and not the one of the linear scene, makes what is left: so each iteration
    depends on the one before through integrals only and contracts, however M changes in a block.

    Parameters
    ----------
    problem, lagrangian
        The steps and what makes them nonlinear.
    matrices
        M above K, shape ``(2 d, d)``.
    """

    has_rates = True

    def __init__(self, problem: StepProblem, lagrangian: Lagrangian, matrices: Array) -> None:
        d = lagrangian.dimension
        self._lagrangian, self._h = lagrangian, problem.step_size
        self._offsets = problem.tables.points
        self.matrices = matrices
        self.mass, self.stiffness = matrices[:d], matrices[d:]
        tables, unit = problem.tables, np.eye(d)
        by_rate = tables.weights * tables.slopes
        # the slopes of the basis sum to zero: what is left of momenta makes no momentum
        by_rate[-1] = -by_rate[:-1].sum(axis=0)
        by_value = problem.step_size * tables.test_weights
        parts = np.stack([np.kron(by_rate, unit), np.kron(by_value, unit)])
        self.to_moments = (
            parts.reshape(2, (tables.degree + 1) * d, tables.points.size, d)
            .transpose(1, 2, 0, 3)
            .reshape((tables.degree + 1) * d, -1)
        )

    def remainder(self, inputs: BlockInputs, points: Array, previous: Array) -> Array:
        """See :class:`FrozenLaw`; not finite where a mass matrix is singular."""
        d, known = self._lagrangian.dimension, inputs.motion
        steps = np.arange(inputs.first, inputs.first + points.shape[0], dtype=float)
        position = inputs.state[:d] + points[..., :d]
        velocity = points[..., d:] / self._h
        momentum = velocity @ self.mass + previous[..., :d]
        at = self._lagrangian.derivatives(
            position if known is None else position + known.position,
            velocity if known is None else velocity + known.velocity,
            self._h * (steps[:, None] + self._offsets),
        )
        excess, force = momentum - at.momentum, at.force
        if known is not None:
            excess, force = excess + known.momentum, force - known.force
        try:
            change = np.linalg.solve(at.mass, excess[..., None])[..., 0]
        except np.linalg.LinAlgError:
            return np.full_like(previous, np.nan)
        force = force + np.einsum("...ab,...a->...b", at.mixed, change)
        return np.concatenate(
            [momentum - (velocity + change) @ self.mass, force + position @ self.stiffness], axis=-1
        )


def frozen_law(problem: StepProblem, matrices: Array) -> FrozenLaw:
    """The law of the scene of `problem` with these constant matrices.

    Raises
    ------
    ValueError
        If the scene is linear.
    """
    scene = problem.scene
    if scene.lagrangian is not None:
        return LagrangianLaw(problem, scene.lagrangian, matrices)
    if scene.potential is None:
        raise ValueError("potential: a linear scene needs no iteration")
    return PotentialLaw(problem, scene.potential, matrices)


def frozen_matrices(
    problem: StepProblem,
    position: Array,
    momentum: Array,
    time: float = 0.0,
) -> Array:
    """What is kept constant from a state on, as :class:`FrozenLaw` has it.

    Parameters
    ----------
    problem
        The steps.
    position, momentum, time
        The state, with its known part, shape ``(d,)`` each. The momentum of a potential does not
        matter.

    Returns
    -------
    Array
        Second derivatives there, symmetric; where they are no numbers, those of free motion.
    """
    scene = problem.scene
    if scene.lagrangian is not None:
        mass, stiffness = scene.inertia.mass, np.zeros((scene.dimension, scene.dimension))
        with np.errstate(all="ignore"):
            velocity = scene.lagrangian.velocity(position, momentum, time)
            at = scene.lagrangian.derivatives(position, velocity, time)
        if np.isfinite(at.mass).all() and np.linalg.eigvalsh(at.mass)[0] > 0:
            mass = at.mass
            if np.isfinite(at.stiffness).all():
                stiffness = -at.stiffness
        return np.concatenate([0.5 * (mass + mass.T), 0.5 * (stiffness + stiffness.T)])
    if scene.potential is None:
        raise ValueError("potential: a linear scene needs no iteration")
    stiffness = scene.potential.hessian(position)
    if not np.isfinite(stiffness).all():
        stiffness = np.zeros_like(stiffness)
    return np.asarray(0.5 * (stiffness + stiffness.T))
