"""Forces, deformations and works of single dampers at any places of a motion."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fvi_cli.integrator.observations.dampers import (
    TOGETHER,
    DamperValue,
    check_work,
    dampers_of,
    deformation_of,
    remembered_at_start,
    running_work,
    spring_force,
)
from fvi_cli.integrator.observations.motion import DenseMotion, join_series, stage_series
from fvi_cli.integrator.observations.pieces import by_owner
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.series.chebyshev import evaluate_series


class DampersAlong:
    """The dampers of members along their motions; what they remember is found once."""

    def __init__(self, motion: DenseMotion) -> None:
        self._motion = motion
        self._series: dict[tuple[str, int], Array] = {}

    def __call__(self, value: DamperValue, steps: Places, tau: Array) -> Array:
        """A force, deformation or work at places of steps, shape ``(n,)``."""
        motion, place = self._motion, value.place
        if place == TOGETHER:
            count = len(dampers_of(motion.scenes[0]))
            every = (replace(value, place=one) for one in range(count))
            return np.asarray(sum(self(one, steps, tau) for one in every))
        if value.kind == "work":
            return evaluate_series(self._works(place), steps, 2.0 * tau - 1.0)[:, 0]
        position, found = motion.position(steps, tau), np.zeros(steps.size)
        is_force, time = value.kind == "force", motion.time(steps, tau)
        if is_force:
            series = self._remembered(place)
            found = evaluate_series(series, steps, 2.0 * tau - 1.0)[:, value.component]
        for member, own in by_owner(motion.owner, steps, len(motion.scenes)):
            scene = motion.scenes[member]
            deformation = deformation_of(scene, place, position[own])
            if not is_force:
                found[own] = deformation[:, value.component]
                continue
            at_start = remembered_at_start(scene, place)[value.component]
            found[own] = np.where(time[own] == 0.0, at_start, found[own])
            found[own] += spring_force(scene, place, deformation, time[own])[:, value.component]
        return found

    def _remembered(self, place: int) -> Array:
        """Chebyshev coefficients of what a damper remembers, ``(K, N, c)``."""
        if ("force", place) not in self._series:
            found = []
            for forces, rate, shape in self._at_stages(place):
                series = stage_series(shape, np.zeros_like(rate) if forces is None else forces)
                found.append(series.reshape(len(series), shape.n_steps, -1))
            self._series["force", place] = join_series(found)
        return self._series["force", place]

    def _works(self, place: int) -> Array:
        """Chebyshev coefficients of the work on a damper, ``(K, N, 1)``."""
        if ("work", place) not in self._series:
            for scene in self._motion.scenes:
                check_work(scene, f"work_{place + 1}")
            found = [running_work(o, f, rate)[..., None] for f, rate, o in self._at_stages(place)]
            self._series["work", place] = join_series(found)
        return self._series["work", place]

    def _at_stages(self, place: int) -> Iterator[tuple[Array | None, Array, RunSteps]]:
        """For every member force and rate of deformation of a damper, ``(n, r, c)``."""
        motion = self._motion
        every = zip(motion.find_forces(place), motion.scenes, motion.shapes, strict=True)
        for forces, scene, shape in every:
            rate = deformation_of(scene, place, shape.velocity)
            yield None if forces is None else forces.sum(axis=0), rate, shape
