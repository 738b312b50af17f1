"""Two looks for forces that act between the points of a step.

A force F that acts unseen for a time d moves a scene by F d (T - t) / M until its end. Formulas of
the time are sampled once a scene; forces of the motion are evaluated along the path of every step.
The sum over those samples that a step's own interpolation misses by far is what the step may miss.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.defect import Between, StepPath
from fvi_cli.integrator.local_error.forces import PointForces
from fvi_cli.integrator.meshes.samples import EVERY, ForceSamples, sample_forces
from fvi_cli.integrator.tables import StepTables
from fvi_cli.mathematics.arrays import Array

PLACES: Final = 8_192  # places of a run at which forces of the motion are evaluated
BEYOND: Final = 10.0
"""Samples count that are missed by more than so many times the median of their step."""
AT_ENDS: Final = 1e-9
"""Samples so close to an end of a step, in steps, are left out: the force may jump there."""


class Looks:
    """Looks at the steps of one run."""

    def __init__(
        self, scene: Scene, between: Between, tables: StepTables, samples: ForceSamples | None
    ) -> None:
        self._between, self._end = between, scene.final_time
        self._basis, self._stages = tables.stage_basis, tables.points
        self._samples = samples or sample_forces(scene)

    def missed(self, path: StepPath, seen: PointForces) -> float:
        """How far forces that a step misses may move the scene until its end, a length."""
        with np.errstate(all="ignore"):
            impulse = max(self._along(path, seen), *self._in_time(path), 0.0)
            if impulse == 0.0:
                return 0.0
            found = impulse * self._between.mobility_of(path) * (self._end - path.begin)
        return found if math.isfinite(found) else math.inf

    def _in_time(self, path: StepPath) -> Iterator[float]:
        """Impulses that the step misses of each formula of the time."""
        h, t = path.size, path.begin
        ends = t + AT_ENDS * h, t + h * (1.0 - AT_ENDS)
        for one in self._samples.formulas:
            if not one.begin <= path.middle <= one.end:
                continue
            low, high = np.searchsorted(one.times, ends)
            first, last = np.searchsorted(one.kept, (low, high))
            places, usual = one.kept[first:last], one.is_coarse[first:last]
            if h < 16 * EVERY * self._samples.spacing and not usual.all():
                places, usual = np.arange(low, high), np.ones(high - low, dtype=bool)
            if not usual.any():
                continue
            at = np.broadcast_to(
                one.formula.evaluate({"t": t + h * self._stages}), self._stages.shape
            )
            told = at @ self._basis.values((one.times[places] - t) / h)
            off = np.abs(one.values[places] - told)
            yield self._samples.spacing * _far_off(off, float(np.median(off[usual])))

    def _along(self, path: StepPath, seen: PointForces) -> float:
        """The impulse that the step misses of forces of the motion, along its own path."""
        count = math.ceil(PLACES * path.size / self._end)
        if count < 2 or self._between.forces.depend_on_time_only:
            return 0.0
        off = self._between.forces_off(path, seen, (np.arange(count) + 0.5) / count)
        return path.size / count * _far_off(off, float(np.median(off)))


def _far_off(off: Array, usual: float) -> float:
    """The sum of differences that are far beyond the usual one."""
    return float(off[~(off <= BEYOND * usual)].sum())
