"""Steps of a run with impacts: flights, what ends them, and when a motion has come to rest."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.meshes.controller import SHORTEST_STEP
from fvi_cli.integrator.meshes.graded import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.formulas import FormulaAlong
from fvi_cli.integrator.observations.impacts.landing import Landing, SceneStep
from fvi_cli.integrator.observations.impacts.restitution import Restitution
from fvi_cli.integrator.observations.impacts.surface import Surface, power_behind_impact, step_ends
from fvi_cli.integrator.observations.search import Fall, first_fall
from fvi_cli.integrator.run.points import Proposal, why_unsolved
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9
"""A flight between impacts shorter than this, relative to T, is lost in the round-off of steps."""
MOST_IMPACTS = 10_000
"""Most impacts of a run."""
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
        self._step, self._shortest = self._end / n_steps, SHORTEST_STEP * self._end
        self._stops = [*scene.break_points, self._end]
        # the sum of the pushes at every point of the mesh, (d,) each; and, by the number of the
        # point, pushes that come after the step before it was recorded
        self.jumps = [np.zeros(scene.dimension)]
        self.late: dict[int, Array] = {}
        self.times: dict[str, list[float]] = {name: [] for name in surfaces}
        self.rests_on = ""  # surface on which the motion has come to rest
        self.failure: Failure | None = None
        self._touched: set[str] = set()  # surfaces that the motion has not left since an impact
        self._velocity = scene.initial_velocity  # at the end of the last step
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
        if self.failure is not None or self.rests_on or not self._targets:
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
        here = step.begin + fall.root * step.size
        is_here = here - step.begin <= self._shortest
        before = self.times[name][-1] if self.times[name] else -math.inf
        flight = here - before
        if flight <= SHORTEST_FLIGHT * self._end or (is_here and name in self._touched):
            # the flight is shorter than the round-off of its steps
            self.rests_on = name
        elif is_here:
            self._push_here(name, engine, state, step)
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
            speed = self._law.speed(name, step.end_position, self._end_velocity(step), step.end)
            if not landing.take(gap, speed, tolerance) or landing.size != step.size:
                return None
        if gap < -tolerance:
            self._fail(StepFailedError(f"the step to {name} has no end on it"))
            return None
        self._go_on(step, step.end)
        if gap <= tolerance:
            push = self._push(name, step.end_position)
            steps.dp = steps.dp + engine.member_forces([push])[:, None]
        self._begin_flight(IMPACT, self._passed)
        return step.end

    def _push_here(self, name: str, engine: Engine, state: State, step: SceneStep) -> None:
        """Push where the step begins: there a surface is met."""
        push, point = self._push(name, step.position), len(self.jumps) - 1
        self.late[point] = self.late.get(point, 0.0) + push
        own = engine.member_forces([push])
        state.p, state.p_lost = compensated(state.p, state.p_lost, own)
        self._begin_flight(IMPACT, self._passed)

    def _go_on(self, step: SceneStep, end: float) -> None:
        """Accept the step."""
        self._touched = {name for name in self._touched if not self._rises(name, step)}
        self.jumps.append(np.zeros(step.position.size))
        self._velocity = self._end_velocity(step)
        self._reach, self._time = self._reach_of(step), end

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

    def _tolerance(self, name: str, step: SceneStep) -> float:
        """Gaps in a step smaller than this count as 0: round-off of it and the step before."""
        surface, reach = self._surfaces[name], np.maximum(self._reach_of(step), self._reach)
        return 2.0 * surface.round_off(step.position, reach, step.end)

    def _reach_of(self, step: SceneStep) -> Array:
        """Largest terms of the displacements in a step, ``(d,)``."""
        velocity = self._law.scene.velocity(step.position, step.momentum, step.begin)
        return np.asarray(np.maximum(step.reach, step.size * np.abs(velocity)))

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

    def _push(self, met: str, position: Array) -> Array:
        """Change of the momentum by surfaces that are met here, ``(d,)``; the motion is on them."""
        time, law, velocity = self._time, self._law, self._velocity
        here = {met}
        for name, surface in self._surfaces.items():
            gap = float(surface.gap(position, time))
            speed = law.speed(name, position, velocity, time)
            slack = surface.round_off(position, self._reach, time)
            if abs(gap) <= slack + abs(speed) * self._shortest:
                here.add(name)
        push, pushing, self._velocity = law.push(sorted(here), position, velocity, time)
        if not np.isfinite(push).all():
            self._fail(StepFailedError(f"the impulse of {met} is not finite", reason="not finite"))
            return np.zeros_like(position)
        self.jumps[-1] = self.jumps[-1] + push
        self._touched |= here
        for name in pushing | {met}:
            self.times[name].append(time)
        if sum(map(len, self.times.values())) > MOST_IMPACTS:
            self._fail(StepFailedError(f"more than {MOST_IMPACTS} impacts"))
        return push

    def _end_velocity(self, step: SceneStep) -> Array:
        """The velocity at the end of a step."""
        # above order 1 that of its polynomial: momenta keep an error of the step behind an impact
        if not self._law.scene.acts_above_order_1:
            return self._law.scene.velocity(step.end_position, step.end_momentum, step.end)
        slopes = lobatto_basis(self._degree).derivatives([1.0])[1:, 0]
        return np.asarray(slopes @ step.unknowns)
