"""Surfaces that a motion bounces off, and the steps after an impact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.graded import graded_start_mesh, start_power
from fvi_cli.integrator.observations.request import Impact
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import slopes_of

ROUND_OFF = 32 * 2.0**-52
"""Relative to the terms of g: values smaller than this count as 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A surface g(q, t) = 0 of a scene."""

    impact: Impact
    coordinates: Sequence[str]
    parameters: Mapping[str, float]

    def values(self, position: Array, time: Array | float) -> dict[str, Array | float]:
        """The variables of g by name."""
        found: dict[str, Array | float] = {**self.parameters, "t": time}
        for index, name in enumerate(self.coordinates):
            found[name] = position[..., index]
        return found

    def gap(self, position: Array, time: Array | float) -> Array:
        """The value of g, shapes ``(..., d)`` to ``(...)``."""
        found = self.impact.when.evaluate(self.values(position, time))
        return np.broadcast_to(np.asarray(found), position.shape[:-1])

    def slopes(self, position: Array, time: float) -> tuple[Array, float]:
        """Gradient by q, shape ``(d,)``, and derivative by t."""
        place = dict(zip(self.coordinates, position.tolist(), strict=True))
        values = {**self.parameters, "t": time, **place}
        found = slopes_of(self.impact.when, values, (*self.coordinates, "t"))
        slope = [float(found.get(name, 0.0)) for name in self.coordinates]
        return np.array(slope), float(found.get("t", 0.0))

    def round_off(self, position: Array, reach: Array, time: float) -> float:
        """Round-off of g at a position after a step with displacements up to `reach`."""
        normal, rate = self.slopes(position, time)
        size = float(np.abs(normal) @ (np.abs(position) + np.abs(reach))) + abs(rate * time)
        return ROUND_OFF * size


def start_objection(scene: Scene, surface: Surface) -> str:
    """Why a motion cannot begin where it does, with what to write; empty if it can."""
    begin, velocity = scene.initial_position, scene.initial_velocity
    gap = float(surface.gap(begin, 0.0))
    if not math.isfinite(gap):
        return f"has the value {gap} at the start; write a surface that has one everywhere"
    if gap < -surface.round_off(begin, np.zeros_like(begin), 0.0):
        return (
            f"is {gap:.6g} at the start: the motion begins behind the surface; begin where it is "
            "positive, or reverse its sign"
        )
    if gap > surface.round_off(begin, np.zeros_like(begin), 0.0):
        return ""
    normal, rate = surface.slopes(begin, 0.0)
    speed = float(normal @ velocity) + rate
    size = float(np.abs(normal) @ np.abs(velocity)) + abs(rate)
    if speed < -ROUND_OFF * size:
        return (
            f"is 0 at the start and falls at the rate {-speed:.6g}: the motion begins on the "
            "surface and moves through it; give the velocity behind the impact"
        )
    return ""


def power_behind_impact(scene: Scene) -> float | None:
    """Least fractional power of the time in the position after a jump of the velocity.

    The derivative acts on the jump as that of Riemann and Liouville does on an initial velocity.
    """
    moving = replace(
        scene,
        initial_position=np.zeros(scene.dimension),
        initial_velocity=np.ones(scene.dimension),
        derivative="riemann-liouville",
        forcing=None,
    )
    return start_power(moving, at_start=True)


@lru_cache(maxsize=256)
def _pattern(step: float, count: int, stages: int, power: float | None) -> tuple[float, ...]:
    """Ends of graded steps after a singular point, over `count` steps of length `step`."""
    mesh = graded_start_mesh(
        count * step, count, (), stages=stages, exponent=lambda at_start: power
    )
    ends: list[float] = []
    for one in mesh.stretches:
        ends += [one.begin + k * one.step_size for k in range(1, one.n_steps)] + [one.end]
    return tuple(ends)


def step_ends(
    step: float, length: float, stages: int, power: float | None, least: float
) -> list[float]:
    """Ends of the steps after a singular point, relative to it, up to a length.

    `step` is the length of steps that are not graded, `power` the least fractional power in the
    position (None: it is smooth). Ends closer than `least` to 0 or the length are left out.
    """
    count = max(1, math.ceil(length / step * (1.0 - 1e-12)))
    ends = [one for one in _pattern(step, count, stages, power) if least <= one < length - least]
    return [*ends, length]
