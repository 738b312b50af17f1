"""Two looks for forces that act between the points of a step.

A force F that acts unseen for a time d moves a scene by F d (T - t) / M until its end. Formulas of
the time are sampled once a scene; forces of the motion are evaluated along the path of every step.
The sum over those samples that a step's own interpolation misses by far is what the step may miss.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from fvi_cli.effects.forcing import formula_of
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.defect import Between, StepPath
from fvi_cli.integrator.local_error.forces import PointForces, may_hide
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.expressions import Expression

SAMPLES: Final = 65_536  # times of a run at which formulas of the time are sampled
PLACES: Final = 8_192  # places of a run at which forces of the motion are evaluated
EVERY: Final = 64
"""A spline through every so many samples tells most of the others; these are left out."""
TOLD: Final = 1e-6
"""A sample is told by the spline up to this share of the largest."""
BEYOND: Final = 10.0
"""Samples count that are missed by more than so many times the median of their step."""
AT_ENDS: Final = 1e-9
"""Samples so close to an end of a step, in steps, are left out: the force may jump there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SampledFormula:
    """A formula of the time in one piece of a force."""

    formula: Expression
    begin: float  # where the piece begins and ends
    end: float
    times: Array  # of the samples, ascending, and the values there
    values: Array
    kept: Places  # samples that are left where most are told by a spline
    is_coarse: Mask  # which of these the spline goes through


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceSamples:
    """Samples of the formulas of the time of a scene that may hide a pulse."""

    spacing: float
    formulas: tuple[SampledFormula, ...]


def sample_forces(scene: Scene) -> ForceSamples:
    """Sample the force of a scene; values that are not finite are left out."""
    spacing, begin, found = scene.final_time / SAMPLES, 0.0, []
    for piece in () if scene.forcing is None else scene.forcing.pieces:
        for component, _ in piece.distinct:
            formula = formula_of(component)
            if formula is None or not may_hide(formula.system):
                continue
            first, last = np.rint(
                np.array([begin, piece.until]).clip(0, scene.final_time) / spacing
            )
            inside = spacing * (np.arange(first, last) + 0.5)
            with np.errstate(all="ignore"):
                values = np.broadcast_to(formula.evaluate({"t": inside}), inside.shape)
            is_finite = np.isfinite(values)
            times, values = inside[is_finite], values[is_finite]
            kept, is_coarse = _not_told(times, values)
            found.append(
                SampledFormula(
                    formula=formula,
                    begin=begin,
                    end=piece.until,
                    times=times,
                    values=values,
                    kept=kept,
                    is_coarse=is_coarse,
                )
            )
        begin = piece.until
    return ForceSamples(spacing=spacing, formulas=tuple(found))


def _not_told(times: Array, values: Array) -> tuple[Places, Mask]:
    """Samples with a spline through some of them, and those that it does not tell."""
    is_coarse = np.zeros(times.size, dtype=bool)
    is_coarse[::EVERY] = True
    is_coarse[-1:] = True
    if is_coarse.sum() < 4:
        return np.arange(times.size), np.ones(times.size, dtype=bool)
    told = CubicSpline(times[is_coarse], values[is_coarse])(times)
    kept = np.flatnonzero(is_coarse | (np.abs(told - values) > TOLD * np.abs(values).max()))
    return kept, is_coarse[kept]


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
