r"""A motion with impacts: where it meets a surface its normal velocity is reversed and scaled.

At a falling root of g(q, t) the momentum changes by a push along the normal,

.. math:: p^+ = p^- - (1 + e) \frac{\dot g}{\nabla g^T M^{-1} \nabla g} \nabla g, \qquad
   \dot g = \nabla g \cdot v + \partial_t g,

so that :math:`\dot g^+ = -e\, \dot g^-` (Newton's law of restitution). The states of the damping go
on: the force remembers the motion before. Behind an impact the position has the power
:math:`3 - \gamma` of the time, and steps are graded towards it as towards the start.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.adaptive import MOST_SHORTEST
from fvi_cli.integrator.engine.checkpoint import RunKeeper
from fvi_cli.integrator.failure import StepFailedError
from fvi_cli.integrator.growth_bound import NO_BOUND
from fvi_cli.integrator.meshes.adaptive import SHORTEST_STEP
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.asked import Impact
from fvi_cli.integrator.observations.bouncing import Bouncing
from fvi_cli.integrator.observations.surface import (
    Surface,
    is_rough_behind_impacts,
    start_objection,
)
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.loop import Course
from fvi_cli.integrator.run.setup import RunSetup, first_marker, prepare_run
from fvi_cli.integrator.run.unfinished import CourseKeeper
from fvi_cli.integrator.trajectory import Trajectory, status_of
from fvi_cli.mathematics.arrays import Array


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

    Raises
    ------
    ValueError
        For a start behind a surface, or on it and moving through it.

    Returns
    -------
    tuple
        The run with its steps, all of whose ends are reported; and the times of the impacts by
        name. Endless rebounds end the run at the time to which they converge, with a remark.
    """
    began = clock.perf_counter()
    surfaces = {
        name: Surface(impact=one, coordinates=coordinates, parameters=parameters)
        for name, one in impacts.items()
    }
    for name, surface in surfaces.items():
        if objection := start_objection(scene, surface):
            raise ValueError(f"impacts.{name}: {surface.impact.when.text} {objection}")
    shortest = SHORTEST_STEP * scene.final_time
    setup = prepare_run(
        scene,
        method,
        shortest_step=shortest,
        n_steps=MOST_SHORTEST,
        bound=NO_BOUND,
    )
    ready = clock.perf_counter()
    run = Bouncing(setup, surfaces, n_steps, shortest, checkpoints)
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
    if is_rough_behind_impacts(scene):
        momentum = smooth_momenta(steps, setup.stepper.solver.dynamics.momentum, scene.break_points)
        steps = replace(steps, momentum=momentum)
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
        message=str(course.failure or ""),
        failure=course.failure,
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
