"""Runs of scenes up to the present step, and the trajectories that they give."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import diagnose
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.adaptive import AdaptiveSource
from fvi_cli.integrator.run.loop import run
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.run.sources import Source
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.trajectory import Diagnostics, Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.definite import least_scaled_eigenvalue


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
        run(self.engine, self.source, self.state, self.recorder)
        return clock.perf_counter() - began

    def begin(self) -> None:
        """Record the start."""
        scenes = self.engine.scenes
        position = np.array([one.initial_position for one in scenes])
        momentum = np.array(
            [one.momentum(one.initial_position, one.initial_velocity, 0.0) for one in scenes]
        )
        self.recorder.begin(0.0, position, momentum)


def has_rough_momenta(scene: Scene, method: Method) -> bool:
    """Whether momenta keep an error of the first step: velocities begin like a power of t."""
    return method.cq == "gauss" and scene.acts_above_order_1 and bool(scene.initial_loads)


def trajectory_of(
    this: ScenesRun,
    index: int,
    every: int,
    diagnostics: bool,
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
    scene, recorder = this.engine.scenes[index], this.recorder
    time, position, momentum = recorder.points(index)
    failure = recorder.failures.get(index)
    steps = recorder.steps(index) if recorder.with_steps else None
    remarks = this.remarks
    if bounced is not None:
        steps, momentum = bounced, bounced.momentum
    elif steps is not None and has_rough_momenta(scene, this.engine.method):
        steps = replace(steps, momentum=steps.momenta_of_polynomials(scene))
        momentum = steps.momentum[np.searchsorted(steps.time, time)]
    energy, end, irregular = _energies(scene, time, position, momentum)
    if irregular is not None:
        failure = irregular
        if steps is not None:
            # ends of the shortest steps may be equal to the last bit
            is_whole = steps.time.size == time.size
            steps = steps.first(
                end - 1 if is_whole else int(np.searchsorted(steps.time, time[end - 1]))
            )
        time, position, momentum = time[:end], position[:end], momentum[:end]
    found = None
    if steps is not None and diagnostics and steps.n_steps:
        found = _diagnostics(this, index, steps).at(np.searchsorted(steps.time, time))
    if n_steps is None and this.mesh is not None:
        n_steps = this.mesh.n_reported
    elif n_steps is None:
        n_steps = recorder.steps_done(index) if steps is None else steps.n_steps
    found_steps = this.source if isinstance(this.source, AdaptiveSource) else None
    return Trajectory(
        time=time,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=n_steps,
        step_size=scene.final_time / max(n_steps, 1),
        status="ok" if failure is None else "failed",
        message=str(failure or ""),
        failure=failure,
        history_operations=memory_operations(this.engine, recorder.steps_done(index)),
        newton=recorder.newton(index),
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        every=every,
        diagnostics=found,
        steps=steps if with_steps else None,
        remarks=remarks,
        rejected=0 if found_steps is None else found_steps.controller.rejected,
    )


def _energies(
    scene: Scene, time: Array, position: Array, momentum: Array
) -> tuple[Array, int, Failure | None]:
    """Energies at points, up to where the mass is positive definite and there is an energy.

    Returned are also the number of these points, and why the run ends there.
    """
    with np.errstate(all="ignore"):
        if scene.lagrangian is None:
            energy, mass = scene.energy(position, momentum, time), None
        else:
            velocity = scene.lagrangian.velocity(position, momentum, time)
            energy = scene.lagrangian.energy(position, velocity, time)
            mass = scene.lagrangian.derivatives(position, velocity, time).mass
    # of linear scenes energies overflow where motions are right
    finite, definite = np.isfinite(energy) | scene.is_linear, np.ones(time.size, dtype=bool)
    if mass is not None:
        known = np.isfinite(mass).all(axis=(1, 2))
        definite[known] = least_scaled_eigenvalue(mass[known]) > 0
        finite &= known
    wrong = np.flatnonzero(~(finite & definite))
    if not wrong.size:
        return energy, time.size, None
    what = "mass matrix d2L/dv2 is not positive definite"
    if definite[wrong[0]]:
        what = "energy is not finite"
    # where no velocity is found from the momentum at the start, the start is kept
    first = max(int(wrong[0]), 1)
    if wrong[0] == 0 and scene.lagrangian is not None:
        start = scene.initial_position, scene.initial_velocity
        energy[0] = scene.lagrangian.energy(*start, 0.0)
    at = float(time[wrong[0]])
    near = ", ".join(f"{value:.4g}" for value in position[wrong[0]])
    words = f"t = {at:.6g}: the {what} near q = [{near}]"
    return energy[:first], first, Failure(words, "irregular", time=at)


def _diagnostics(this: ScenesRun, index: int, steps: RunSteps) -> Diagnostics:
    """The diagnostics on all points of the mesh."""
    engine = this.engine
    scene, loads = engine.scenes[index], engine.loads_of[index]
    mesh = this.mesh or steps.mesh(scene.break_points)
    with np.errstate(all="ignore"):
        return diagnose(scene, engine.method, mesh, steps, loads)


def memory_operations(engine: Engine, n_steps: int) -> int:
    """Multiply-adds of the memory of a scene in `n_steps` steps."""
    damping = engine.damping
    return 0 if damping is None else n_steps * engine.width * damping.operations_per_step
