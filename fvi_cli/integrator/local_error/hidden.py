"""What no sample of a step sees: walls and pulses that are narrower than its points lie apart.

The range of the force over the step, by interval arithmetic, is large wherever such a thing is.
Parts of the step whose range is far beyond what was seen are halved, and sampled, until they are
too short to matter or the thing itself is met.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.local_error.defect import BETWEEN_SHARE, Between, StepPath
from fvi_cli.integrator.local_error.forces import PointForces
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.intervals.interval import Interval
from fvi_cli.mathematics.intervals.traced import BEYOND_SEEN, MARGIN

FIRST_PARTS = 8
MOST_PARTS = 256
MOST_HALVINGS = 48
OF_LARGEST = 0.02
"""Ranges up to this share of the largest force of the run so far are none."""
NEGLIGIBLE = 0.01
"""Parts whose largest effect is less than this share of the tolerance are left alone."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """What a search in a step came to."""

    error: float = 0.0  # local error by what was found, a length; 0: nothing was
    unresolved_at: float | None = None  # time at which the force may be infinite; None: nowhere


class HiddenSearch:
    """Searches the steps of one run; the largest force so far is what counts as usual."""

    def __init__(self, between: Between) -> None:
        self._between = between
        self.largest = 0.0

    def search(self, path: StepPath, seen: PointForces, tolerance: float) -> Hidden:
        """Look for forces between the samples of a step that matter beside the tolerance.

        With the forces at the places of the step; the tolerance is a length.
        """
        low, high = seen.force.min(axis=0), seen.force.max(axis=0)
        largest = float(np.abs(seen.force).max())
        self.largest = max(self.largest, largest)
        permitted = BEYOND_SEEN * (high - low) + OF_LARGEST * self.largest
        # a force F on a part of length d moves F / M d h by the end of the step
        counts = self._between.mobility_of(path) * path.size**2
        edges = np.linspace(0.0, 1.0, FIRST_PARTS + 1)
        begin, end = edges[:-1], edges[1:]
        error, infinite = 0.0, None
        with np.errstate(all="ignore"):
            for halving in range(MOST_HALVINGS):
                beyond = self._beyond(path, begin, end, low, high, permitted)
                effect = counts * (end - begin) * beyond
                suspect = np.flatnonzero(effect > NEGLIGIBLE * tolerance)
                if suspect.size == 0:
                    return Hidden(error=error)
                if suspect.size > MOST_PARTS:
                    suspect = suspect[np.argsort(effect[suspect])[-MOST_PARTS:]]
                begin, end = begin[suspect], end[suspect]
                middle = 0.5 * (begin + end)
                error = max(error, self._missed(path, seen, middle))
                if error > tolerance:
                    return Hidden(error=error)
                if halving == MOST_HALVINGS - 1:
                    infinite = path.begin + path.size * float(middle[0])
                begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        return Hidden(error=error, unresolved_at=infinite)

    def _beyond(
        self,
        path: StepPath,
        begin: Array,
        end: Array,
        low: Array,
        high: Array,
        permitted: Array,
    ) -> Array:
        """By how much the range of the force on parts of the step goes beyond what was seen."""
        n, forces = begin.size, self._between.forces
        boxes: list[Interval] = []
        rates: list[Interval] = []
        if not forces.is_of_time:
            places = np.concatenate([begin, 0.5 * (begin + end), end])
            position, velocity, _ = self._between.path_at(path, places)
            boxes = [_box(column.reshape(3, n)) for column in position.T]
            rates = [_box(column.reshape(3, n)) for column in velocity.T]
        time = Interval(path.begin + path.size * begin, path.begin + path.size * end)
        total = np.zeros(n)
        for i, one in forces.enclosed(boxes, rates, time, path.middle):
            excess = np.maximum(one.high - high[i], low[i] - one.low)
            excess = np.where(np.isnan(excess), math.inf, excess)
            total = np.maximum(total, np.where(excess > permitted[i], excess, 0.0))
        return total

    def _missed(self, path: StepPath, seen: PointForces, places: Array) -> float:
        """Local error by the forces at more places."""
        position, velocity, times = self._between.path_at(path, places)
        force = self._between.forces.at(position, velocity, times, path.middle).force
        missed = np.abs(force - self._between.interpolated(seen, places)).max()
        found = BETWEEN_SHARE * path.size**2 * self._between.mobility_of(path) * float(missed)
        return found if math.isfinite(found) else math.inf


def _box(values: Array) -> Interval:
    low, high = values.min(axis=0), values.max(axis=0)
    more = MARGIN * (high - low)
    return Interval(low - more, high + more)
