"""The linear scene that approximates a nonlinear one near one of its states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

MOST_POINTS = 64
"""Most points of a path at which the stiffness is examined."""

MOST_LINEARISATIONS = 5
"""Linearisations along a path: the softest, the stiffest, and some between them."""


def linearised_at_start(scene: Scene) -> Scene:
    """The linear scene that approximates a nonlinear one near its start.

    Raises
    ------
    ValueError
        If its second derivatives there are not those of a mass and a stiffness.
    """
    return linearised_at(scene, scene.initial_position, scene.initial_velocity, 0.0)


def linearised_at(scene: Scene, position: Array, velocity: Array, time: float) -> Scene:
    """The linear scene that approximates a nonlinear one near a state ``(d,)``.

    For a Lagrangian it has the second derivatives there, without the gyroscopic part. A linear
    scene is returned as it is.

    Raises
    ------
    ValueError
        If the second derivatives are not those of a mass and a stiffness.
    """
    if scene.lagrangian is not None:
        at = scene.lagrangian.derivatives(position, velocity, time)
        inertia, hessian = Inertia(mass=0.5 * (at.mass + at.mass.T)), -at.stiffness
    elif scene.potential is not None and not scene.is_linear:
        inertia, hessian = scene.inertia, scene.potential.hessian(position)
    else:
        return scene
    potential = QuadraticPotential(stiffness=0.5 * (hessian + hessian.T))
    return replace(scene, inertia=inertia, potential=potential, lagrangian=None)


def linearised_along(scene: Scene, trajectory: Trajectory) -> list[tuple[float, Scene]]:
    """Times on the path of a nonlinear scene, with the linear scenes there.

    There the stiffness relative to the mass is smallest, largest, and in between; points
    where the scene cannot be linearised are left out.
    """
    with np.errstate(all="ignore"):
        finite = np.flatnonzero(np.isfinite(trajectory.position).all(axis=1))
        if scene.is_linear or not finite.size:
            return []
        chosen = finite[np.unique(np.linspace(0, finite.size - 1, MOST_POINTS).round().astype(int))]
        velocity = _velocities(trajectory)
        found: list[tuple[float, float, Scene]] = []
        for index in chosen:
            time = float(trajectory.time[index])
            try:
                near = linearised_at(scene, trajectory.position[index], velocity[index], time)
            except ValueError:
                continue
            found.append((_stiffest(near.inertia.mass, near.stiffness), time, near))
    found.sort(key=lambda one: one[0])
    places = np.unique(np.linspace(0, len(found) - 1, MOST_LINEARISATIONS).round().astype(int))
    return [(found[place][1], found[place][2]) for place in places] if found else []


def _velocities(trajectory: Trajectory) -> Array:
    """Velocities to the accuracy of differences."""
    if trajectory.time.size < 2:
        return np.zeros_like(trajectory.position)
    return np.asarray(np.gradient(trajectory.position, trajectory.time, axis=0))


def _stiffest(mass: Array, stiffness: Array) -> float:
    """Largest eigenvalue of the stiffness relative to the mass."""
    root = np.linalg.inv(np.linalg.cholesky(mass))
    return float(np.linalg.eigvalsh(root @ stiffness @ root.T)[-1])
