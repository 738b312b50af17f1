"""Surfaces that a motion bounces off, and how they reverse its normal velocity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observe.request import Impact
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import slopes_of

ROUND_OFF = 32 * 2.0**-52  # relative to the terms of g: smaller values count as 0
MOST_PUSHES = 1000  # in a corner: surfaces at a sharp angle push many times
NEGLIGIBLE = 1e-14  # share of the first speed towards a surface below which none counts


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A surface g(q, t) = 0 of a scene."""

    impact: Impact
    coordinates: Sequence[str]
    parameters: Mapping[str, float]

    def values(self, position: Array, time: Array | float) -> dict[str, Array | float]:
        """The variables of g by name."""
        columns = zip(self.coordinates, np.moveaxis(position, -1, 0), strict=True)
        return {**self.parameters, "t": time, **dict(columns)}

    def gap(self, position: Array, time: float) -> float:
        """The value of g at a position ``(d,)``."""
        return float(self.impact.when.evaluate(self.values(position, time)))

    def slopes(self, position: Array, time: float) -> tuple[Array, float]:
        """Gradient by q, shape ``(d,)``, and derivative by t."""
        place = dict(zip(self.coordinates, position.tolist(), strict=True))
        values = {**self.parameters, "t": time, **place}
        found = slopes_of(self.impact.when, values, (*self.coordinates, "t"))
        slope = [float(found.get(name, 0.0)) for name in self.coordinates]
        return np.array(slope), float(found.get("t", 0.0))

    def speed(self, position: Array, velocity: Array, time: float) -> float:
        """Derivative of the gap by the time along a motion."""
        normal, rate = self.slopes(position, time)
        return float(normal @ velocity) + rate

    def round_off(self, position: Array, reach: Array | float, time: float) -> float:
        """Round-off of g at a position after a step with displacements up to `reach`."""
        normal, rate = self.slopes(position, time)
        size = float(np.abs(normal) @ (np.abs(position) + reach)) + abs(rate * time)
        return ROUND_OFF * size


def start_objection(scene: Scene, surface: Surface) -> str:
    """Why a motion cannot begin where it does; empty if it can."""
    begin = scene.initial_position
    gap = surface.gap(begin, 0.0)
    if gap >= -surface.round_off(begin, 0.0, 0.0):
        return ""
    return (
        f"is {gap:.6g} at the start: the motion begins behind the surface; begin where it is "
        "positive, or reverse its sign"
    )


def push_off(
    scene: Scene, surfaces: Mapping[str, Surface], position: Array, velocity: Array, time: float
) -> tuple[Array, set[str], Array]:
    r"""Change of the momentum by surfaces that are met at once, which push, and velocity behind.

    They push one after the other, the one that is met fastest first, until the motion leaves them
    all, each by :math:`-(1 + e) \dot g\, \nabla g / (\nabla g^T M^{-1} \nabla g)`.
    """
    mass = scene.derivatives(position, velocity, np.array(time)).mass
    normals = {name: one.slopes(position, time)[0] for name, one in surfaces.items()}
    moves = {name: np.linalg.solve(mass, normal) for name, normal in normals.items()}
    weights = {name: normal @ moves[name] for name, normal in normals.items()}
    total, pushing, fastest = np.zeros_like(velocity), set[str](), 0.0
    for _ in range(MOST_PUSHES):
        speeds = {name: one.speed(position, velocity, time) for name, one in surfaces.items()}
        fastest = fastest or max(0.0, *(-one for one in speeds.values()))
        name = min(speeds, key=lambda one: speeds[one] / (math.sqrt(weights[one]) or 1.0))
        if speeds[name] >= -NEGLIGIBLE * fastest:
            break
        impulse = -(1.0 + surfaces[name].impact.restitution) * speeds[name] / weights[name]
        total = total + impulse * normals[name]
        velocity = velocity + impulse * moves[name]
        pushing.add(name)
    return total, pushing, velocity
