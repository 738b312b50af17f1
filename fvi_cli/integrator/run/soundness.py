"""When runs stop because what they do cannot be right."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.domain import check_domain, is_unbounded
from fvi_cli.integrator.growth_bound import GrowthBound, first_outside, least_bound, scene_bound
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.loop.points import Points, Stops
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.arrays import Array


class Soundness:
    """Stops scenes that leave the domain of their potential or all that they can reach.

    Both are looked at closely only where a quick look at all scenes finds it possible.

    Parameters
    ----------
    scenes, loads
        What moves, and the known forces of each, whose largest value is met on the way.
    """

    def __init__(self, scenes: Sequence[Scene], loads: Sequence[StepLoads]) -> None:
        self._scenes, self._loads = scenes, loads
        self._bounds: dict[int, GrowthBound] = {}

    def __call__(self, points: Points, live: Sequence[int], stops: Stops) -> None:
        """Stop scenes among `live` at the first step that is wrong, where that is earlier."""
        n = points.times.size
        if points.unknowns is not None:
            self._check_domain(points, live, stops)
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
        """What no run that stays inside is taken for diverged, ``(2, scenes)``."""
        return np.array([least_bound(one) for one in self._scenes]).T

    def _check_domain(self, points: Points, live: Sequence[int], stops: Stops) -> None:
        first = self._scenes[0].potential
        if not isinstance(first, ExpressionPotential) or points.unknowns is None:
            return
        begins = np.concatenate([points.before[:, None], points.position[:, :-1]], axis=1)
        ways = points.sizes[:, None, None] * points.unknowns
        path = (begins[:, :, None] + ways).reshape(len(begins), -1, begins.shape[-1])
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

    def _may_be_undefined(self, first: ExpressionPotential, path: Array) -> Array:
        """Scenes on whose paths ``(scenes, n, d)`` V may be infinite or undefined."""
        names = dict(self._parameters)
        for index, coordinate in enumerate(first.coordinates):
            names[coordinate] = np.ascontiguousarray(path[..., index])
        value = first.energy_expression.system.evaluate(names, NUMPY_FUNCTIONS)[0]
        lost = ~np.isfinite(np.broadcast_to(value, path.shape[:2])).all(axis=1)
        if first.energy_expression.system.is_entire:
            return np.asarray(lost)
        low, high = path.min(axis=1), path.max(axis=1)
        parameters = {name: one[:, 0] for name, one in self._parameters.items()}
        return np.asarray(lost | is_unbounded(first, low, high, parameters))

    @cached_property
    def _parameters(self) -> dict[str, Array]:
        """Values of all scenes by name, ``(scenes, 1)``."""
        known = [one.potential for one in self._scenes]
        every = [one.parameters for one in known if isinstance(one, ExpressionPotential)]
        return {name: np.array([[float(one[name])] for one in every]) for name in every[0]}
