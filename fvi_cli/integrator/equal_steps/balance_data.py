"""What the steps of a scene gave, as their balances need it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.equal_steps.problem import Stepped
from fvi_cli.integrator.equal_steps.weights import Memory
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.mathematics.lagrange import lobatto_basis

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """What the steps of a scene gave, with what is needed to form its balances.

    Parameters
    ----------
    scene, method, tables, memory, step_size
        What was integrated and how.
    stepped
        The steps, with their increments, cut where the trajectory ends.
    moments
        Moments of the known force, shape ``(N, s + 1, d)``; None when there is none.
    forcing_moments
        The part of `moments` that belongs to the forcing of the scene.
    position, momentum, energy
        On the grid, as in the trajectory.
    """

    scene: Scene
    method: Method
    tables: StepTables
    memory: Memory
    step_size: float
    stepped: Stepped
    moments: Array | None
    forcing_moments: Array | None
    position: Array
    momentum: Array
    energy: Array

    @property
    def n_steps(self) -> int:
        """Number of finished steps."""
        return int(self.position.shape[0]) - 1

    @property
    def increments(self) -> Array:
        """Increments of the finished steps, shape ``(n, s, d)``.

        Raises
        ------
        ValueError
            If the steps have not kept them.
        """
        if self.stepped.increments is None:
            raise ValueError("diagnostics: the increments of the steps were not kept")
        return self.stepped.increments[: self.n_steps]

    def damping_moments(self) -> Array:
        """Moments of the damping force, opposite in sign to its action, shape ``(n, s + 1, d)``."""
        n = self.n_steps
        force = self.stepped.end_force[:n]
        total = self.step_size * np.einsum("vm,kmd->kvd", self.memory.force_weights, force)
        if self.moments is not None:
            # what is known of the damping force itself: the jump of Riemann-Liouville at 0
            total = total - self.moments[:n]
            if self.forcing_moments is not None:
                total = total + self.forcing_moments[:n]
        return np.asarray(total)


def control_rates(motion: Motion) -> Array:
    """Velocity of the unknown at the control points, shape ``(n, s + 1, d)``."""
    basis = lobatto_basis(motion.tables.degree)
    slopes = basis.derivatives(motion.tables.control_points)[1:]
    return np.asarray(np.einsum("vj,kvd->kjd", slopes, motion.increments) / motion.step_size)


def control_places(motion: Motion) -> Array:
    """Positions of the unknown at the control points, shape ``(n, s + 1, d)``."""
    start = motion.stepped.position[: motion.n_steps, None]
    return np.concatenate([start, start + motion.increments], axis=1)


def paired(moments: Array | None, values: Array, n_steps: int) -> Array:
    """Sum of moments times values at the control points, shape ``(n,)``."""
    if moments is None:
        return np.zeros(n_steps)
    return np.asarray(np.einsum("kvd,kvd->k", moments[:n_steps], values))


def running_sum(changes: Array) -> Array:
    """Sum of the changes over the steps up to every grid point, shape ``(n,)`` to ``(n + 1,)``."""
    return np.concatenate([[0.0], np.cumsum(changes)])


def grid_velocity(motion: Motion, momentum: Array) -> Array:
    """Velocity that belongs to a momentum at the positions of the grid, shape ``(n + 1, d)``."""
    time = motion.step_size * np.arange(momentum.shape[0], dtype=float)
    return dynamics_of(motion.scene).velocity(motion.position, momentum, time)
