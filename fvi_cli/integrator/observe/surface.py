"""Surfaces that a motion bounces off, and how they reverse its normal velocity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.observe.request import Impact
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import slopes_of

ROUND_OFF = 32 * 2.0**-52  # relative to the terms of g: smaller values count as 0


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
    scene: Scene, surface: Surface, position: Array, velocity: Array, time: float
) -> tuple[Array, Array]:
    r"""Change of the momentum by a surface that pushes, and the velocity behind it, ``(d,)`` both.

    The change is :math:`-(1 + e) \dot g\, \nabla g / (\nabla g^T M^{-1} \nabla g)`.
    """
    mass = scene.derivatives(position, velocity, np.array(time)).mass
    normal, _ = surface.slopes(position, time)
    moved = np.linalg.solve(mass, normal)
    speed = min(surface.speed(position, velocity, time), 0.0)
    impulse = -(1.0 + surface.impact.restitution) * speed / (normal @ moved)
    return impulse * normal, velocity + impulse * moved
