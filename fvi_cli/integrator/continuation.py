"""How a nonlinear motion would go on after a break point if nothing changed there.

The response of a nonlinear scene to a jump of the forcing depends on the motion it comes from.
That one is smooth, and a few points of the grid before the break point tell its derivatives: the
values of a run are exact there to the order of the method, position and velocity alike.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.power_series import PowerSeries

Array = NDArray[np.float64]
Path = tuple[PowerSeries, ...]

FEWER: Final = 4.0
"""A response needs so many fewer powers of the path than it has itself: t**2 of its own and two of
the integrations."""
POINTS: Final = 5
"""Points whose positions and velocities a polynomial meets."""
LEAST_DISTANCE: Final = 8
"""Steps from what is singular to a break point, at the least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """Paths by break points, as series in the time since; those that are not known are absent."""

    by_break: Mapping[float, Path] = field(default_factory=dict)

    def at(self, break_point: float) -> Path | None:
        """The path at a break point; None where it is not known."""
        return self.by_break.get(break_point)


UNKNOWN: Final = Paths()


def asks_for_paths(scene: Scene) -> bool:
    """Whether responses to jumps depend on the motion, and leave fractional powers."""
    return (
        isinstance(scene.potential, ExpressionPotential)
        and bool(scene.break_points)
        and any(not term.is_integer_order for term in scene.active_damping)
    )


def uniform_paths(scene: Scene, cutoff: float) -> Paths:
    """Uniform motion from the start values at every break point, for plans without any run.

    Parameters
    ----------
    scene
        The scene.
    cutoff
        How far responses are wanted.
    """
    coefficients = np.zeros((_powers(cutoff), scene.dimension))
    start = np.stack((scene.initial_position, scene.initial_velocity))[: coefficients.shape[0]]
    coefficients[: start.shape[0]] = start
    return Paths(by_break=dict.fromkeys(scene.break_points, _path(coefficients, cutoff)))


def paths_of(scene: Scene, trajectory: Trajectory, n_steps: int, cutoff: float) -> Paths:
    """The paths that a finished run tells.

    Parameters
    ----------
    scene, n_steps
        The scene with a constant mass matrix, and N.
    trajectory
        A run with the same steps, up to the last break point at least or as far as it came.
    cutoff
        How far responses are wanted.
    """
    found: dict[float, Path] = {}
    singular = 0
    for break_point, step in zip(
        scene.break_points, steps_at_break_points(scene, n_steps), strict=True
    ):
        if (
            step - singular >= LEAST_DISTANCE
            and step < trajectory.time.size
            and trajectory.momentum is not None
        ):
            points = slice(singular + 1, step + 1)
            velocity = scene.inertia.velocity(trajectory.momentum[points])
            found[break_point] = _path(
                _derivatives(
                    trajectory.position[points],
                    velocity,
                    trajectory.step_size,
                    _powers(cutoff),
                ),
                cutoff,
            )
        singular = step
    return Paths(by_break=found)


def _powers(cutoff: float) -> int:
    return max(1, math.ceil(cutoff - FEWER))


def _derivatives(position: Array, velocity: Array, step_size: float, powers: int) -> Array:
    """The first coefficients of a smooth path in the time since its last point.

    Points close together lose the higher ones to round-off, points far apart to what a polynomial
    cannot follow: of spacings that double the one is taken that the next agrees with best.
    """
    span = step_size * (position.shape[0] - 1)
    scales = span ** np.arange(powers)[:, None]
    found: list[Array] = []
    spacing = 1
    while (POINTS - 1) * spacing < position.shape[0]:
        chosen = slice(-1 - (POINTS - 1) * spacing, None, spacing)
        found.append(
            _interpolated(position[chosen], velocity[chosen], spacing * step_size)[:powers]
        )
        spacing *= 2
    changes = [float((scales * np.abs(a - b)).max()) for a, b in itertools.pairwise(found)]
    return found[int(np.argmin(changes))] if changes else found[0]


def _interpolated(position: Array, velocity: Array, step_size: float) -> Array:
    """Coefficients in the time since the last point of the polynomial through all of them."""
    count = position.shape[0]
    at = np.arange(1 - count, 1, dtype=float)
    powers = np.arange(2 * count)
    values = at[:, None] ** powers
    slopes = np.zeros_like(values)
    slopes[:, 1:] = values[:, :-1] * powers[1:]
    known = np.concatenate([position, step_size * velocity])
    coefficients = np.linalg.solve(np.concatenate([values, slopes]), known)
    return np.asarray(coefficients / step_size ** powers[:, None].astype(float))


def _path(coefficients: Array, cutoff: float) -> Path:
    """Series with these coefficients, shape ``(n, d)``.

    They are not known up to the cutoff; but what is missing falls out of the differences that
    drive a response, as far as that is wanted.
    """
    exponents = np.arange(coefficients.shape[0], dtype=float)
    return tuple(
        PowerSeries(exponents=exponents, coefficients=column, cutoff=cutoff)
        for column in coefficients.T
    )
