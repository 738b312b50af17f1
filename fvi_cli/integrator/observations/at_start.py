"""Damping forces and accelerations at t = 0, where those of Riemann-Liouville may be infinite."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array


def riemann_liouville_excess(scene: Scene, time: Array) -> Array:
    """Damping by Riemann-Liouville derivatives of order below 1, less that by Caputo's."""
    total = np.zeros((time.size, scene.dimension))
    if scene.derivative == "caputo" or not np.any(scene.initial_position != 0):
        return total
    for term in scene.active_damping:
        if term.order < 1:
            power = time**-term.order / math.gamma(1.0 - term.order)
            total += power[:, None] * times(scene.initial_position, term.form)
    return total


def damping_at_start(scene: Scene) -> Array:
    """The damping force at t = 0, infinite where it grows above all bounds."""
    total = np.zeros(scene.dimension)
    for term in scene.active_damping:
        if term.order == 1:
            total -= times(scene.initial_velocity, term.form)
    for lead in _infinite_at_start(scene):
        total = np.where(lead == 0, total, np.copysign(np.inf, lead))
    return total


def _infinite_at_start(scene: Scene) -> list[Array]:
    """Coefficients of the powers with which damping forces begin infinite, the steepest last."""
    if scene.derivative == "caputo":
        return []
    starts = (scene.initial_position, scene.initial_velocity)
    terms = [term for term in scene.active_damping if not term.is_integer_order]
    terms.sort(key=lambda term: term.order % 1.0)
    return [-times(starts[int(term.order)], term.form) for term in terms]


def with_infinite_start(scene: Scene, found: Array, time: Array) -> Array:
    """Accelerations at these times; at t = 0 infinite where the damping forces are infinite."""
    mass = scene.inertia
    for lead in _infinite_at_start(scene):
        # the mass of a Lagrangian is positive, which is enough for one coordinate
        if scene.lagrangian is None or scene.dimension == 1:
            direction = mass.velocity(lead[None])[0] if scene.lagrangian is None else lead
            infinite = np.where(direction == 0, found, np.copysign(np.inf, direction))
            found = np.where((time == 0.0)[:, None], infinite, found)
    return found
