"""The steps of a run with impacts: flights, what ends them, and when a motion has come to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import astuple

import numpy as np

from fvi_cli.integrator.engine.checkpoint import RunKeeper
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.observations.isolation import FormulaAlong, first_below
from fvi_cli.integrator.observations.surface import (
    ROUND_OFF,
    Contact,
    Fall,
    Surface,
    is_rough_behind_impacts,
    power_behind_impact,
    step_ends,
    velocity_at_end,
)
from fvi_cli.integrator.run.loop import Course
from fvi_cli.integrator.run.setup import RunSetup, first_marker
from fvi_cli.integrator.run.unfinished import CourseKeeper
from fvi_cli.integrator.steps.dynamics import General
from fvi_cli.integrator.steps.step import StepResult
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9
"""Flights between rebounds shorter than this, relative to T, are the beginning of endless ones."""
SWEEPS = 60
MOST_PUSHES = 1000
"""Pushes in a corner: surfaces at a sharp angle push many times."""
START, IMPACT, BREAK = range(3)
"""What lies at the begin of a flight."""
LEAST_IN_ULPS = 256
"""Steps behind an impact are no shorter than so many units in the last place of its time."""


_NO_CONTACT = Contact(math.nan, math.nan, math.nan, math.nan)
_ONE_STEP = np.zeros(2, dtype=np.intp)
_ENDS = np.array([0.5, 1.0])


class Bouncing:
    """The steps of a run with impacts."""

    def __init__(
        self,
        setup: RunSetup,
        surfaces: Mapping[str, Surface],
        n_steps: int,
        shortest: float,
        checkpoints: RunKeeper | None,
    ) -> None:
        self._setup, self._surfaces = setup, surfaces
        self._end = setup.scene.final_time
        self._step, self._shortest = self._end / n_steps, shortest
        self._basis = lobatto_basis(setup.method.degree)
        self._is_rough = is_rough_behind_impacts(setup.scene)
        self.marker = first_marker(setup)
        self.course = Course.begun(self.marker)
        self.jumps = [np.zeros(setup.scene.dimension)]
        self.times: dict[str, list[float]] = {name: [] for name in surfaces}
        self.rest = ""
        self.contacts: dict[str, Contact] = {}
        self._passed, self._behind, self._begin = 0, START, 0.0
        asked = (setup.method.case, n_steps, self._step)
        given = (setup.scene, setup.method, tuple(surfaces.items()), shortest)
        needs = tuple(self._state())
        self.keeper = CourseKeeper(checkpoints, self.marker, self.course, asked, given, needs)
        if self.keeper.found:
            self._restore(self.keeper.found)

    def _state(self) -> dict[str, Array]:
        """What the steps to come depend on beside points and marker."""
        impacts = {f"impacts_{k}": np.array(one) for k, one in enumerate(self.times.values())}
        place = np.array([self._passed, self._behind, self._begin])
        contacts = [astuple(self.contacts.get(name, _NO_CONTACT)) for name in self._surfaces]
        kept = {"jumps": np.array(self.jumps), "place": place, "contacts": np.array(contacts)}
        return {**kept, **impacts}

    def _restore(self, found: Mapping[str, Array]) -> None:
        self.jumps = list(found["jumps"])
        passed, behind, self._begin = found["place"].tolist()
        self._passed, self._behind = int(passed), int(behind)
        for name, kept in zip(self._surfaces, found["contacts"].tolist(), strict=True):
            if not math.isnan(kept[0]):
                self.contacts[name] = Contact(*kept)
        for k, times in enumerate(self.times.values()):
            times += found[f"impacts_{k}"].tolist()

    def march(self) -> None:
        """To the end of the run, to rest, or to a failure."""
        scene = self._setup.scene
        ends = [*scene.break_points, self._end]
        while self._passed < len(ends) and not self.rest and not self.course.failure:
            power = start_power(scene, at_start=self._behind == START)
            if self._behind == IMPACT:
                power = power_behind_impact(scene)
            if self._to(ends[self._passed], power):
                self._behind = IMPACT
            else:
                self._behind = BREAK
                self._passed += 1
            self._begin = self.marker.time
        if not self.rest and not self.course.failure:
            self.keeper.offer(self._state, has_ended=True)

    def _to(self, end: float, power: float | None) -> bool:
        """The steps of a flight to a time, or the rest of them; whether an impact stopped it."""
        begin = self._begin
        least = LEAST_IN_ULPS * math.ulp(begin) if begin else 0.0
        is_first = self.marker.time == begin
        if is_first:
            self.marker.unknowns = None
        for place in step_ends(self._step, end - begin, self._setup.method.degree, power, least):
            target = min(begin + place, end)
            if target <= self.marker.time:
                continue
            size = target - self.marker.time if is_first else self._size(target)
            hit = self._advance(size, target, fresh=is_first)
            is_first = False
            if self.course.failure or self.rest:
                return False
            if hit:
                return True
            self.keeper.offer(self._state)
        return False

    def _size(self, target: float) -> float:
        """The size of a step; of nearly equal ones the same, so that matrices are shared."""
        size = target - self.marker.time
        exact = self._step * 2.0 ** round(math.log2(size / self._step))
        return exact if abs(exact - size) <= 4.0 * math.ulp(target) else size

    def _advance(self, size: float, target: float, *, fresh: bool) -> bool:
        """One step, or the part of it up to an impact."""
        stepper, marker = self._setup.stepper, self.marker
        try:
            result = stepper.attempt(marker, size, fresh=fresh)
            fall = self._first_fall(result, size)
            if fall is None:
                self._accept(result, size, target)
                return False
            name = fall.surface
            if fall.root * size <= self._shortest:
                if name in self.contacts:
                    self._end_in_rest(fall, size)
                    return False
                self._bounce(name)
                return not self.course.failure
            if self._is_endless(fall, size):
                self._end_in_rest(fall, size)
                return False
            size, result, gap = self._landed(fall, size)
        except StepFailedError as error:
            self.course.note(error.residuals)
            self.course.failure = Failure(f"t = {marker.time:.6g}: {error}", time=marker.time)
            return False
        tolerance = self._tolerance(name, result, size)
        if gap < -tolerance:
            self.course.failure = Failure(
                f"t = {marker.time:.6g}: the step to {name} has no end on it", time=marker.time
            )
            return False
        self._accept(result, size, marker.time + size)
        if not self.course.failure and gap <= tolerance:
            self._bounce(name)
        return not self.course.failure

    def _accept(self, result: StepResult, size: float, target: float) -> None:
        course, marker = self.course, self.marker
        course.note(result.residuals)
        left = [name for name in self.contacts if self._rises(name, result, size)]
        self._setup.stepper.accept(marker, result, size, target)
        course.add(marker, result, size)
        self.jumps.append(np.zeros(marker.position.value.size))
        for name in left:
            del self.contacts[name]
        if not np.isfinite(marker.position.value).all():
            course.failure = Failure.not_finite(len(course.sizes) - 1, target)

    def _along(self, surface: Surface, result: StepResult, size: float) -> FormulaAlong:
        """The gap along a step."""
        begin, start = self.marker.position.value, self.marker.time

        def variables(_: Places, tau: Array) -> dict[str, Array | float]:
            way = self._basis.values(tau)[1:].T @ result.unknowns
            return surface.values(begin + size * way, start + tau * size)

        return FormulaAlong(surface.impact.when, variables)

    def _tolerance(self, name: str, result: StepResult, size: float) -> float:
        """Gaps in a step smaller than this are not told from 0."""
        marker, contact = self.marker, self.contacts.get(name)
        reach = size * np.abs(result.unknowns).max(axis=0)
        end = marker.time + size
        found = self._surfaces[name].round_off(marker.position.value, reach, end)
        if contact is None:
            return found
        # a wall along which the motion slides: its speed is zero up to round-off
        return found + contact.slack + ROUND_OFF * contact.pace * (end - contact.time)

    def _rises(self, name: str, result: StepResult, size: float) -> bool:
        """Whether a step leaves a surface that the motion was on."""
        along = self._along(self._surfaces[name], result, size)
        return bool(max(along(_ONE_STEP, _ENDS)) > self._tolerance(name, result, size))

    def _first_fall(self, result: StepResult, size: float) -> Fall | None:
        """Where a step first goes through a surface, by more than round-off."""
        first: Fall | None = None
        for name, surface in self._surfaces.items():
            along = self._along(surface, result, size)
            tolerance = self._tolerance(name, result, size)
            found = first_below(along, -tolerance)
            if found is None:
                continue
            top, below, root, gap = found
            if first is None or root < first.root:
                first = Fall(surface=name, root=root, top=top, below=below, gap=gap)
        return first

    def _landed(self, fall: Fall, size: float) -> tuple[float, StepResult, float]:
        """The step that ends on a surface, or as near above it as there is one, and its gap.

        Newton's iteration on its length, and bisection where that leaves the part of the step
        in which the gap changes its sign.
        """
        stepper, marker, surface = self._setup.stepper, self.marker, self._surfaces[fall.surface]
        low, high = fall.top * size, min(fall.below, 1.0) * size
        now = fall.root * size
        best: tuple[float, StepResult, float] | None = None
        for _ in range(SWEEPS):
            result = stepper.attempt(marker, now, fresh=False)
            position = marker.position.value + now * result.unknowns[-1]
            time = marker.time + now
            gap = float(surface.gap(position, time))
            is_better = best is None or abs(gap) < abs(best[2])
            if (
                best is not None
                and not is_better
                and abs(best[2]) <= self._tolerance(fall.surface, best[1], best[0])
            ):
                break
            if best is None or is_better:
                best = now, result, gap
            if gap > 0.0:
                low = now
            else:
                high = now
            speed = self._speed(
                surface, position, marker.momentum.value + result.momentum_change, time
            )
            following = now - gap / speed if speed else now
            if not low < following < high:
                following = 0.5 * (low + high)
            if gap == 0.0 or abs(following - now) <= 0.5 * math.ulp(now):
                break
            now = following
        if best is None:  # pragma: no cover - the first sweep sets it
            raise ValueError("landed: no sweep was made")
        return best

    def _speed(self, surface: Surface, position: Array, momentum: Array, time: float) -> float:
        """Derivative of the gap by time along the motion."""
        normal, rate = surface.slopes(position, time)
        velocity = self._setup.stepper.solver.dynamics.velocity(position, momentum, time)
        return float(normal @ velocity) + rate

    def _bounce(self, met: str) -> None:
        """Reverse the normal velocity at every surface that is met here.

        In a corner the surfaces push one after the other, the one that is met fastest first,
        until the motion leaves them all.
        """
        marker, dynamics = self.marker, self._setup.stepper.solver.dynamics
        position, time = marker.position.value, marker.time
        wrong = self._momentum_error()
        momentum = marker.momentum.value - wrong
        total = np.zeros_like(momentum)
        here, begun = {met: 0.0}, 0.0
        reach = np.zeros_like(position)
        if self.course.sizes:
            reach = self.course.sizes[-1] * np.abs(self.course.unknowns[-1]).max(axis=0)
        for name, surface in self._surfaces.items():
            gap = float(surface.gap(position, time))
            speed = self._speed(surface, position, momentum, time)
            slack = surface.round_off(position, reach, time)
            if name == met or abs(gap) <= slack + abs(speed) * self._shortest:
                here[name] = slack + 4.0 * abs(gap)
                begun = max(begun, -speed)
        slopes = {name: self._surfaces[name].slopes(position, time) for name in here}
        normals = {name: normal for name, (normal, _) in slopes.items()}
        mobility = {name: self._mobility(normal) for name, normal in normals.items()}
        pushed: set[str] = set()
        for _ in range(MOST_PUSHES):
            speeds = {
                name: self._speed(self._surfaces[name], position, momentum + total, time)
                for name in here
            }
            name = min(here, key=lambda one: speeds[one] / _length(normals[one], mobility[one]))
            if speeds[name] >= -1e-14 * begun:
                break
            restitution = self._surfaces[name].impact.restitution
            weight = float(normals[name] @ mobility[name])
            total = total - (1.0 + restitution) * speeds[name] / weight * normals[name]
            pushed.add(name)
        if not np.isfinite(total).all():
            self.course.failure = Failure(
                f"t = {time:.6g}: the push of {met} is not finite", "not finite", time=time
            )
            return
        marker.momentum.add(total)
        marker.unknowns = None
        self.jumps[-1] = self.jumps[-1] + total
        self.course.momenta[-1] = marker.momentum.value.copy()
        for name in here:
            if name in pushed or name == met:
                self.times[name].append(time)
            normal, rate = slopes[name]
            velocity = dynamics.velocity(position, momentum + total, time)
            self.contacts[name] = Contact(
                time=time,
                slack=here[name],
                speed=max(float(normal @ velocity) + rate, 0.0),
                pace=float(np.abs(normal) @ np.abs(velocity)) + abs(rate),
            )

    def _momentum_error(self) -> Array:
        """What the momentum before the pushes at this point has too much."""
        course = self.course
        wrong = np.zeros_like(self.jumps[-1])
        if not self._is_rough or not course.sizes:
            return wrong
        count = 2 if len(course.sizes) > 1 and course.times[-2] > self._begin else 1
        velocity = velocity_at_end(
            course.times[-count:],
            course.sizes[-count:],
            [self._setup.stepper.velocity_of(one) for one in course.unknowns[-count:]],
            self._setup.stepper.solver.tables.points,
            self.marker.time,
        )
        before = self.marker.momentum.value - self.jumps[-1]
        dynamics = self._setup.stepper.solver.dynamics
        right = dynamics.momentum(self.marker.position.value, velocity, self.marker.time)
        return np.asarray(before - right)

    def _mobility(self, normal: Array) -> Array:
        """Inverse of the mass matrix times a normal."""
        dynamics = self._setup.stepper.solver.dynamics
        if not isinstance(dynamics, General):
            return dynamics.inertia.velocity(normal)
        marker = self.marker
        position, momentum = marker.position.value, marker.momentum.value
        velocity = dynamics.velocity(position, momentum, marker.time)
        at = dynamics.lagrangian.derivatives(position, velocity, marker.time)
        return np.asarray(np.linalg.solve(at.mass, normal))

    def _is_endless(self, fall: Fall, size: float) -> bool:
        """Whether a fall is the next of endless rebounds: its flight is short, and they shrink."""
        contact = self.contacts.get(fall.surface)
        if contact is None or self._surfaces[fall.surface].impact.restitution == 1.0:
            return False
        return self.marker.time - contact.time + fall.root * size < SHORTEST_FLIGHT * self._end

    def _end_in_rest(self, fall: Fall, size: float) -> None:
        """End the run on a surface that it does not leave by more than round-off."""
        name, contact = fall.surface, self.contacts[fall.surface]
        begin, speed = contact.time, contact.speed
        restitution = self._surfaces[name].impact.restitution
        if restitution == 0.0 or speed == 0.0:
            self.rest = f"at rest on {name} from t = {begin:.10g} on: it does not bounce"
            return
        # the fall from the contact on says the acceleration, and with it the flights
        since = self.marker.time - begin + fall.below * size
        flight = min(since, 2.0 * speed * since**2 / max(2.0 * (speed * since - fall.gap), 1e-300))
        end = begin + (flight / (1.0 - restitution) if restitution < 1.0 else 0.0)
        count = len(self.times[name])
        self.rest = (
            f"at rest on {name} from t = {end:.10g} on: after {count} impacts the next come "
            f"within {flight:.2g}"
        )


def _length(normal: Array, mobility: Array) -> float:
    return math.sqrt(float(normal @ mobility)) or 1.0
