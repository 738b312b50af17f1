r"""A motion with impacts: where it meets a surface its normal velocity is reversed and scaled.

At a falling root of g(q, t) the momentum changes by a push along the normal,

.. math:: p^+ = p^- - (1 + e) \frac{\dot g}{\nabla g^T M^{-1} \nabla g} \nabla g, \qquad
   \dot g = \nabla g \cdot v + \partial_t g,

so that :math:`\dot g^+ = -e\, \dot g^-` (Newton's law of restitution). The states of the damping go
on: the force remembers the motion before. Behind an impact the position has the power
:math:`3 - \gamma` of the time, and steps are graded towards it as towards the start.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping, Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.growth_bound import NO_BOUND
from fvi_cli.integrator.meshes.adaptive import SHORTEST_STEP
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.asked import Impact
from fvi_cli.integrator.observations.pieces import event_places
from fvi_cli.integrator.observations.surface import Surface, power_behind_impact, step_ends
from fvi_cli.integrator.run.loop import Course
from fvi_cli.integrator.run.on_mesh import MOST_SHORTEST, status_of
from fvi_cli.integrator.run.setup import RunSetup, first_marker, prepare_run
from fvi_cli.integrator.run.steps_of_run import RunSteps
from fvi_cli.integrator.run.unfinished import CourseKeeper, RunKeeper
from fvi_cli.integrator.steps.dynamics import General
from fvi_cli.integrator.steps.step import StepFailedError, StepResult
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

SHORTEST_FLIGHT = 1e-9
"""Flights between rebounds shorter than this, relative to T, are the beginning of endless ones."""
SWEEPS = 8
START, IMPACT, BREAK = range(3)
"""What lies at the begin of a flight."""
LEAST_IN_ULPS = 256
"""Steps behind an impact are no shorter than so many units in the last place of its time."""


def integrate_with_impacts(
    scene: Scene,
    method: Method,
    n_steps: int,
    impacts: Mapping[str, Impact],
    *,
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
    checkpoints: RunKeeper | None = None,
) -> tuple[Trajectory, dict[str, Array]]:
    """Integrate a scene with surfaces that it bounces off.

    Parameters
    ----------
    scene, method
        What moves, and by which Runge-Kutta method.
    n_steps
        N: steps are T / N long, and shorter behind the start, break points and impacts.
    impacts
        Surfaces by name.
    coordinates, parameters
        Names in their expressions.
    checkpoints
        Where the run keeps a checkpoint, and goes on from one.

    Returns
    -------
    tuple
        The run with its steps, all of whose ends are reported; and the times of the impacts by
        name. Endless rebounds end the run at the time to which they converge, with a remark.
    """
    began = clock.perf_counter()
    shortest = SHORTEST_STEP * scene.final_time
    setup = prepare_run(
        scene,
        method,
        shortest_step=shortest,
        n_steps=MOST_SHORTEST,
        bound=NO_BOUND,
    )
    surfaces = {
        name: Surface(impact=one, coordinates=coordinates, parameters=parameters)
        for name, one in impacts.items()
    }
    ready = clock.perf_counter()
    run = _Bouncing(setup, surfaces, n_steps, shortest, checkpoints)
    with np.errstate(all="ignore"):
        run.march()
    finished = clock.perf_counter()
    course = run.course
    steps = RunSteps(
        tables=setup.stepper.solver.tables,
        time=np.array(course.times),
        position=np.array(course.positions),
        momentum=np.array(course.momenta),
        step_size=np.array(course.sizes),
        velocity=np.array([setup.stepper.velocity_of(one) for one in course.unknowns]),
        jump=np.array(run.jumps),
    )
    with np.errstate(all="ignore"):
        energy = setup.stepper.solver.dynamics.energy(steps.position, steps.momentum, steps.time)
    trajectory = Trajectory(
        time=steps.time,
        position=steps.position,
        momentum=steps.momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=scene.final_time / n_steps,
        status=status_of(course.failure, finite=bool(np.isfinite(steps.position).all())),
        message=course.failure,
        newton=course.newton,
        setup_seconds=ready - began,
        stepping_seconds=finished - ready + run.keeper.earlier_seconds,
        remarks=(run.rest,) if run.rest else (),
        steps=steps,
    )
    return trajectory, {name: np.array(times) for name, times in run.times.items()}


def replayed(
    setup: RunSetup, steps: RunSteps, checkpoints: RunKeeper | None = None
) -> RunSteps | None:
    """The steps of a run with impacts by another method: the same sizes and pushes."""
    marker = first_marker(setup)
    course = Course.begun(marker)
    asked = (setup.method.case, steps.n_steps, float(steps.time[-1]) / steps.n_steps)
    given = (setup.scene, setup.method, steps.time, steps.step_size, steps.jump)
    keeper = CourseKeeper(checkpoints, marker, course, asked, given, ("velocities",))
    velocities = list(keeper.found.get("velocities", ()))
    jumps = steps.jump if steps.jump is not None else np.zeros_like(steps.momentum)

    def found() -> dict[str, Array]:
        return {"velocities": np.array(velocities)}

    for index in range(len(velocities), steps.n_steps):
        h = float(steps.step_size[index])
        try:
            result = setup.stepper.attempt(marker, h, fresh=False)
        except StepFailedError:
            return None
        setup.stepper.accept(marker, result, h, float(steps.time[index + 1]))
        if np.any(jumps[index + 1]):
            marker.momentum.add(jumps[index + 1])
            marker.unknowns = None
        course.add(marker, result, h)
        velocities.append(result.velocity)
        keeper.offer(found)
    keeper.offer(found, has_ended=True)
    return RunSteps(
        tables=setup.stepper.solver.tables,
        time=steps.time,
        position=np.array(course.positions),
        momentum=np.array(course.momenta),
        step_size=steps.step_size,
        velocity=np.array(velocities),
        jump=jumps,
    )


class _Bouncing:
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
        self.marker = first_marker(setup)
        self.course = Course.begun(self.marker)
        self.jumps = [np.zeros(setup.scene.dimension)]
        self.times: dict[str, list[float]] = {name: [] for name in surfaces}
        self.rest = ""
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
        return {"jumps": np.array(self.jumps), "place": place, **impacts}

    def _restore(self, found: Mapping[str, Array]) -> None:
        self.jumps = list(found["jumps"])
        passed, behind, self._begin = found["place"].tolist()
        self._passed, self._behind = int(passed), int(behind)
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
            found = self._first_hit(result, size)
            if found is None:
                self._accept(result, size, target)
                return False
            name, place = found
            size, result = self._landed(self._surfaces[name], place * size, size)
        except StepFailedError as error:
            self.course.note(error.residuals)
            self.course.failure = f"t = {marker.time:.6g}: {error}"
            return False
        self._accept(result, size, marker.time + size)
        if not self.course.failure:
            self._bounce(name)
        return True

    def _accept(self, result: StepResult, size: float, target: float) -> None:
        course, marker = self.course, self.marker
        course.note(result.residuals)
        self._setup.stepper.accept(marker, result, size, target)
        course.add(marker, result, size)
        self.jumps.append(np.zeros(marker.position.value.size))
        if not np.isfinite(marker.position.value).all():
            course.failure = f"not finite after step {len(course.sizes) - 1}, t = {target:.6g}"

    def _first_hit(self, result: StepResult, size: float) -> tuple[str, float] | None:
        """The surface that is met first within a step, and where in it."""
        first: tuple[str, float] | None = None
        begin, start = self.marker.position.value, self.marker.time
        for name, surface in self._surfaces.items():

            def along(_: Places, tau: Array, surface: Surface = surface) -> Array:
                way = self._basis.values(tau)[1:].T @ result.unknowns
                return surface.gap(begin + size * way, start + tau * size)

            _, places = event_places(along, 1, "falling")
            if places.size and (first is None or places[0] < first[1]):
                first = name, float(places[0])
        return first

    def _landed(self, surface: Surface, guess: float, most: float) -> tuple[float, StepResult]:
        """The step that ends on a surface: Newton's iteration on its length."""
        stepper, marker = self._setup.stepper, self.marker
        size = max(guess, self._shortest)
        result = stepper.attempt(marker, size, fresh=False)
        best = math.inf, size, result
        for _ in range(SWEEPS):
            position = marker.position.value + size * result.unknowns[-1]
            time = marker.time + size
            gap = float(surface.gap(position, time))
            if not abs(gap) < abs(best[0]):
                break
            best = gap, size, result
            speed = self._speed(
                surface, position, marker.momentum.value + result.momentum_change, time
            )
            change = gap / speed if speed else 0.0
            following = min(max(size - change, 0.5 * size, self._shortest), most)
            if gap == 0.0 or abs(following - size) <= 0.5 * math.ulp(time):
                break
            size = following
            result = stepper.attempt(marker, size, fresh=False)
        return best[1], best[2]

    def _speed(self, surface: Surface, position: Array, momentum: Array, time: float) -> float:
        """Derivative of the gap by time along the motion."""
        normal, rate = surface.slopes(position, time)
        velocity = self._setup.stepper.solver.dynamics.velocity(position, momentum, time)
        return float(normal @ velocity) + rate

    def _bounce(self, name: str) -> None:
        """Reverse the normal velocity, or end the run where rebounds have no end."""
        marker, surface = self.marker, self._surfaces[name]
        position, momentum, time = marker.position.value, marker.momentum.value, marker.time
        normal, _ = surface.slopes(position, time)
        speed = self._speed(surface, position, momentum, time)
        restitution = surface.impact.restitution
        push = -(1.0 + restitution) * speed / float(normal @ self._mobility(normal)) * normal
        marker.momentum.add(push)
        marker.unknowns = None
        self.jumps[-1] = push
        self.course.momenta[-1] = marker.momentum.value.copy()
        self.times[name].append(time)
        self._look_for_rest(name, restitution)

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

    def _look_for_rest(self, name: str, restitution: float) -> None:
        earliest, earlier, time = [-math.inf, -math.inf, *self.times[name]][-3:]
        flight, before = time - earlier, earlier - earliest
        limit = SHORTEST_FLIGHT * self._end
        if restitution == 0.0:
            self.rest = f"at rest on {name} from t = {time:.10g} on: it does not bounce"
        elif flight < limit and flight < before:
            ratio = flight / before
            end = time + flight * ratio / (1.0 - ratio)
            count = len(self.times[name])
            self.rest = (
                f"at rest on {name} from t = {end:.10g} on: after {count} impacts the next come "
                f"within {flight:.2g}"
            )
