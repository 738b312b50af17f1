"""Positions, velocities and damping forces at some times, as linear functions of a run's steps."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from fvi_cli.integrator.adjoint.linearised import Tangent
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis


class Observation:
    """Positions, velocities and damping forces of a run at n places.

    Parameters
    ----------
    steps
        The steps.
    places
        Numbers of steps, and places in them from 0 to 1, each of shape ``(n,)``.
    """

    def __init__(self, steps: RunSteps, places: tuple[Places, Array]) -> None:
        self._steps, self._places, self._which = steps, places, places[0]
        basis = lobatto_basis(steps.tables.degree)
        self._way = steps.step_size[self._which, None] * basis.values(places[1])[1:].T
        self._slopes = np.ascontiguousarray(basis.derivatives(places[1])[1:].T)

    @cached_property
    def _of_stages(self) -> Array:
        """From values at the stages to those at the places, ``(n, r)``."""
        tables = self._steps.tables
        if tables.points.size == 1:
            return np.ones((self._which.size, 1))
        return np.ascontiguousarray(tables.stage_basis.values(self._places[1]).T)

    def motion(self) -> tuple[Array, Array]:
        """Positions and velocities, each ``(n, d)``."""
        return self._steps.position_in(*self._places), self._steps.velocity_in(*self._places)

    def changes(self, tangent: Tangent) -> tuple[Array, Array]:
        """Their changes by disturbances, each ``(n, d, p)``."""
        unknowns = tangent.unknowns[self._which]
        position = tangent.position[self._which]
        position = position + np.einsum("ks,ksdp->kdp", self._way, unknowns)
        return position, np.einsum("ks,ksdp->kdp", self._slopes, unknowns)

    def force_changes(self, force: Array) -> Array:
        """Changes of the damping force from those at the stages, ``(n, d, p)``."""
        return np.asarray(np.einsum("kr,krdp->kdp", self._of_stages, force[self._which]))

    def spread(self, by_position: Array, by_velocity: Array) -> tuple[Array, Array]:
        """Derivatives by positions at mesh points and by unknowns from those by the motion."""
        steps, d = self._steps, by_position.shape[1]
        positions = np.zeros((steps.n_steps + 1, d))
        unknowns = np.zeros((steps.n_steps, steps.tables.degree, d))
        np.add.at(positions, self._which, by_position)
        own = np.einsum("ks,kd->ksd", self._way, by_position)
        own += np.einsum("ks,kd->ksd", self._slopes, by_velocity)
        np.add.at(unknowns, self._which, own)
        return positions, unknowns

    def spread_force(self, by_force: Array) -> Array:
        """Derivatives by the damping force at the stages from those there, ``(N, r, d)``."""
        steps = self._steps
        found = np.zeros((steps.n_steps, steps.tables.points.size, by_force.shape[1]))
        np.add.at(found, self._which, np.einsum("kr,kd->krd", self._of_stages, by_force))
        return found
