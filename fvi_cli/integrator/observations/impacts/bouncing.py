"""Steps of a run with impacts: flights, what ends them, and when a motion has come to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.meshes.adaptive import SHORTEST_STEP
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.formulas import FormulaAlong
from fvi_cli.integrator.observations.impacts.landing import Landing, SceneStep
from fvi_cli.integrator.observations.impacts.restitution import Restitution
from fvi_cli.integrator.observations.impacts.surface import (
    ROUND_OFF,
    Contact,
    Surface,
    is_rough_behind_impacts,
    power_behind_impact,
    step_ends,
)
from fvi_cli.integrator.observations.search import Fall, first_fall
from fvi_cli.integrator.results.momenta import velocities_near
from fvi_cli.integrator.run.points import Proposal, why_unsolved
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9
"""A flight between rebounds shorter than this, relative to T, is one of an endless series."""
UNRESOLVED_FLIGHT = 1e-4
"""So is one shorter than this, relative to T / N, if round-off keeps flights from shrinking."""
START, IMPACT, BREAK = range(3)
"""Places where a flight begins: the start, an impact, a break point."""
LEAST_IN_ULPS = 256
"""Shortest step after an impact, in units in the last place of its time."""

_ONE_STEP = np.zeros(2, dtype=np.intp)
_ENDS = np.array([0.5, 1.0])


class Bouncing:
    """Steps of T / N, graded after the start, break points and impacts, and cut there."""

    def __init__(
        self, scene: Scene, method: Method, n_steps: int, surfaces: Mapping[str, Surface]
    ) -> None:
        self._scene, self._surfaces = scene, surfaces
        self._law = Restitution(scene, surfaces)
        self._end, self._degree = scene.final_time, method.degree
        self._tables = step_tables(method)
        self._step, self._shortest = self._end / n_steps, SHORTEST_STEP * self._end
        self._is_rough = is_rough_behind_impacts(scene)
        self._stops = [*scene.break_points, self._end]
        # the sum of the pushes at every point of the mesh, (d,) each; and, by the number of the
        # point, pushes that come after the step before it was recorded
        self.jumps = [np.zeros(scene.dimension)]
        self.late: dict[int, Array] = {}
        self.times: dict[str, list[float]] = {name: [] for name in surfaces}
        self.rest = ""  # remark on a motion that has come to rest
        self.failure: Failure | None = None
        self._contacts: dict[str, Contact] = {}
        # the last two steps: ends, sizes, and velocities at the stages
        self._last: list[tuple[float, float, Array]] = []
        self._reach = np.zeros(scene.dimension)
        self._time = 0.0
        self._begin_flight(START, 0)

    # the source of steps

    def _begin_flight(self, behind: int, passed: int) -> None:
        """Go from here to the next break point or the end."""
        self._behind, self._passed, self._begin = behind, passed, self._time
        self._landing: Landing | None = None
        self._aim()

    def _aim(self) -> None:
        """Set the ends of the coming steps of the flight, the last first."""
        self._targets: list[float] = []
        if self._passed == len(self._stops):
            return
        end, begin = self._stops[self._passed], self._begin
        if self._behind == IMPACT:
            power = power_behind_impact(self._scene)
        else:
            power = start_power(self._scene, at_start=self._behind == START)
        least = LEAST_IN_ULPS * math.ulp(begin) if begin else 0.0
        ends = step_ends(self._step, end - begin, self._degree, power, least)
        targets = [min(begin + place, end) for place in reversed(ends)]
        self._targets = [one for one in targets if one > self._time]

    def propose(self) -> Proposal | None:
        """The next step of a flight, or a part of it that may end on a surface."""
        if self.failure is not None or self.rest or not self._targets:
            return None
        begin, is_first = self._time, self._time == self._begin
        if self._landing is not None:
            size = self._landing.size
        else:
            size = self._targets[-1] - begin
            size = size if is_first else self._shared(size)
        return Proposal(begin, size, 1, 1, is_first, begin)

    def _shared(self, size: float) -> float:
        """A nearly equal size that is T / N times a power of 2, so that tables are shared."""
        exact = self._step * 2.0 ** round(math.log2(size / self._step))
        return exact if abs(exact - size) <= 4.0 * math.ulp(self._time + size) else size

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The end of a step that meets no surface, or ends on one; None to try another one."""
        if steps.has_failed:
            self._fail(why_unsolved(steps, state))
            return None
        step = SceneStep.of(engine, state, steps)
        if self._landing is not None:
            return self._land(self._landing, engine, step, steps)
        met = self._first_fall(step)
        if met is None:
            end = self._targets.pop()
            self._go_on(step, end)
            if not self._targets:
                self._begin_flight(BREAK, self._passed + 1)
            return end
        name, fall = met
        is_here = fall.root * step.size <= self._shortest
        if is_here and name not in self._contacts:
            self._push_here(name, engine, state, step)
        elif is_here or self._is_endless(name, fall, step):
            self._end_in_rest(name, fall, step)
        else:
            self._landing = Landing(
                surface=name,
                low=fall.top * step.size,
                high=min(fall.below, 1.0) * step.size,
                size=fall.root * step.size,
            )
        return None

    def _fail(self, error: StepFailedError) -> None:
        words = f"t = {self._time:.6g}: {error}"
        self.failure = Failure(words, error.reason, time=self._time)

    def _land(
        self, landing: Landing, engine: Engine, step: SceneStep, steps: Steps
    ) -> float | None:
        """Try a step that ends nearer to the surface, or accept the nearest one."""
        name = landing.surface
        gap = float(self._surfaces[name].gap(step.end_position, step.end))
        tolerance = self._tolerance(name, step)
        if not landing.has_ended:
            speed = self._law.speed(name, step.end_position, self._end_momentum(step), step.end)
            if not landing.take(gap, speed, tolerance) or landing.size != step.size:
                return None
        if gap < -tolerance:
            times, restitution = self.times[name], self._surfaces[name].impact.restitution
            if (
                times
                and restitution < 1.0
                and step.end - times[-1] < UNRESOLVED_FLIGHT * self._step
            ):
                # the rebounds are lost in the round-off of the steps
                self._end_in_rest(name, Fall(1.0, 0.0, 1.0, gap), step)
                return None
            self._fail(StepFailedError(f"the step to {name} has no end on it"))
            return None
        self._go_on(step, step.end)
        if gap <= tolerance:
            push = self._push(name, step.end_position, step.end_momentum)
            steps.dp = steps.dp + engine.member_forces([push])[:, None]
        self._begin_flight(IMPACT, self._passed)
        return step.end

    def _push_here(self, name: str, engine: Engine, state: State, step: SceneStep) -> None:
        """Push where the step begins: there a surface is met."""
        push, point = self._push(name, step.position, step.momentum), len(self.jumps) - 1
        self.late[point] = self.late.get(point, 0.0) + push
        own = engine.member_forces([push])
        state.p, state.p_lost = compensated(state.p, state.p_lost, own)
        self._begin_flight(IMPACT, self._passed)

    def _go_on(self, step: SceneStep, end: float) -> None:
        """Accept the step."""
        for name in [one for one in self._contacts if self._rises(one, step)]:
            del self._contacts[name]
        self.jumps.append(np.zeros(step.position.size))
        velocity = self._tables.slopes[1:].T @ step.unknowns
        self._last = [*self._last[-1:], (end, step.size, velocity)]
        self._reach, self._time = self._moved(step), end

    # what a step meets

    def _along(self, name: str, step: SceneStep) -> FormulaAlong:
        """The gap along a step."""
        surface, basis = self._surfaces[name], lobatto_basis(self._degree)

        def variables(_: Places, tau: Array) -> dict[str, Array | float]:
            flat = tau.ravel()
            position = step.position + step.size * (basis.values(flat)[1:].T @ step.unknowns)
            found = surface.values(position, step.begin + flat * step.size)
            return {n: np.reshape(v, tau.shape) if np.ndim(v) else v for n, v in found.items()}

        return FormulaAlong(surface.impact.when, variables)

    def _moved(self, step: SceneStep) -> Array:
        """Largest terms of the displacements in a step, ``(d,)``.

        An error of a rough momentum and the force of the past that balances it may be much larger
        than the displacement.
        """
        if not self._is_rough:
            return step.reach
        velocity = self._law.scene.velocity(step.position, step.momentum, step.begin)
        return np.asarray(np.maximum(step.reach, step.size * np.abs(velocity)))

    def _tolerance(self, name: str, step: SceneStep) -> float:
        """Gaps in a step smaller than this count as 0."""
        contact = self._contacts.get(name)
        found = self._surfaces[name].round_off(step.position, self._moved(step), step.end)
        if contact is None:
            return found
        # a wall along which the motion slides: its speed is zero up to round-off
        return found + contact.slack + ROUND_OFF * contact.pace * (step.end - contact.time)

    def _rises(self, name: str, step: SceneStep) -> bool:
        """Whether a step leaves a surface that the motion was on."""
        gaps = self._along(name, step)(_ONE_STEP, _ENDS)
        return bool(max(gaps) > self._tolerance(name, step))

    def _first_fall(self, step: SceneStep) -> tuple[str, Fall] | None:
        """Which surface a step first goes through, by more than round-off, and where."""
        found = [
            (name, first_fall(self._along(name, step), self._tolerance(name, step)))
            for name in self._surfaces
        ]
        falls = [(name, one) for name, one in found if one is not None]
        return min(falls, key=lambda one: one[1].root) if falls else None

    # impacts

    def _push(self, met: str, position: Array, momentum: Array) -> Array:
        """Change of the momentum by surfaces that are met here, ``(d,)``; makes them contacts."""
        time, law = self._time, self._law
        momentum = momentum - self._momentum_error(position, momentum)
        here = {met: 0.0}
        for name, surface in self._surfaces.items():
            gap = float(surface.gap(position, time))
            speed = law.speed(name, position, momentum, time)
            slack = surface.round_off(position, self._reach, time)
            if name == met or abs(gap) <= slack + abs(speed) * self._shortest:
                here[name] = slack + 4.0 * abs(gap)
        push, pushing = law.push(list(here), position, momentum, time)
        if not np.isfinite(push).all():
            self._fail(StepFailedError(f"the impulse of {met} is not finite", reason="not finite"))
            return np.zeros_like(momentum)
        self.jumps[-1] = self.jumps[-1] + push
        velocity = law.scene.velocity(position, momentum + push, time)
        for name, slack in here.items():
            if name in pushing or name == met:
                self.times[name].append(time)
            normal, rate = self._surfaces[name].slopes(position, time)
            self._contacts[name] = Contact(
                time=time,
                slack=slack,
                speed=max(float(normal @ velocity) + rate, 0.0),
                pace=float(np.abs(normal) @ np.abs(velocity)) + abs(rate),
            )
        return push

    def _end_momentum(self, step: SceneStep) -> Array:
        """The momentum at the end of a step, from velocities where that of the method is rough."""
        if not self._is_rough:
            return step.end_momentum
        stages = self._tables.slopes[1:].T @ step.unknowns
        ends, sizes, at = np.array([[step.end]]), np.array([[step.size]]), np.array([step.end])
        (velocity,) = velocities_near(ends, sizes, stages[None, None], self._tables.points, at)
        return self._law.scene.momentum(step.end_position, velocity, step.end)

    def _momentum_error(self, position: Array, momentum: Array) -> Array:
        """Error of the momentum before the pushes at this point."""
        if not self._is_rough or not self._last:
            return np.zeros_like(momentum)
        last = self._last if self._last[0][0] > self._begin else self._last[-1:]
        ends, sizes, stages = (np.array(one)[None] for one in zip(*last, strict=True))
        at = np.array([self._time])
        (velocity,) = velocities_near(ends, sizes, stages, self._tables.points, at)
        right = self._law.scene.momentum(position, velocity, self._time)
        return np.asarray(momentum - self.jumps[-1] - right)

    # rest

    def _is_endless(self, name: str, fall: Fall, step: SceneStep) -> bool:
        """Whether a fall is one of endless rebounds: its flight is short, and flights shrink.

        Below the error of the momenta at impacts flights shrink no more, and would have no end.
        """
        contact, restitution = self._contacts.get(name), self._surfaces[name].impact.restitution
        times = self.times[name]
        if restitution == 1.0 or (contact is None and not times):
            return False
        since = contact.time if contact is not None else times[-1]
        flight = step.begin - since + fall.root * step.size
        if contact is not None and flight < SHORTEST_FLIGHT * self._end:
            return True
        # so many impacts shorten a flight to a quarter
        count = max(4, math.ceil(math.log(0.25) / math.log(restitution))) if restitution else 1
        if flight >= UNRESOLVED_FLIGHT * self._step or len(times) <= 2 * count:
            return False
        before, between, last = times[-1 - 2 * count], times[-1 - count], times[-1]
        return last - between > 0.5 * (between - before)

    def _end_in_rest(self, name: str, fall: Fall, step: SceneStep) -> None:
        """End the run on a surface that it does not leave by more than round-off."""
        contact, restitution = self._contacts.get(name), self._surfaces[name].impact.restitution
        begin = contact.time if contact is not None else self.times[name][-1]
        if restitution == 0.0 or (contact is not None and contact.speed == 0.0):
            self.rest = f"at rest on {name} from t = {begin:.10g} on: it does not bounce"
            return
        flight = step.begin - begin + fall.root * step.size
        if contact is not None:
            # the fall since the contact gives the acceleration, and with it the flights
            speed, since = contact.speed, step.begin - begin + fall.below * step.size
            flight = min(
                since, 2.0 * speed * since**2 / max(2.0 * (speed * since - fall.value), 1e-300)
            )
        end = begin + (flight / (1.0 - restitution) if restitution < 1.0 else 0.0)
        self.rest = (
            f"at rest on {name} from t = {end:.10g} on: after {len(self.times[name])} impacts the "
            f"next come within {flight:.2g}"
        )
