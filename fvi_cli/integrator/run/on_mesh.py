"""A run on a mesh, from scene and steps to the trajectory."""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.diagnostics import NOTHING, Asked
from fvi_cli.integrator.balances.mesh_balance import diagnose_run
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.growth_bound import energy_remarks, scene_bound
from fvi_cli.integrator.local_error.examine import Examiner
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps, StepController
from fvi_cli.integrator.meshes.graded_start import graded_start_mesh
from fvi_cli.integrator.meshes.mesh import Mesh, uniform_mesh
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.run.loop import Course, march_adaptively
from fvi_cli.integrator.run.march import March, MeshPlan
from fvi_cli.integrator.run.regular import (
    has_rough_momenta,
    keeps_for_momenta,
    regular_until,
    rough_remarks,
)
from fvi_cli.integrator.run.setup import (
    RunSetup,
    first_marker,
    prepare_on_mesh,
    prepare_run,
    ready_on_mesh,
)
from fvi_cli.integrator.run.sink import Sink
from fvi_cli.integrator.run.unfinished import CourseKeeper, RunKeeper, march_with_checkpoints
from fvi_cli.integrator.steps.dynamics import General
from fvi_cli.integrator.trajectory import Trajectory, status_of
from fvi_cli.mathematics.arrays import Array

AnySteps = int | Mesh | AdaptiveSteps

MOST_SHORTEST = 256.0
"""Adaptive runs take fewer steps of their shortest size than this."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Ended:
    """How the loop ended.

    Parameters
    ----------
    failure, newton
        What stopped it, if anything, and the record of Newton's iteration.
    rejected, operations
        Steps that were done in vain, and multiply-adds of the memory.
    earlier_seconds
        Time of the steps before a checkpoint.
    doubts
        Times with what the steps there may have missed.
    """

    failure: Failure | None
    newton: NewtonRecord
    rejected: int = 0
    operations: int = 0
    earlier_seconds: float = 0.0
    doubts: tuple[tuple[float, str], ...] = ()


def end_of(march: March, earlier_seconds: float = 0.0) -> Ended:
    """How the steps of a mesh ended."""
    return Ended(
        failure=march.failure,
        newton=march.course.newton,
        operations=march.operations,
        earlier_seconds=earlier_seconds,
    )


def mesh_for(scene: Scene, method: Method, n_steps: int) -> Mesh:
    """The mesh of N reported steps that a method takes: equal, or finer behind singular points."""
    if method.start == "graded":
        return graded_start_mesh(
            scene.final_time,
            n_steps,
            scene.break_points,
            stages=method.degree,
            exponent=lambda at_start: start_power(
                scene, at_start=at_start, forcing_quadrature=method.forcing_quadrature
            ),
        )
    if not method.is_runge_kutta:
        # all steps are equal: break points between two of them are refused
        steps_at_break_points(scene, n_steps)
    return uniform_mesh(scene.final_time, n_steps, scene.break_points)


def plan_on_mesh(scene: Scene, method: Method, steps: int | Mesh) -> MeshPlan:
    """How :func:`integrate_on_mesh` will do the steps of a run; no step is done."""
    mesh = steps if isinstance(steps, Mesh) else mesh_for(scene, method, steps)
    setup = prepare_on_mesh(scene, method, mesh)
    return March(setup, mesh, Sink(every=1, with_steps=False)).plan()


def path_from(
    scene: Scene, method: Method, n_steps: int, position: Array, momentum: Array
) -> Array:
    """Positions on the grid from any state on, however far they go.

    Parameters
    ----------
    scene, method, n_steps
        The run; its own initial data say what derivatives subtract.
    position, momentum
        Where it begins, shape ``(d,)``.

    Returns
    -------
    Array
        Shape ``(n + 1, d)``, up to the first that is not finite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a step have no unique solution.
    """
    mesh = mesh_for(scene, method, n_steps)
    setup, sink = prepare_on_mesh(scene, method, mesh), Sink(every=1, with_steps=False)
    marker = first_marker(setup)
    marker.position, marker.momentum = CompensatedSum(position), CompensatedSum(momentum)
    march = March(setup, mesh, sink)
    sink.begin(0.0, position, momentum)
    march.run(marker)
    if march.failure is not None and march.failure.reason == "no unique solution":
        raise np.linalg.LinAlgError(str(march.failure))
    return sink.position


def integrate_on_mesh(
    scene: Scene,
    method: Method,
    steps: AnySteps,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
    with_steps: bool = False,
    checkpoints: RunKeeper | None = None,
    prepared: RunSetup | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T].

    Parameters
    ----------
    scene, method
        What, and by which Runge-Kutta method.
    steps
        Number of steps, a mesh, or what the steps are chosen for.
    every
        Keep every n-th reported point, the first and the last.
    diagnostics
        What else is computed; it does not touch the trajectory.
    with_steps
        Keep all steps as polynomials, for dense output.
    checkpoints
        Where the run may have a checkpoint, from which it goes on, and keeps one now and then.
    prepared
        What :func:`prepare_adaptive` gave for the same scene, method and first step: runs share
        the matrices of step sizes that they have in common.

    Raises
    ------
    ValueError
        For a mesh that does not end at T or has a break point of the forcing inside of a step,
        and a method that has no variable steps.
    MemoryError
        If there is no room for the points that are kept.
    """
    began = clock.perf_counter()
    sink = Sink(every=every, with_steps=with_steps or not diagnostics.is_empty)
    if isinstance(steps, AdaptiveSteps):
        setup = prepared or prepare_adaptive(scene, method, steps)
        sink.with_steps |= has_rough_momenta(scene, method)
        ended, finished, count = _adaptive(setup, steps, sink, checkpoints)
        fresh_at = (0.0, *scene.break_points)
        ready = began
    else:
        mesh = steps if isinstance(steps, Mesh) else mesh_for(scene, method, steps)
        if not math.isclose(mesh.final_time, scene.final_time, rel_tol=1e-12):
            raise ValueError(
                f"mesh: it ends at {mesh.final_time:g}, the run at {scene.final_time:g}"
            )
        mesh.check_breaks(scene.break_points)
        count = mesh.n_reported
        # without room for its points a run says so here: libraries that are refused some later may
        # end the process
        np.empty((count // every + 1, 2 * scene.dimension + 2))
        bound = scene_bound(scene)
        setup = ready_on_mesh(scene, method, mesh, bound)
        ready = clock.perf_counter()
        sink.with_steps |= keeps_for_momenta(scene, method, mesh.n_steps)
        ended = _given(setup, mesh, sink, checkpoints)
        finished = clock.perf_counter()
        fresh_at = tuple(one.begin for one in mesh.stretches if one.is_fresh)
    return trajectory_of(
        setup,
        sink,
        ended,
        count,
        every,
        diagnostics,
        fresh_at,
        with_steps=with_steps,
        seconds=(ready - began, finished - ready + ended.earlier_seconds),
    )


def _given(setup: RunSetup, mesh: Mesh, sink: Sink, checkpoints: RunKeeper | None) -> Ended:
    """The steps of a mesh."""
    march, marker, earlier = March(setup, mesh, sink), first_marker(setup), 0.0
    if checkpoints is None:
        sink.begin(0.0, marker.position.value, marker.momentum.value)
        march.run(marker)
    else:
        marker, earlier = march_with_checkpoints(setup, mesh, sink, march, checkpoints)
    if not march.failure:
        sink.finish(marker.time, marker.position.value, marker.momentum.value)
    return end_of(march, earlier)


def prepare_adaptive(scene: Scene, method: Method, steps: AdaptiveSteps) -> RunSetup:
    """What is ready before steps are found on the way, whatever their tolerance is.

    Raises
    ------
    ValueError
        If it is no Gauss method of degree 2 or more.
    """
    if method.cq != "gauss" or method.degree < 2:
        raise ValueError(
            f"mesh: adaptive steps are for Gauss methods of degree 2 and more, not "
            f"for {method.case}"
        )
    return prepare_run(
        scene,
        method,
        shortest_step=_controller(scene, method, steps).shortest_step,
        n_steps=MOST_SHORTEST,
        bound=scene_bound(scene),
    )


def _controller(scene: Scene, method: Method, steps: AdaptiveSteps) -> StepController:
    is_singular = start_power(scene, at_start=True) is not None
    return StepController(
        steps,
        final_time=scene.final_time,
        breaks=scene.break_points,
        stages=method.degree,
        is_singular=is_singular or bool(scene.break_points),
    )


def _adaptive(
    setup: RunSetup, steps: AdaptiveSteps, sink: Sink, checkpoints: RunKeeper | None
) -> tuple[Ended, float, int]:
    """Steps that are found on the way."""
    scene = setup.scene
    controller = _controller(scene, setup.method, steps)
    examiner = Examiner(scene, setup.stepper.solver.tables)
    marker = first_marker(setup)
    sink.begin(0.0, marker.position.value, marker.momentum.value)
    course = Course.begun(marker)
    asked = (setup.method.case, 0, steps.tolerance)
    keeper = CourseKeeper(
        checkpoints, marker, course, asked, (scene, setup.method, steps), ("state",)
    )

    def state() -> dict[str, Array]:
        return {"state": np.array([*examiner.state, *controller.state], dtype=float)}

    if keeper.found:
        largest, starts_on, *rest = keeper.found["state"].tolist()
        examiner.restore(largest, starts_on)
        controller.restore(rest)
    march_adaptively(
        setup.stepper,
        marker,
        course,
        controller,
        examiner,
        most_steps=steps.most_steps,
        bound=setup.bound,
        after_step=lambda: keeper.offer(state),
    )
    if not course.failure:
        keeper.offer(state, has_ended=True)
    count = len(course.sizes)
    if count:
        velocity = np.array([setup.stepper.velocity_of(one) for one in course.unknowns])
        sink.add(
            np.array(course.times[1:]),
            np.array(course.sizes),
            np.array(course.positions[1:]),
            np.array(course.momenta[1:]),
            velocity,
            np.arange(count),
        )
    sink.finish(marker.time, marker.position.value, marker.momentum.value)
    per_step = 0 if setup.damping is None else setup.damping.operations_per_step
    ended = Ended(
        failure=course.failure,
        newton=course.newton,
        rejected=course.rejected,
        operations=count * per_step,
        doubts=tuple(course.doubts),
        earlier_seconds=keeper.earlier_seconds,
    )
    return ended, clock.perf_counter(), count


def trajectory_of(
    setup: RunSetup,
    sink: Sink,
    ended: Ended,
    n_steps: int,
    every: int,
    diagnostics: Asked,
    fresh_at: tuple[float, ...],
    *,
    with_steps: bool,
    seconds: tuple[float, float],
) -> Trajectory:
    """What is reported of a finished run."""
    scene, dynamics = setup.scene, setup.stepper.solver.dynamics
    time, position, momentum = sink.time, sink.position, sink.momentum
    failure, force = ended.failure, setup.stepper.loads.largest_force
    remarks = setup.remarks
    steps = sink.steps(setup.stepper.solver.tables) if sink.with_steps else None
    if has_rough_momenta(scene, setup.method):
        if steps is not None:
            every_momentum = smooth_momenta(steps, dynamics.momentum, scene.break_points)
            momentum = every_momentum[np.searchsorted(steps.time, time)]
        remarks += rough_remarks(scene, diagnostics, are_stored_smooth=steps is not None)
    with np.errstate(all="ignore"):
        energy = dynamics.energy(position, momentum, time)
    if isinstance(dynamics, General):
        kept, irregular = regular_until(dynamics.lagrangian, position, momentum, energy, time)
        if irregular:
            if kept == 0:
                # no velocity was found from the momentum of the start, where it is given
                kept, start = 1, (scene.initial_position, scene.initial_velocity)
                energy[0] = dynamics.lagrangian.energy(*start, 0.0)
            time, position, momentum, energy = (
                one[:kept] for one in (time, position, momentum, energy)
            )
            failure = irregular
    finite = bool(np.isfinite(position).all() and np.isfinite(momentum).all())
    found = None
    if steps is not None and not diagnostics.is_empty and steps.n_steps:
        fresh = np.isin(steps.time[:-1], np.array(fresh_at))
        with np.errstate(all="ignore"):
            every_point = diagnose_run(
                steps,
                setup.stepper.solver,
                setup.stepper.loads,
                fresh,
                diagnostics,
                has_kicks=setup.method.sampling == "nodes",
            )
        found = every_point.at(np.searchsorted(steps.time, time))
    return Trajectory(
        time=time,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=scene.final_time / max(n_steps, 1),
        status=status_of(failure, finite=finite),
        message=str(failure or ""),
        failure=failure,
        history_operations=ended.operations,
        newton=ended.newton,
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        every=every,
        diagnostics=found,
        steps=steps if with_steps else None,
        rejected=ended.rejected,
        doubts=ended.doubts,
        remarks=remarks if failure else (*remarks, *energy_remarks(scene, position, energy, force)),
    )
