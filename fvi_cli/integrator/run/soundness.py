"""When runs stop because their motion cannot be right."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fvi_cli.effects.potential import ExpressionPotential, SuppliedPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.domain import check_domain, may_be_unbounded
from fvi_cli.integrator.growth_bound import GrowthBound, first_outside, least_bound, scene_bound
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.run.points import Points, Stops
from fvi_cli.mathematics.arrays import Array

CHORDS_OF_A_BOX = 16
"""Chords in each smaller box, examined if V may be infinite in the box of a whole path."""


def _boxes(columns: Sequence[Array], chords: int) -> tuple[Array, Array]:
    """Corners of boxes around `chords` successive chords of paths, ``(q, n)`` to ``(q, k, d)``."""
    size = columns[0].shape[1]
    first = np.arange(0, max(size - 1, 1), chords)
    last = np.minimum(first + chords, size - 1)
    low, high = (
        np.stack([by(by.reduceat(one, first, axis=1), one[:, last]) for one in columns], axis=-1)
        for by in (np.minimum, np.maximum)
    )
    return low, high


class Soundness:
    """Stops scenes that leave the domain of their potential or the bound of their motion.

    Both are examined closely only if a quick test of all scenes finds it possible.

    `loads` have the largest force of each scene so far. Scenes that are pushed by moving surfaces
    have no bound.
    """

    def __init__(
        self, scenes: Sequence[Scene], loads: Sequence[StepLoads], *, is_bounded: bool = True
    ) -> None:
        self._scenes, self._loads, self._is_bounded = scenes, loads, is_bounded
        self._bounds: dict[int, GrowthBound] = {}

    def __call__(self, points: Points, live: Sequence[int], stops: Stops) -> None:
        """Stop scenes among `live` at the first step that is wrong, where that is earlier."""
        n = points.times.size
        self._check_domain(points, live, stops)
        if not self._is_bounded:
            return
        position = points.position
        largest = np.maximum(position.max(axis=(1, 2)), -position.min(axis=(1, 2)))
        forces = np.array([one.largest_force for one in self._loads])
        least, per_force = self._least
        least = least + per_force * forces
        far = ~(largest <= np.where(least > 0, least, np.inf))
        for scene in live:
            if not far[scene]:
                continue
            count = stops[scene][0] if scene in stops else n
            found = first_outside(
                self._bound(scene).with_force(self._loads[scene].largest_force),
                points.position[scene, :count],
                points.momentum[scene, :count],
                points.times[:count],
                points.done,
            )
            if found is not None:
                stops[scene] = (found[0] + 1, found[1])

    def _bound(self, scene: int) -> GrowthBound:
        if scene not in self._bounds:
            self._bounds[scene] = scene_bound(self._scenes[scene])
        return self._bounds[scene]

    @cached_property
    def _least(self) -> Array:
        """:func:`least_bound` of all scenes: below, no run has diverged, ``(2, scenes)``."""
        return np.array([least_bound(one) for one in self._scenes]).T

    def _check_domain(self, points: Points, live: Sequence[int], stops: Stops) -> None:
        first = self._scenes[0].potential
        if points.unknowns is None:
            return
        if not isinstance(first, ExpressionPotential | SuppliedPotential):
            return
        begins = np.concatenate([points.before[:, None], points.position[:, :-1]], axis=1)
        displacements = points.sizes[:, None, None] * points.unknowns
        path = (begins[:, :, None] + displacements).reshape(len(begins), -1, begins.shape[-1])
        path = np.concatenate([points.before[:, None], path], axis=1)
        for scene in np.flatnonzero(self._may_be_undefined(first, path)).tolist():
            if scene not in live:
                continue
            count = stops[scene][0] if scene in stops else points.times.size
            found = check_domain(
                self._scenes[scene].potential,
                path[scene, : 1 + count * points.unknowns.shape[2]],
                points.unknowns.shape[2],
                points.times,
                points.done,
            )
            if found is not None:
                stops[scene] = found

    def _may_be_undefined(
        self, first: ExpressionPotential | SuppliedPotential, path: Array
    ) -> Array:
        """Scenes on whose paths ``(scenes, n, d)`` V may be infinite or undefined."""
        if isinstance(first, SuppliedPotential):
            return np.asarray(~np.isfinite(first.energy(path)).all(axis=1))
        columns = [np.ascontiguousarray(path[..., index]) for index in range(path.shape[2])]
        names = {**self._parameters, **dict(zip(first.coordinates, columns, strict=True))}
        value = first.energy_expression.system.evaluate(names)[0]
        lost = np.asarray(~np.isfinite(np.broadcast_to(value, path.shape[:2])).all(axis=1))
        if first.energy_expression.system.is_entire:
            return lost
        undecided = np.flatnonzero(~lost)
        for chords in (path.shape[1], CHORDS_OF_A_BOX):
            low, high = _boxes([one[undecided] for one in columns], chords)
            parameters = {
                name: np.broadcast_to(one[undecided], low.shape[:2])
                for name, one in self._parameters.items()
            }
            undecided = undecided[may_be_unbounded(first, low, high, parameters).any(axis=1)]
        lost[undecided] = True
        return lost

    @cached_property
    def _parameters(self) -> dict[str, Array]:
        """Values of all scenes by name, ``(scenes, 1)``."""
        known = [one.potential for one in self._scenes]
        every = [one.parameters for one in known if isinstance(one, ExpressionPotential)]
        return {name: np.array([[float(one[name])] for one in every]) for name in every[0]}
