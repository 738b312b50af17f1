"""A run whose steps are found on the way, from scene and tolerance to the trajectory."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.diagnostics import NOTHING, Asked
from fvi_cli.integrator.balances.mesh_balance import diagnose_run
from fvi_cli.integrator.engine.checkpoint import RunKeeper
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.growth_bound import energy_remarks, scene_bound
from fvi_cli.integrator.local_error.examine import Examiner
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps, StepController
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.newton_record import NewtonRecord
from fvi_cli.integrator.run.loop import Course, march_adaptively
from fvi_cli.integrator.run.regular import (
    has_rough_momenta,
    regular_until,
    rough_remarks,
)
from fvi_cli.integrator.run.setup import (
    RunSetup,
    first_marker,
    prepare_run,
)
from fvi_cli.integrator.run.sink import Sink
from fvi_cli.integrator.run.unfinished import CourseKeeper
from fvi_cli.integrator.steps.dynamics import General
from fvi_cli.integrator.trajectory import Trajectory, status_of
from fvi_cli.mathematics.arrays import Array

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


def integrate_adaptively(
    scene: Scene,
    method: Method,
    steps: AdaptiveSteps,
    *,
    every: int = 1,
    diagnostics: Asked = NOTHING,
    with_steps: bool = False,
    checkpoints: RunKeeper | None = None,
    prepared: RunSetup | None = None,
) -> Trajectory:
    """Integrate a scene over [0, T] by steps that are found on the way.

    Parameters as for :func:`fvi_cli.integrator.run.on_mesh.integrate_on_mesh`; `prepared` is what
    :func:`prepare_adaptive` gave for the same scene, method and first step: runs share the matrices
    of step sizes that they have in common.
    """
    began = clock.perf_counter()
    sink = Sink(every=every, with_steps=with_steps or not diagnostics.is_empty)
    setup = prepared or prepare_adaptive(scene, method, steps)
    sink.with_steps |= has_rough_momenta(scene, method)
    ended, finished, count = _adaptive(setup, steps, sink, checkpoints)
    return trajectory_of(
        setup,
        sink,
        ended,
        count,
        every,
        diagnostics,
        (0.0, *scene.break_points),
        with_steps=with_steps,
        seconds=(0.0, finished - began + ended.earlier_seconds),
    )


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
        mesh = steps.mesh([at for at in fresh_at if at > 0.0])
        with np.errstate(all="ignore"):
            every_point = diagnose_run(
                scene, setup.method, mesh, steps, setup.stepper.loads, diagnostics
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
