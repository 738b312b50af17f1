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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.failure import why_unsolved
from fvi_cli.integrator.meshes.controller import MOST_SHORTEST, SHORTEST_STEP
from fvi_cli.integrator.meshes.forces import StepPath
from fvi_cli.integrator.meshes.graded import graded_start_mesh, least_step, start_power
from fvi_cli.integrator.meshes.mesh import Stretch, uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.along import FormulaAlong, first_fall
from fvi_cli.integrator.observe.request import Observations
from fvi_cli.integrator.observe.surface import Surface, push_off, start_objection
from fvi_cli.integrator.run.loop import Source
from fvi_cli.integrator.run.on_mesh import Kept, run_through
from fvi_cli.integrator.trajectory import Observed, Occurrences, Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9  # share of T: shorter flights are lost in the round-off of their steps
MOST_IMPACTS = 10_000  # of a run
NEGLIGIBLE = 1e-14  # share of the fastest impact: slower motions towards a surface are round-off
NEAR = 1 / 16  # share of the round-off of the gap, in which a step ends on a surface
MOST_LANDINGS = 60  # steps that are tried to end on a surface: as many as bisection needs


def integrate_with_impacts(
    scene: Scene,
    method: Method,
    n_steps: int,
    request: Observations,
    kept: Kept,
) -> Trajectory:
    """Integrate a scene with surfaces that it bounces off, by a Runge-Kutta method.

    Steps are T / N long, and shorter after the start, break points and impacts. All ends of steps
    are reported, with the impacts as events. Where the motion comes to rest on a surface the run
    ends, with a remark.

    Raises
    ------
    ValueError
        For a start behind a surface, or on it and moving through it.
    """
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
    (run,) = run_through(engine, source, kept._replace(with_steps=True))
    steps, events = run.steps, dict[str, Occurrences]()
    assert steps is not None
    for name, times in source.times.items():
        time = np.array(times)
        events[name] = Occurrences(
            time=time,
            position=steps(time) if times else np.zeros((0, scene.dimension)),
            velocity=steps.velocity_at(time) if times else np.zeros((0, scene.dimension)),
        )
    observed = Observed(mesh=steps.time, events=events, stopped_by=source.rests_on)
    remarks = (f"at rest from t = {steps.time[-1]:.10g}",) if source.rests_on else ()
    return replace(run, observed=observed, remarks=remarks)


@dataclass(kw_only=True, eq=False)
class Landing:
    """The search for the length of the step that ends on a surface."""

    surface: str
    low: float  # lengths between which the root lies
    high: float
    size: float  # length to try
    tried: int = 0

    def improve(self, gap: float, speed: float) -> bool:
        """Whether there is another length to try, by Newton's iteration within bisection."""
        now, self.tried = self.size, self.tried + 1
        self.low, self.high = (now, self.high) if gap > 0.0 else (self.low, now)
        self.size = now - gap / speed if speed else now
        if not self.low < self.size < self.high:
            self.size = 0.5 * (self.low + self.high)
        return abs(self.size - now) > 0.5 * math.ulp(now) and self.tried < MOST_LANDINGS


class Bouncing(Source):
    """The source of steps of T / N, graded after the start, break points and impacts."""

    def __init__(
        self, scene: Scene, method: Method, n_steps: int, surfaces: Mapping[str, Surface]
    ) -> None:
        self._scene, self._surfaces, self._degree = scene, surfaces, method.degree
        self.n_steps, self._end = n_steps, scene.final_time
        self._step, self._shortest = self._end / n_steps, SHORTEST_STEP * self._end
        self._stops = [*scene.break_points, self._end]  # which are not reached
        self.pushes: list[Array] = [np.zeros(scene.dimension)]  # at every point of the mesh, (d,)
        self.times: dict[str, list[float]] = {name: [] for name in surfaces}
        self.rests_on = ""  # surface on which the motion has come to rest
        self._push: Array | None = None  # change of the momentum before the next step
        self._velocity = scene.initial_velocity  # at the end of the last step
        self._fastest = 0.0  # speed of an impact so far
        self._reach = np.zeros(scene.dimension)  # displacements in it
        self._time = 0.0
        self._landing: Landing | None = None
        self._power_behind_impact = power_behind_impact(scene)
        self._begin_flight(start_power(scene, at_start=True))

    def _begin_flight(self, power: float | None) -> None:
        """Set the ends of the steps to the next break point or the end, the last first."""
        self._begin, self._landing, self._targets = self._time, None, list[float]()
        if self._stops:
            end, begin, least = self._stops[0], self._begin, least_step(self._begin)
            count = max(1, math.ceil((end - begin) / self._step * (1.0 - 1e-12)))
            ends = _graded_ends(self._step, count, self._degree, power)
            self._targets = [begin + one for one in ends if least <= one < end - begin - least]
            self._targets = [end, *reversed(self._targets)]

    def propose(self, engine: Engine, state: State) -> Stretch | None:
        """The next step of a flight, or a part of it that may end on a surface."""
        if self._push is not None:
            own = engine.member_forces([self._push])
            state.p, state.p_lost = compensated(state.p, state.p_lost, own)
            self._push = None
        if self.failure or self.rests_on or not self._targets:
            return None
        begin, is_first = self._time, self._time == self._begin
        size = self._targets[-1] - begin
        if self._landing is not None:
            size = self._landing.size
        elif not is_first:
            # a nearly equal size is T / N times a power of 2, so that tables are shared
            exact = self._step * 2.0 ** round(math.log2(size / self._step))
            size = exact if abs(exact - size) <= 4.0 * math.ulp(begin + size) else size
        end = begin + size if self._landing is not None else self._targets[-1]
        return Stretch(begin=begin, end=end, n_steps=1, step_size=size, is_fresh=is_first)

    def accepts(self, engine: Engine, state: State, steps: Steps) -> bool:
        """Whether a step meets no surface, or ends on one."""
        if steps.failed.any():
            self._fail(why_unsolved(steps, state))
            return False
        path = self.path(engine, state, steps)
        x, p = state.x[:, None] + steps.dx, state.p[:, None] + steps.dp
        position, momentum = (one[0, 0] for one in engine.to_scene(x, p))
        velocity = self._scene.velocity(position, momentum, path.begin + path.size)
        # above order 1 that of its polynomial: momenta keep an error of the step behind an impact
        if self._scene.acts_above_order_1:
            velocity = lobatto_basis(self._degree).derivatives([1.0])[1:, 0] @ path.unknowns
        if self._landing is not None:
            return self._land(self._landing, path, position, velocity)
        found = [
            (name, fall)
            for name, one in self._surfaces.items()
            if (fall := first_fall(self._along(one, path), self._tolerance(one, path)))
        ]
        if not found:
            end = self._targets.pop()
            self._go_on(path, end, velocity)
            if not self._targets:
                self._stops.pop(0)
                self._begin_flight(start_power(self._scene, at_start=False))
            return True
        name, fall = min(found, key=lambda one: one[1].root)
        before = self.times[name][-1] if self.times[name] else -math.inf
        speed = self._surfaces[name].speed(path.position, self._velocity, path.begin)
        is_here = fall.root * path.size <= self._shortest
        is_short = path.begin + fall.root * path.size - before <= SHORTEST_FLIGHT * self._end
        # in a corner surfaces push one after the other
        if is_here and (speed < -NEGLIGIBLE * self._fastest or not is_short):
            self._meet(name, path.position)
        elif is_short:
            self.rests_on = name
        else:
            low, high = fall.top * path.size, min(fall.below, 1.0) * path.size
            size = fall.root * path.size
            self._landing = Landing(surface=name, low=low, high=high, size=size)
        return False

    def _land(self, landing: Landing, path: StepPath, position: Array, velocity: Array) -> bool:
        """Accept a step that ends on the surface, or try one that ends nearer to it."""
        end, surface = path.begin + path.size, self._surfaces[landing.surface]
        gap, speed = surface.gap(position, end), surface.speed(position, velocity, end)
        tolerance = self._tolerance(surface, path)
        # far below the gaps that count: the next flight begins here
        if abs(gap) > NEAR * tolerance and landing.improve(gap, speed):
            return False
        # the motion goes on for a unit in the last place of the time
        if abs(gap) > tolerance + abs(speed) * math.ulp(end):
            self._fail(f"the step to {landing.surface} has no end on it")
            return False
        self._go_on(path, end, velocity)
        self._meet(landing.surface, position)
        return True

    def _fail(self, words: str) -> None:
        self.failure = f"t = {self._time:.6g}: {words}"

    def _go_on(self, path: StepPath, end: float, velocity: Array) -> None:
        """Accept the step."""
        self.pushes.append(np.zeros(velocity.size))
        self._velocity, self._reach, self._time = velocity, _reach(path), end

    def _along(self, surface: Surface, path: StepPath) -> FormulaAlong:
        """The gap along a step."""
        basis = lobatto_basis(self._degree)

        def variables(_: Places, tau: Array) -> dict[str, Array | float]:
            moved = np.tensordot(basis.values(tau.ravel())[1:], path.unknowns, axes=(0, 0))
            position = path.position + path.size * moved.reshape(*tau.shape, -1)
            return surface.values(position, path.begin + tau * path.size)

        return FormulaAlong(surface.impact.when, variables)

    def _tolerance(self, surface: Surface, path: StepPath) -> float:
        """Gaps in a step smaller than this count as 0: round-off of it and the step before."""
        reach = np.maximum(_reach(path), self._reach)
        return 2.0 * surface.round_off(path.position, reach, path.begin + path.size)

    def _meet(self, met: str, position: Array) -> None:
        """Push the motion off a surface that is met here, and begin a flight."""
        surface = self._surfaces[met]
        speed = surface.speed(position, self._velocity, self._time)
        push, behind = push_off(self._scene, surface, position, self._velocity, self._time)
        if not np.isfinite(push).all():
            self._fail(f"the impulse of {met} is not finite")
            return
        self._fastest = max(self._fastest, -speed)
        self._velocity, self._push = behind, push
        self.pushes[-1] = self.pushes[-1] + push
        self.times[met].append(self._time)
        if sum(map(len, self.times.values())) > MOST_IMPACTS:
            self._fail(f"more than {MOST_IMPACTS} impacts")
        self._begin_flight(self._power_behind_impact)


def _reach(path: StepPath) -> Array:
    """Largest displacements in a step, ``(d,)``."""
    return np.asarray(path.size * np.abs(path.unknowns).max(axis=0))


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


@lru_cache(maxsize=256)
def _graded_ends(step: float, count: int, stages: int, power: float | None) -> Sequence[float]:
    """Ends of `count` steps after a singular point with this least power, relative to it."""
    mesh = graded_start_mesh(
        uniform_mesh(count * step, count), stages=stages, exponent=lambda _: power
    )
    return tuple(mesh.times[1:].tolist())
