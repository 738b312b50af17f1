r"""A motion with impacts: where it meets a surface its normal velocity is reversed and scaled.

At a falling root of g(q, t) the momentum changes by a push along the normal,

.. math:: p^+ = p^- - (1 + e) \frac{\dot g}{\nabla g^T M^{-1} \nabla g} \nabla g, \qquad
   \dot g = \nabla g \cdot v + \partial_t g,

so that :math:`\dot g^+ = -e\, \dot g^-` (Newton's law of restitution). The states of the damping
are kept: the force remembers the motion before. After an impact the position has the power
:math:`3 - \gamma` of the time, and steps are graded towards it as towards the start.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.meshes.controller import MOST_SHORTEST, SHORTEST_STEP
from fvi_cli.integrator.meshes.graded import graded_start_mesh, start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.along import FormulaAlong
from fvi_cli.integrator.observe.observer import Impacted
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.integrator.observe.search import Fall, first_fall
from fvi_cli.integrator.observe.surface import Surface, push_off, start_objection
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.run.scenes_run import ScenesRun, trajectory_of
from fvi_cli.integrator.run.sources import Proposal, why_unsolved
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9  # share of T: shorter flights are lost in the round-off of their steps
MOST_IMPACTS = 10_000  # of a run
LEAST_IN_ULPS = 256  # shortest step after an impact, in units in the last place of its time
MOST_LANDINGS = 60  # steps that are tried to end on a surface: as many as bisection needs
START, IMPACT, BREAK = range(3)  # where a flight begins


def integrate_with_impacts(
    scene: Scene, method: Method, n_steps: int, request: Observations, *, diagnostics: bool = False
) -> tuple[Trajectory, Impacted]:
    """Integrate a scene with surfaces that it bounces off, by a Runge-Kutta method.

    Steps are T / N long, and shorter after the start, break points and impacts. All ends of steps
    are reported. Where the motion comes to rest on a surface the run ends, with a remark.

    Raises
    ------
    ValueError
        For a start behind a surface, or on it and moving through it.
    """
    began = clock.perf_counter()
    surfaces = {
        name: Surface(impact=one, coordinates=request.coordinates, parameters=request.parameters)
        for name, one in request.impacts.items()
    }
    for name, surface in surfaces.items():
        if objection := start_objection(scene, surface):
            raise ValueError(f"impacts.{name}: {surface.impact.when.text} {objection}")
    shortest = SHORTEST_STEP * scene.final_time
    engine = Engine([scene], method, shortest_step=shortest, steps=MOST_SHORTEST, is_single=True)
    source = Bouncing(scene, method, n_steps, surfaces)
    run = ScenesRun(engine, source, Recorder(engine, with_steps=True))
    run.begin()
    ready = clock.perf_counter()
    seconds = run.march()
    steps = run.recorder.steps(0)
    momentum, jump = steps.momentum.copy(), np.array(source.jumps[: steps.n_steps + 1])
    for point, push in source.late.items():
        # the run may have stopped before the push
        momentum[point : point + 1] += push
    steps = replace(steps, momentum=momentum, jump=jump if jump.any() else None)
    if jump.any() and scene.acts_above_order_1:
        steps = replace(steps, momentum=steps.momenta_of_polynomials(scene))
    if source.rests_on:
        run.remarks = (f"at rest from t = {steps.time[-1]:.10g}",)
    trajectory = trajectory_of(
        run,
        0,
        1,
        diagnostics,
        with_steps=True,
        seconds=(ready - began, seconds),
        bounced=steps,
        n_steps=n_steps,
    )
    times = {name: np.array(times) for name, times in source.times.items()}
    return trajectory, Impacted(times=times, rests_on=source.rests_on)


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneStep:
    """A solved step in the coordinates of the scene."""

    begin: float
    size: float
    position: Array  # at its beginning, (d,)
    end_position: Array
    end_velocity: Array
    unknowns: Array  # (s, d)
    reach: Array  # largest terms of the displacements, (d,)

    @property
    def end(self) -> float:
        """Time at its end."""
        return self.begin + self.size

    @classmethod
    def of(cls, engine: Engine, state: State, steps: Steps) -> SceneStep:
        """The step from one solved step of one scene."""
        (scene,), end = engine.scenes, state.t + steps.h
        x = np.stack([state.x, state.x + steps.dx[:, 0]], axis=1)
        p = np.stack([state.p, state.p + steps.dp[:, 0]], axis=1)
        x, p = engine.to_scene(x, p)
        unknowns = engine.scene_positions(steps.unknowns[:, 0])[0]
        velocity = scene.velocity(x[0, 1], p[0, 1], end)
        slopes = lobatto_basis(len(unknowns)).derivatives([0.0, 1.0])[1:].T @ unknowns
        # above order 1 that of its polynomial: momenta keep an error of the step behind an impact
        if scene.acts_above_order_1:
            velocity = slopes[1]
        return cls(
            begin=state.t,
            size=steps.h,
            position=x[0, 0],
            end_position=x[0, 1],
            end_velocity=velocity,
            unknowns=unknowns,
            reach=steps.h * np.abs([*unknowns, slopes[0]]).max(axis=0),
        )


@dataclass(kw_only=True, eq=False)
class Landing:
    """The search for the length of the step that ends on a surface."""

    surface: str
    low: float  # lengths between which the root lies
    high: float
    size: float  # length to try
    tried: int = 0
    best: tuple[float, float] = (0.0, math.inf)  # the length with the least gap, and that gap
    is_settled: bool = False  # whether the best length is taken

    def goes_on(self, gap: float, speed: float, tolerance: float) -> bool:
        """Whether another length is tried, by Newton's iteration within bisection."""
        if self.is_settled:
            return False
        now, self.tried = self.size, self.tried + 1
        is_worse = abs(gap) >= self.best[1]
        if not is_worse:
            self.best = now, abs(gap)
        self.low, self.high = (now, self.high) if gap > 0.0 else (self.low, now)
        self.size = now - gap / speed if speed else now
        if not self.low < self.size < self.high:
            self.size = 0.5 * (self.low + self.high)
        is_still = abs(self.size - now) <= 0.5 * math.ulp(now) or self.tried == MOST_LANDINGS
        if gap == 0.0 or is_still or (is_worse and self.best[1] <= tolerance):
            self.size, self.is_settled = self.best[0], True
        return self.size != now


class Bouncing:
    """The source of steps of T / N, graded after the start, break points and impacts."""

    def __init__(
        self, scene: Scene, method: Method, n_steps: int, surfaces: Mapping[str, Surface]
    ) -> None:
        self._scene, self._surfaces, self._degree = scene, surfaces, method.degree
        self._end, self._step = scene.final_time, scene.final_time / n_steps
        self._shortest = SHORTEST_STEP * self._end
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
        self._reach = np.zeros(scene.dimension)  # displacements in it
        self._time, self._passed = 0.0, 0  # break points that are passed
        self._landing: Landing | None = None
        self._begin_flight(START)

    def _begin_flight(self, behind: int) -> None:
        """Set the ends of the steps to the next break point or the end, the last first."""
        self._begin, self._landing, self._targets = self._time, None, list[float]()
        if self._passed == len(self._stops):
            return
        end, begin = self._stops[self._passed], self._begin
        if behind == IMPACT:
            power = power_behind_impact(self._scene)
        else:
            power = start_power(self._scene, at_start=behind == START)
        least = LEAST_IN_ULPS * math.ulp(begin) if begin else 0.0
        ends = step_ends(self._step, end - begin, self._degree, power, least)
        targets = [min(begin + place, end) for place in reversed(ends)]
        self._targets = [one for one in targets if one > begin]

    def propose(self) -> Proposal | None:
        """The next step of a flight, or a part of it that may end on a surface."""
        if self.failure is not None or self.rests_on or not self._targets:
            return None
        begin, is_first = self._time, self._time == self._begin
        size = self._targets[-1] - begin
        if self._landing is not None:
            size = self._landing.size
        elif not is_first:
            # a nearly equal size is T / N times a power of 2, so that tables are shared
            exact = self._step * 2.0 ** round(math.log2(size / self._step))
            size = exact if abs(exact - size) <= 4.0 * math.ulp(begin + size) else size
        return Proposal(begin, size, 1, 1, is_first, begin)

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The end of a step that meets no surface, or ends on one; None to try another one."""
        if steps.failed.any():
            self._fail(why_unsolved(steps, state))
            return None
        step = SceneStep.of(engine, state, steps)
        if self._landing is not None:
            return self._land(self._landing, engine, step, steps)
        found = [
            (name, fall)
            for name, one in self._surfaces.items()
            if (fall := first_fall(self._along(one, step), self._tolerance(one, step)))
        ]
        if not found:
            end = self._targets.pop()
            self._go_on(step, end)
            if not self._targets:
                self._passed += 1
                self._begin_flight(BREAK)
            return end
        self._meet(*min(found, key=lambda one: one[1].root), engine, state, step)
        return None

    def _meet(self, name: str, fall: Fall, engine: Engine, state: State, step: SceneStep) -> None:
        """A surface is met in a step: look for its end there, push here, or come to rest."""
        is_here = fall.root * step.size <= self._shortest
        before = self.times[name][-1] if self.times[name] else -math.inf
        flight = step.begin + fall.root * step.size - before
        if flight <= SHORTEST_FLIGHT * self._end or (is_here and name in self._touched):
            self.rests_on = name
        elif is_here:
            push, point = self._push(name, step.position), len(self.jumps) - 1
            self.late[point] = self.late.get(point, 0.0) + push
            own = engine.member_forces([push])
            state.p, state.p_lost = compensated(state.p, state.p_lost, own)
            self._begin_flight(IMPACT)
        else:
            low, high = fall.top * step.size, min(fall.below, 1.0) * step.size
            self._landing = Landing(surface=name, low=low, high=high, size=fall.root * step.size)

    def _land(
        self, landing: Landing, engine: Engine, step: SceneStep, steps: Steps
    ) -> float | None:
        """Try a step that ends nearer to the surface, or accept this one."""
        name, surface = landing.surface, self._surfaces[landing.surface]
        gap, tolerance = surface.gap(step.end_position, step.end), self._tolerance(surface, step)
        speed = surface.speed(step.end_position, step.end_velocity, step.end)
        if landing.goes_on(gap, speed, tolerance):
            return None
        # the motion goes on for a unit in the last place of the time
        if gap < -tolerance - abs(speed) * math.ulp(step.end):
            self._fail(StepFailedError(f"the step to {name} has no end on it"))
            return None
        self._go_on(step, step.end)
        if gap <= tolerance:
            push = self._push(name, step.end_position)
            steps.dp = steps.dp + engine.member_forces([push])[:, None]
        self._begin_flight(IMPACT)
        return step.end

    def _fail(self, error: StepFailedError) -> None:
        self.failure = Failure(f"t = {self._time:.6g}: {error}", error.reason, time=self._time)

    def _go_on(self, step: SceneStep, end: float) -> None:
        """Accept the step."""
        for name in list(self._touched):
            one = self._surfaces[name]
            halfway = self._along(one, step)(np.zeros(2, dtype=np.intp), np.array([0.5, 1.0]))
            if max(halfway) > self._tolerance(one, step):
                self._touched.remove(name)
        self.jumps.append(np.zeros(step.position.size))
        self._velocity, self._reach, self._time = step.end_velocity, step.reach, end

    def _along(self, surface: Surface, step: SceneStep) -> FormulaAlong:
        """The gap along a step."""
        basis = lobatto_basis(self._degree)

        def variables(_: Places, tau: Array, is_start: bool) -> dict[str, Array | float]:
            moved = np.tensordot(basis.values(tau.ravel())[1:], step.unknowns, axes=(0, 0))
            position = step.position + step.size * moved.reshape(*tau.shape, -1)
            return surface.values(position, step.begin + tau * step.size)

        return FormulaAlong(surface.impact.when, variables)

    def _tolerance(self, surface: Surface, step: SceneStep) -> float:
        """Gaps in a step smaller than this count as 0: round-off of it and the step before."""
        reach = np.maximum(step.reach, self._reach)
        return 2.0 * surface.round_off(step.position, reach, step.end)

    def _push(self, met: str, position: Array) -> Array:
        """Change of the momentum by surfaces that are met here, ``(d,)``; the motion is on them."""
        time, here = self._time, dict[str, Surface]()
        for name, one in sorted(self._surfaces.items()):
            slack = one.round_off(position, self._reach, time)
            slack += abs(one.speed(position, self._velocity, time)) * self._shortest
            if name == met or abs(one.gap(position, time)) <= slack:
                here[name] = one
        push, pushing, behind = push_off(self._scene, here, position, self._velocity, time)
        if not np.isfinite(push).all():
            words = f"the impulse of {met} is not finite"
            self._fail(StepFailedError(words, reason="not finite"))
            return np.zeros_like(position)
        self._velocity = behind
        self.jumps[-1] = self.jumps[-1] + push
        self._touched |= here.keys()
        for name in pushing | {met}:
            self.times[name].append(time)
        if sum(map(len, self.times.values())) > MOST_IMPACTS:
            self._fail(StepFailedError(f"more than {MOST_IMPACTS} impacts"))
        return push


def power_behind_impact(scene: Scene) -> float | None:
    """Least fractional power of the time in the position after a jump of the velocity.

    The derivative acts on the jump as that of Riemann and Liouville does on an initial velocity.
    """
    moving = replace(
        scene,
        initial_position=np.zeros(scene.dimension),
        initial_velocity=np.ones(scene.dimension),
        derivative="riemann-liouville",
        forcing=None,
    )
    return start_power(moving, at_start=True)


def step_ends(
    step: float, length: float, stages: int, power: float | None, least: float
) -> list[float]:
    """Ends of the steps after a singular point, relative to it, up to a length.

    `step` is the length of steps that are not graded, `power` the least fractional power in the
    position (None: it is smooth). Ends closer than `least` to 0 or the length are left out.
    """
    count = max(1, math.ceil(length / step * (1.0 - 1e-12)))
    ends = [one for one in _pattern(step, count, stages, power) if least <= one < length - least]
    return [*ends, length]


@lru_cache(maxsize=256)
def _pattern(step: float, count: int, stages: int, power: float | None) -> Sequence[float]:
    """Ends of graded steps after a singular point, over `count` steps of length `step`."""
    mesh = graded_start_mesh(count * step, count, (), stages=stages, exponent=lambda _: power)
    return tuple(mesh.times[1:].tolist())
