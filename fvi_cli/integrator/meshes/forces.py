"""The forces of a scene at any points of a solved step, and how they move the scene."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.matrices import Solve, solver, times
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.lagrange import lobatto_basis

KEPT = 128
"""Number of step sizes whose factors are kept."""


class StepPath(NamedTuple):
    """The polynomial of one solved step."""

    begin: float  # t and h
    size: float
    position: Array  # where it begins, shape (d,)
    unknowns: Array  # U, shape (s, d)


class Places(NamedTuple):
    """Places in [0, 1] of a step, with the maps from U to displacements over h and velocities."""

    at: Array  # (n,)
    values: Array  # (n, s) each
    slopes: Array

    @classmethod
    def of(cls, degree: int, at: Array) -> Places:
        """Places of a step of polynomials of this degree."""
        basis = lobatto_basis(degree)
        return cls(at, basis.values(at)[1:].T, basis.derivatives(at)[1:].T)


class StepForces:
    """Forces of one scene along its steps, but for the stiffness of a linear scene."""

    def __init__(self, scene: Scene, stages: int) -> None:
        self._scene, self._is_nonlinear = scene, not scene.is_linear
        mass, potential = scene.inertia.form, scene.potential
        self._resolve = None
        if scene.is_sparse and isinstance(potential, QuadraticPotential):
            stiffness = potential.form

            @lru_cache(maxsize=KEPT)
            def resolve(size: float) -> Solve:
                """Accelerations by the forces that a step of this size resolves."""
                return solver(mass + (size / stages) ** 2 * stiffness)

            self._resolve = resolve

    def at(self, path: StepPath, places: Places) -> tuple[Array | None, Array]:
        """Momenta (None where they are linear in the velocity) and forces, ``(n, d)``."""
        momentum, force = None, np.zeros((places.at.size, path.position.size))
        time, scene = path.begin + path.size * places.at, self._scene
        if self._is_nonlinear:
            position = path.position + path.size * (places.values @ path.unknowns)
            if scene.lagrangian is not None:
                velocity = places.slopes @ path.unknowns
                momentum, force = scene.lagrangian.forces(position, velocity, time)
            elif scene.potential is not None:
                force = -scene.potential.gradient(position)
        if scene.forcing is not None:
            force = force + scene.forcing.on_steps(np.array([path.begin]), path.size, places.at)[0]
        return momentum, force

    def accelerations(self, path: StepPath, forces: Array) -> Array:
        """Accelerations by forces ``(n, d)`` in a step: the part of them that it resolves."""
        scene = self._scene
        if self._resolve is not None:
            return np.asarray(self._resolve(path.size)(forces.T).T)
        if scene.lagrangian is None:
            return scene.inertia.velocity(forces)
        velocity = Places.of(len(path.unknowns), np.array([0.5])).slopes[0] @ path.unknowns
        mass = scene.lagrangian.derivatives(path.position, velocity, path.begin).mass
        try:
            return np.asarray(np.linalg.solve(mass, forces.T).T)
        except np.linalg.LinAlgError:
            return np.full_like(forces, np.inf)

    def resolved(self, path: StepPath, values: Array) -> Array:
        """The part of displacements or velocities ``(n, d)`` that a step resolves."""
        if self._resolve is None:
            return values
        return self.accelerations(path, times(values, self._scene.inertia.form))
