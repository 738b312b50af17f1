"""Changes of the momentum of a motion that meets surfaces."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observations.impacts.surface import Surface
from fvi_cli.mathematics.arrays import Array

MOST_PUSHES = 1000
"""Most pushes in a corner: surfaces at a sharp angle push many times."""
NEGLIGIBLE = 1e-14
"""Speeds towards a surface below this share of the first one do not count."""


@dataclass(frozen=True, eq=False)
class Restitution:
    """The surfaces of a scene, and how they reverse its normal velocity."""

    scene: Scene
    surfaces: Mapping[str, Surface]

    def speed(self, name: str, position: Array, velocity: Array, time: float) -> float:
        """Derivative of a gap by the time along the motion."""
        normal, rate = self.surfaces[name].slopes(position, time)
        return float(normal @ velocity) + rate

    def push(
        self, names: list[str], position: Array, velocity: Array, time: float
    ) -> tuple[Array, set[str], Array]:
        """Change of the momentum by surfaces that are met at once, which push, velocity behind.

        They push one after the other, the one that is met fastest first, until the motion leaves
        them all.
        """
        normals = {name: self.surfaces[name].slopes(position, time)[0] for name in names}
        mobility = {
            name: self._mobility(normal, position, velocity, time)
            for name, normal in normals.items()
        }
        lengths = {name: math.sqrt(float(normals[name] @ mobility[name])) or 1.0 for name in names}
        total, pushing, fastest = np.zeros_like(velocity), set[str](), 0.0
        for _ in range(MOST_PUSHES):
            speeds = {name: self.speed(name, position, velocity, time) for name in names}
            fastest = max(fastest, *(-speeds[name] for name in names)) if not pushing else fastest
            name = min(names, key=lambda one: speeds[one] / lengths[one])
            if speeds[name] >= -NEGLIGIBLE * fastest:
                break
            restitution = self.surfaces[name].impact.restitution
            weight = float(normals[name] @ mobility[name])
            impulse = -(1.0 + restitution) * speeds[name] / weight
            total = total + impulse * normals[name]
            velocity = velocity + impulse * mobility[name]
            pushing.add(name)
        return total, pushing, velocity

    def _mobility(self, normal: Array, position: Array, velocity: Array, time: float) -> Array:
        """Inverse of the mass matrix times a normal."""
        if self.scene.lagrangian is None:
            return self.scene.inertia.velocity(normal)
        mass = self.scene.lagrangian.derivatives(position, velocity, time).mass
        return np.asarray(np.linalg.solve(mass, normal))
