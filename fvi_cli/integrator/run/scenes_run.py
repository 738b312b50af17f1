"""Runs of scenes up to the present step, and the trajectories that they give."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.diagnostics_request import DiagnosticsRequest
from fvi_cli.integrator.balances.balance import diagnose_run
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.growth_bound import energy_remarks
from fvi_cli.integrator.loads.jumps import jump_remarks
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.results.diagnostics import Diagnostics
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.adaptive import AdaptiveSource
from fvi_cli.integrator.run.loop import run
from fvi_cli.integrator.run.points import Source
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.run.regular import (
    has_rough_momenta,
    regular_until,
    rough_remarks,
    with_singular_mass,
)
from fvi_cli.integrator.trajectory import Trajectory, status_of


@dataclass(eq=False)
class ScenesRun:
    """A run of scenes up to the present step."""

    engine: Engine  # solves the steps, which come from the source and are kept by the recorder
    source: Source
    recorder: Recorder
    mesh: Mesh | None = None  # the mesh of the steps; None: adaptive steps
    remarks: tuple[str, ...] = ()  # remarks on every run

    def __post_init__(self) -> None:
        self.state = self.engine.start()

    def march(self) -> float:
        """Do the steps; returns the seconds that they took."""
        began = clock.perf_counter()
        run(self.engine, self.source, state=self.state, recorder=self.recorder)
        return clock.perf_counter() - began

    def begin(self) -> None:
        """Record the start."""
        scenes = self.engine.scenes
        position = np.array([one.initial_position for one in scenes])
        momentum = np.array(
            [one.momentum(one.initial_position, one.initial_velocity, 0.0) for one in scenes]
        )
        self.recorder.begin(0.0, position, momentum)


def trajectory_of(
    this: ScenesRun,
    index: int,
    every: int,
    diagnostics: DiagnosticsRequest,
    *,
    with_steps: bool,
    seconds: tuple[float, float],
    bounced: RunSteps | None = None,
    n_steps: int | None = None,
) -> Trajectory:
    """The trajectory of a scene whose steps are done.

    `seconds` are those before the steps, and those of the steps. For a run with impacts the steps
    are given, `bounced`, with their momenta, and the number of steps that were not cut.
    """
    scene, method, recorder = this.engine.scenes[index], this.engine.method, this.recorder
    if n_steps is None:
        n_steps = recorder.steps_done(index) if this.mesh is None else this.mesh.n_reported
    time, position, momentum = recorder.points(index)
    failure = recorder.failures.get(index)
    steps = recorder.steps(index) if recorder.with_steps else None
    remarks = this.remarks
    if bounced is not None:
        steps, momentum = bounced, bounced.momentum
    elif has_rough_momenta(scene, method):
        if steps is not None:
            every_momentum = smooth_momenta(steps, scene.momentum, scene.break_points)
            momentum = every_momentum[np.searchsorted(steps.time, time)]
        remarks += rough_remarks(scene, diagnostics, are_stored_smooth=steps is not None)
    with np.errstate(all="ignore"):
        if scene.lagrangian is None:
            energy = scene.energy(position, momentum, time)
        else:
            velocity = scene.lagrangian.velocity(position, momentum, time)
            energy = scene.lagrangian.energy(position, velocity, time)
    if scene.lagrangian is not None:
        kept, irregular = regular_until(scene.lagrangian, position, velocity, energy, time)
        if irregular:
            if kept == 0:
                # no velocity was found from the momentum at the start; there the velocity is given
                kept, start = 1, (scene.initial_position, scene.initial_velocity)
                energy[0] = scene.lagrangian.energy(*start, 0.0)
            time, position, momentum, energy = (
                one[:kept] for one in (time, position, momentum, energy)
            )
            failure = irregular
        elif failure is not None and failure.reason == "step failed":
            step = scene.final_time / max(n_steps, 1)
            failure = with_singular_mass(failure, scene.lagrangian, position, time, step)
    finite = bool(np.isfinite(position).all() and np.isfinite(momentum).all())
    found = None
    if steps is not None and not diagnostics.is_empty and steps.n_steps:
        found = _diagnostics(this, index, steps, diagnostics).at(np.searchsorted(steps.time, time))
    if failure is None:
        force = this.engine.loads_of[index].largest_force
        # surfaces that move give energy
        if steps is None or steps.jump is None:
            remarks += energy_remarks(scene, position, energy, force)
        if scene.forcing is not None and scene.forcing.has_functions:
            # all points of a mesh take memory
            remarks += jump_remarks(scene, time if this.mesh is None else this.mesh.times)
    found_steps = this.source if isinstance(this.source, AdaptiveSource) else None
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
        history_operations=memory_operations(this.engine, recorder.steps_done(index)),
        newton=recorder.newton.of(index),
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        every=every,
        diagnostics=found,
        steps=steps if with_steps else None,
        remarks=remarks,
        rejected=0 if found_steps is None else found_steps.controller.rejected,
        doubts=() if found_steps is None else found_steps.doubts,
    )


def _diagnostics(
    this: ScenesRun, index: int, steps: RunSteps, request: DiagnosticsRequest
) -> Diagnostics:
    """The diagnostics on all points of the mesh."""
    engine = this.engine
    scene, loads = engine.scenes[index], engine.loads_of[index]
    mesh = this.mesh or steps.mesh(scene.break_points)
    with np.errstate(all="ignore"):
        return diagnose_run(scene, engine.method, mesh, steps, loads, request)


def memory_operations(engine: Engine, n_steps: int) -> int:
    """Multiply-adds of the memory of a scene in `n_steps` steps."""
    damping = engine.damping
    return 0 if damping is None else n_steps * engine.width * damping.operations_per_step
