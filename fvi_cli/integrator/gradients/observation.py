"""Positions, velocities and damping forces at some times, as linear functions of a run's steps."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.gradients.linearised import Tangent
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis


class MotionAt:
    """Positions, velocities and damping forces of a run at k places, ``(k,)`` each."""

    def __init__(self, steps: RunSteps, places: tuple[Places, Array]) -> None:
        self._steps, self._places, self._which = steps, places, places[0]
        basis, tables = lobatto_basis(steps.tables.degree), steps.tables
        displacement = steps.step_size[self._which] * basis.values(places[1])[1:]
        # of all unknowns, and of values at the stages
        self._rows = np.stack([displacement.T, basis.derivatives(places[1])[1:].T])
        self._of_stages = np.ones((self._which.size, 1))
        if tables.points.size > 1:
            self._of_stages = np.ascontiguousarray(tables.stage_basis.values(places[1]).T)

    def motion(self) -> tuple[Array, Array]:
        """Positions and velocities, each ``(k, d)``."""
        return self._steps.position_in(*self._places), self._steps.velocity_in(*self._places)

    def changes(self, tangent: Tangent) -> tuple[Array, Array]:
        """Their changes by disturbances, each ``(p, k, d)``."""
        unknowns = tangent.unknowns[:, self._which]
        displacement, velocity = np.einsum("iks,pksd->ipkd", self._rows, unknowns)
        return tangent.position[:, self._which] + displacement, velocity

    def force_changes(self, force: Array) -> Array:
        """Changes of the damping force from those at the stages, ``(p, k, d)``."""
        return np.asarray(np.einsum("kr,pkrd->pkd", self._of_stages, force[:, self._which]))

    def spread(self, by_position: Array, by_velocity: Array) -> tuple[Array, Array]:
        """Derivatives by positions at mesh points and by unknowns from those by the motion."""
        by_motion = np.stack([by_position, by_velocity])
        n = len(self._steps.position)
        return (
            self._gathered(by_position, n),
            self._gathered(np.einsum("iks,ikd->ksd", self._rows, by_motion), n - 1),
        )

    def spread_force(self, by_force: Array) -> Array:
        """Derivatives by the damping force at the stages from those there, ``(n, r, d)``."""
        own = np.einsum("kr,kd->krd", self._of_stages, by_force)
        return self._gathered(own, self._steps.n_steps)

    def _gathered(self, values: Array, count: int) -> Array:
        """Sums over the places of every step."""
        found = np.zeros((count, *values.shape[1:]))
        np.add.at(found, self._which, values)
        return found
