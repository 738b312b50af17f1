"""What is known of a solved step before it is believed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.defect import Between, StepPath
from fvi_cli.integrator.local_error.forces import SceneForces
from fvi_cli.integrator.local_error.hidden import HiddenSearch
from fvi_cli.integrator.local_error.kinks import (
    AT_END,
    BEYOND,
    first_crossing,
    root_between,
)
from fvi_cli.integrator.local_error.stiff_modes import stiff_modes
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array

MOST_CUTS = 12
"""Times that a step is cut to end at a kink."""


@dataclass(frozen=True, kw_only=True)
class StepFinding:
    """What was found out about a step."""

    error: float  # its local error, a length
    cut: float | None = None  # size with which it would end at a kink; None: it crosses none
    ends_on: int | None = None  # number of the kink at which it ends; None: at none
    # time at which the force may be infinite between all samples; None: nowhere
    unresolved_at: float | None = None


class Examiner:
    """Examines the steps of one run."""

    def __init__(self, scene: Scene, tables: StepTables) -> None:
        # Legendre coefficients of the velocity from U
        self._tail = (tables.to_legendre @ tables.slopes[1:].T)[-2:]
        self._forces = SceneForces(scene)
        self._stiff = stiff_modes(scene, tables.points.size)
        self._between = Between(self._forces, tables, self._stiff)
        self._hidden = HiddenSearch(self._between)
        self._starts_on: int | None = None
        self._cuts = 0

    @property
    def state(self) -> tuple[float, ...]:
        """What the examination of steps behind an accepted one depends on."""
        return (self._hidden.largest, -1 if self._starts_on is None else self._starts_on)

    def restore(self, largest: float, starts_on: float) -> None:
        """Go on behind an accepted step."""
        self._hidden.largest = largest
        self._starts_on = None if starts_on < 0 else int(starts_on)

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
        """Look at a step.

        Of steps that keep the local tolerance more is looked at; a fresh one begins where a force
        may be singular. Steps are not cut to less than the shortest.
        """
        error = self.spectrum(path.unknowns, path.size)
        if not math.isfinite(error) or self._forces.are_absent_at(path.middle):
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
            hidden = self._hidden.search(path, seen, tolerance)
            error, unresolved = max(error, hidden.error), hidden.unresolved_at
        return StepFinding(error=error, ends_on=ends_on, unresolved_at=unresolved)

    def go_on(self, finding: StepFinding) -> None:
        """The step is accepted."""
        self._starts_on = finding.ends_on
        self._cuts = 0

    def give_up_cuts(self) -> None:
        """The step is rejected for its error: a shorter one may cross no kink."""
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

        def argument(place: float) -> float:
            position, velocity, times = self._between.path_at(path, np.array([place]))
            with np.errstate(all="ignore"):
                found = self._forces.at(position, velocity, times, path.middle)
            return float(found.kinks[number, 0])

        place = root_between(argument, low, high)
        if abs(place - 1.0) <= AT_END or (self._cuts >= MOST_CUTS and place > 0.5):
            return None, number
        if place * path.size <= shortest or self._cuts >= MOST_CUTS:
            return None, None
        self._cuts += 1
        return place * path.size, None

    def _crossing_beyond(self, path: StepPath, kinks: Array) -> tuple[int, float, float] | None:
        """A kink at or behind the end of a step that was cut too short."""
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
