"""Examination of a solved step before it is accepted.

Samples of a step miss walls and pulses that are narrower than the distance of its points. Where
these are, the range of the force over the step, by interval arithmetic, is large. Parts of the step
whose range is far beyond the samples are halved, and sampled, until they are too short to matter or
the wall or pulse is found.

A step that crosses a kink (an argument of ``abs`` or ``sign`` is zero there, or both arguments of
``min`` or ``max`` are equal) is repeated so that it ends there; steps on either side see a smooth
force and have their full order.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.defect import (
    BETWEEN_SHARE,
    ON_KINK,
    Between,
    StepPath,
    stiff_modes,
)
from fvi_cli.integrator.local_error.forces import PointForces, SceneForces
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.brackets import bracketed_roots
from fvi_cli.mathematics.intervals.functions import Interval, hull
from fvi_cli.mathematics.intervals.traced import BEYOND_SEEN, MARGIN, Traced

FIRST_PARTS = 8  # of a step, before any halving
MOST_PARTS = 256  # kept after a halving, those with the largest effect
MOST_HALVINGS = 48  # then the force may be infinite
SAMPLES: Final = 9  # of each part, where walls are looked for
OF_LARGEST = 0.02
"""Ranges up to this share of the largest force of the run so far do not count."""
NEGLIGIBLE = 0.01
"""Parts whose largest effect is less than this share of what may hide are left alone."""


class HiddenSearch:
    """Searches the steps of one run; the largest force so far is what counts as usual."""

    def __init__(self, between: Between, final_time: float) -> None:
        self._between, self._final_time = between, final_time
        self.largest = 0.0

    def search(
        self, path: StepPath, seen: PointForces, tolerance: float
    ) -> tuple[float, float | None]:
        """Search for forces between the samples of a step that matter for the tolerance, a length.

        With the forces at the places of the step; the tolerance is a length. How far what was found
        moves the scene until the end, 0 where nothing was, and a time at which the force may be
        infinite.
        """
        low, high = seen.force.min(axis=0), seen.force.max(axis=0)
        largest = float(np.abs(seen.force).max())
        self.largest = max(self.largest, largest)
        permitted = BEYOND_SEEN * (high - low) + OF_LARGEST * self.largest
        # a force F in a part of length d moves F / M d h (T - t) by the end of the run
        left = self._final_time - path.begin
        counts = self._between.mobility_of(path) * path.size * left
        edges = np.linspace(0.0, 1.0, FIRST_PARTS + 1)
        begin, end = edges[:-1], edges[1:]
        error, infinite = 0.0, None
        with np.errstate(all="ignore"):
            # at its ends a step may lie on a kink, where the force has two values
            missed = self._between.missed(seen)[1:-1]
            if (missed.max(axis=0) > BETWEEN_SHARE * (high - low)).any():
                # a few points have met something, and the others do not see how wide it is
                error = counts * float(missed.max(axis=1).mean())
                if error > tolerance:
                    return error, None
            for halving in range(MOST_HALVINGS):
                beyond = self._beyond(path, begin, end, low, high, permitted)
                effect = counts * (end - begin) * beyond
                suspect = np.flatnonzero(effect > NEGLIGIBLE * tolerance)
                if suspect.size == 0:
                    return error, None
                if suspect.size > MOST_PARTS:
                    suspect = suspect[np.argsort(effect[suspect])[-MOST_PARTS:]]
                begin, end = begin[suspect], end[suspect]
                middle = 0.5 * (begin + end)
                found = counts * (end - begin) @ self._missed(path, seen, middle)
                error = max(error, float(found) if math.isfinite(found) else math.inf)
                if error > tolerance:
                    return error, None
                if halving == MOST_HALVINGS - 1:
                    infinite = path.begin + path.size * float(middle[0])
                begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
        return error, infinite

    def _beyond(
        self,
        path: StepPath,
        begin: Array,
        end: Array,
        low: Array,
        high: Array,
        permitted: Array,
    ) -> Array:
        """By how much the range of the force on parts of the step goes beyond `low` and `high`."""
        n, forces = begin.size, self._between.forces
        boxes: list[Interval] = []
        rates: list[Interval] = []
        if not forces.depend_on_time_only:
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
        if forces.may_have_walls:
            # beside a larger force a wall is lost in the range of the whole
            places = begin[:, None] + (end - begin)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
            at, rate, times = self._between.path_at(path, places.ravel())
            undersampled = np.zeros(n, dtype=bool)
            traced = [
                [
                    Traced(hull(*one.T), one, undersampled)
                    for one in columns.T.reshape(-1, n, SAMPLES)
                ]
                for columns in (at, rate, times[:, None])
            ]
            total = np.maximum(total, forces.unseen(traced[0], traced[1], traced[2][0]))
        return total

    def _missed(self, path: StepPath, seen: PointForces, places: Array) -> Array:
        """Largest differences of the forces at more places from what was seen, ``(n,)``."""
        position, velocity, times = self._between.path_at(path, places)
        force = self._between.forces.at(position, velocity, times, path.middle).force
        missed = np.abs(force - self._between.interpolated(seen, places))
        return np.asarray(missed.max(axis=1))


def _box(values: Array) -> Interval:
    low, high = values.min(axis=0), values.max(axis=0)
    more = MARGIN * (high - low)
    return Interval(low - more, high + more)


MOST_CUTS = 12
"""Most times that a step is cut to end at a kink."""


class StepFinding(NamedTuple):
    """Result of the examination of a step."""

    error: float  # its local error, a length
    cut: float | None = None  # size with which it would end at a kink; None: it crosses none
    ends_on: int | None = None  # number of the kink at which it ends; None: at none
    # time at which the force may be infinite between all samples; None: nowhere
    unresolved_at: float | None = None


class Examiner:
    """Examines the steps of one run."""

    def __init__(self, scene: Scene, tables: StepTables, may_miss: float = math.inf) -> None:
        # Legendre coefficients of the velocity from U
        self._tail = (tables.to_legendre @ tables.slopes[1:].T)[-2:]
        self._forces = SceneForces(scene)
        self._stiff = stiff_modes(scene, tables.points.size)
        self._between = Between(self._forces, tables, self._stiff)
        self._hidden = HiddenSearch(self._between, scene.final_time)
        self._may_miss = may_miss
        self._starts_on: int | None = None
        self._cuts = 0

    def spectrum(self, unknowns: Array, size: float) -> float:
        """Local error from the last Legendre coefficients of the velocity, a length."""
        rates = self._tail @ unknowns
        if self._stiff is not None:
            rates = self._stiff.resolved(rates, size)
        before, last = np.maximum.reduce(np.abs(rates), axis=1).tolist()
        if not math.isfinite(before + last):
            return math.inf
        return float(size * last * min(1.0, last / (before + 1e-300)))

    def examine(
        self, path: StepPath, tolerance: float, *, fresh: bool, shortest: float
    ) -> StepFinding:
        """Examine a step.

        Hidden forces are searched for only if the local tolerance is kept. A fresh step begins
        where a force may be singular. Steps are not cut to less than the shortest.
        """
        error = self.spectrum(path.unknowns, path.size)
        if not math.isfinite(error) or self._forces.are_zero_at(path.middle):
            return StepFinding(error=error)
        seen = self._between.look(path)
        ends_on: int | None = None
        if seen.kinks.size:
            cut, ends_on = self._kink(path, seen.kinks, shortest)
            if cut is not None:
                return StepFinding(error=error, cut=cut)
        error = max(error, self._between.defect(path, seen, fresh=fresh))
        unresolved = None
        if error <= tolerance and self._forces.may_hide:
            may_miss = min(tolerance, self._may_miss)
            hidden, unresolved = self._hidden.search(path, seen, may_miss)
            error = max(error, hidden * (tolerance / may_miss))
        return StepFinding(error=error, ends_on=ends_on, unresolved_at=unresolved)

    def note_accepted(self, finding: StepFinding) -> None:
        """Note that the step is accepted."""
        self._starts_on = finding.ends_on
        self._cuts = 0

    def note_rejected(self) -> None:
        """Note that the step is rejected for its error: a shorter one may cross no kink."""
        self._cuts = 0

    def _kink(
        self, path: StepPath, kinks: Array, shortest: float
    ) -> tuple[float | None, int | None]:
        """Size up to the first kink that a step crosses, or the kink at which it ends."""
        places = self._between.places
        crossing = first_crossing(kinks, places, starts_on=self._starts_on)
        if crossing is None and self._cuts:
            crossing = self._crossing_beyond(path, kinks)
        if crossing is None:
            return None, None
        number, low, high = crossing

        def argument(_: Places, places: Array) -> Array:
            position, velocity, times = self._between.path_at(path, places)
            with np.errstate(all="ignore"):
                found = self._forces.at(position, velocity, times, path.middle).kinks[number]
            return np.asarray(found)

        one, ends = np.zeros(1, dtype=np.intp), np.array([[low], [high]])
        at_ends = argument(one, ends.ravel())[:, None]
        place = float(bracketed_roots(argument, one, *ends, *at_ends)[0])
        if abs(place - 1.0) <= AT_END or (self._cuts >= MOST_CUTS and place > 0.5):
            return None, number
        if place * path.size <= shortest or self._cuts >= MOST_CUTS:
            return None, None
        self._cuts += 1
        return place * path.size, None

    def _crossing_beyond(self, path: StepPath, kinks: Array) -> tuple[int, float, float] | None:
        """A kink at or after the end of a step that was cut too short."""
        nearest: tuple[int, float, float] | None = None
        position, velocity, times = self._between.path_at(path, BEYOND)
        with np.errstate(all="ignore"):
            found = self._forces.at(position, velocity, times, path.middle).kinks
        for number, values in enumerate(found):
            before = float(self._between.places[-2])
            value = float(kinks[number, -2])
            for place, following in zip(BEYOND, values, strict=True):
                if value * following < 0:
                    if nearest is None or before < nearest[1]:
                        nearest = (number, before, float(place))
                    break
        return nearest


AT_END = 1e-13
"""A kink that is this close to the end of a step, in steps, lies at the end."""
BEYOND = np.array([1.02, 1.1, 1.3])
"""Places to which a step that was cut too short is continued to find its kink."""


def first_crossing(
    arguments: Array, places: Array, *, starts_on: int | None
) -> tuple[int, float, float] | None:
    """The first kink that is crossed: its number and the places before and after it; or None.

    Arguments of the functions with kinks are ``(k, n)`` at places ``(n,)`` in [0, 1]; for
    the kink on which the step begins the sign at the beginning is ignored.
    """
    found: tuple[int, float, float] | None = None
    for number, values in enumerate(arguments):
        largest = float(np.abs(values).max())
        if not largest > 0 or not np.isfinite(values).all():
            continue
        begins_on = number == starts_on or abs(values[0]) <= ON_KINK * largest
        signs = np.sign(values[1:] if begins_on else values)
        at = places[1:] if begins_on else places
        changed = np.flatnonzero(signs[1:] * signs[:-1] < 0)
        if changed.size == 0:
            continue
        place = int(changed[0])
        if found is None or at[place] < found[1]:
            found = (number, float(at[place]), float(at[place + 1]))
    return found
