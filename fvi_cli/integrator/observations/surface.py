"""Surfaces that a motion bounces off, and the steps behind an impact."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.graded_start import graded_start_mesh
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.observations.asked import Impact
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import slopes_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Surface:
    """A surface g(q, t) = 0 of a scene.

    Parameters
    ----------
    impact
        The expression and its coefficient of restitution.
    coordinates, parameters
        Names in the expression, and values of further names.
    """

    impact: Impact
    coordinates: Sequence[str]
    parameters: Mapping[str, float]

    def gap(self, position: Array, time: Array | float) -> Array:
        """The value of g, shapes ``(..., d)`` to ``(...)``."""
        values: dict[str, Array | float] = {**self.parameters, "t": time}
        for index, name in enumerate(self.coordinates):
            values[name] = position[..., index]
        found = self.impact.when.evaluate(values, NUMPY_FUNCTIONS)
        return np.broadcast_to(np.asarray(found), position.shape[:-1])

    def slopes(self, position: Array, time: float) -> tuple[Array, float]:
        """Gradient by q, shape ``(d,)``, and derivative by t, by complex steps."""
        place = dict(zip(self.coordinates, position.tolist(), strict=True))
        values = {**self.parameters, "t": time, **place}
        found = slopes_of(self.impact.when, values, (*self.coordinates, "t"))
        slope = [float(found.get(name, 0.0)) for name in self.coordinates]
        return np.array(slope), float(found.get("t", 0.0))


def power_behind_impact(scene: Scene) -> float | None:
    """Least fractional power of the time in the position behind a jump of the velocity."""
    moving = replace(
        scene, initial_velocity=np.ones(scene.dimension), derivative="caputo", forcing=None
    )
    return start_power(moving, at_start=True)


@lru_cache(maxsize=256)
def _pattern(step: float, count: int, stages: int, power: float | None) -> tuple[float, ...]:
    """Ends of graded steps behind a singular point, to `count` steps of length `step`."""
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
    """Ends of the steps behind a singular point, relative to it, up to a length.

    Parameters
    ----------
    step
        Length of the steps that are not cut.
    length
        Where the last one ends.
    stages, power
        Of the method; and the least fractional power of the position, None: it is smooth.
    least
        Ends nearer than this are left out.
    """
    count = max(1, math.ceil(length / step * (1.0 - 1e-12)))
    ends = [one for one in _pattern(step, count, stages, power) if least <= one < length - least]
    return [*ends, length]
