"""Runs on a mesh: from scenes and steps to trajectories."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.loop.checkpoint import Checkpoint, RunKeeper, fingerprint
from fvi_cli.integrator.loop.loop import run
from fvi_cli.integrator.loop.points import MeshSource
from fvi_cli.integrator.loop.recorder import Recorder
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.graded_start import graded_start_mesh
from fvi_cli.integrator.meshes.mesh import ON_GRID, Mesh, uniform_mesh
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.regular import keeps_for_momenta
from fvi_cli.integrator.run.scenes_run import MeshPlan, ScenesRun, plan_steps, trajectory_of
from fvi_cli.integrator.run.soundness import Soundness
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

AnySteps = int | Mesh | AdaptiveSteps


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


def engine_on_mesh(
    scenes: Sequence[Scene], method: Method, mesh: Mesh, *, most: int | None = None
) -> Engine:
    """The engine of scenes for the steps of a mesh.

    Blocks have at most so many steps, in a batch; None: as the size of their matrices allows.

    Raises
    ------
    ValueError
        For a method of equal steps on a mesh that has others.
    """
    sizes = [one.step_size for one in mesh.stretches]
    if not method.is_runge_kutta and max(sizes) - min(sizes) > ON_GRID * min(sizes):
        raise ValueError(f"mesh: {method.cq} takes equal steps only; use rk: gauss")
    return Engine(
        scenes,
        method,
        shortest_step=mesh.shortest_step,
        steps=mesh.equivalent_steps,
        n_steps=mesh.n_steps,
        most=most,
    )


def prepare(
    scenes: Sequence[Scene],
    method: Method,
    mesh: Mesh,
    *,
    every: int = 1,
    with_steps: bool = False,
    most: int | None = None,
) -> ScenesRun:
    """Everything that is ready before the steps of a mesh, corrections of the start among it.

    Raises
    ------
    ValueError
        For starting weights with a general Lagrangian, and unequal steps by a method of equal ones.
    """
    engine = engine_on_mesh(scenes, method, mesh, most=most)
    remarks: tuple[str, ...] = ()
    if method.start == "weights" and scenes[0].active_damping:
        remarks = _add_starting_weights(engine, mesh)
    recorder = Recorder(
        engine,
        every=every,
        with_steps=with_steps,
        n_reported=mesh.n_reported,
        check=Soundness(scenes, engine.loads_of),
    )
    return ScenesRun(engine, MeshSource(mesh), recorder, mesh, remarks)


def _add_starting_weights(engine: Engine, mesh: Mesh) -> tuple[str, ...]:
    """Take the force of the starting weights of one scene among the known ones."""
    from fvi_cli.integrator.starts.starting_weights import corrected_start

    (scene,), method, tables = engine.scenes, engine.method, engine.tables
    if scene.lagrangian is not None:
        raise ValueError("start: weights are not made for a general Lagrangian; use none")
    h = scene.final_time / mesh.n_steps
    fresh = {0, *steps_at_break_points(scene, mesh.n_steps)}

    def first_samples(loads: Array, n_steps: int) -> Array:
        state = engine.start()
        found = np.empty((n_steps, tables.sample_points.size, scene.dimension))
        for index in range(n_steps):
            own = np.array([loads[index : index + 1]])
            own = own if engine.modes is None else engine.modes[0].forces(own[0])
            known = engine.loads(index * h, h, 1, is_fresh=index in fresh)
            steps = engine.solve(state, h, 1, own if known is None else known + own)
            inside = h * np.matmul(tables.sample_basis[1:].T, steps.unknowns[:, 0])
            place = engine.scene_positions(state.x[:, None] + inside)[0]
            found[index] = place - scene.initial_position
            engine.accept(state, steps, (index + 1) * h)
        return found

    loads, remarks = corrected_start(scene, method, tables, mesh.n_steps, first_samples)
    if loads is not None:
        engine.add_loads(0, loads)
    return remarks


def path_from(
    scene: Scene, method: Method, n_steps: int, position: Array, momentum: Array
) -> Array:
    """Positions on the grid from any state on, however far they go.

    The initial data of the scene say what derivatives subtract. ``(n + 1, d)``, up to the first
    that is not finite.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a step have no unique solution.
    """
    mesh = mesh_for(scene, method, n_steps)
    engine = engine_on_mesh([scene], method, mesh)
    recorder = Recorder(engine)
    recorder.begin(0.0, position[None], momentum[None])
    run(
        engine,
        MeshSource(mesh),
        state=engine.start_at(position[None], momentum[None]),
        recorder=recorder,
    )
    failure = recorder.failures.get(0)
    if failure is not None and failure.reason == "no unique solution":
        raise np.linalg.LinAlgError(str(failure))
    return recorder.points(0)[1]


def plan_on_mesh(
    scene: Scene, method: Method, steps: int | Mesh, *, most: int | None = None
) -> MeshPlan:
    """How :func:`integrate_scenes` will do the steps of a scene; no step is done."""
    mesh = steps if isinstance(steps, Mesh) else mesh_for(scene, method, steps)
    return plan_steps(engine_on_mesh([scene], method, mesh, most=most), mesh)


def integrate_scenes(
    scenes: Sequence[Scene],
    method: Method,
    mesh: Mesh,
    *,
    every: int = 1,
    diagnostics: DiagnosticsRequest = NO_DIAGNOSTICS,
    with_steps: bool = False,
    checkpoints: RunKeeper | None = None,
    most: int | None = None,
) -> list[Trajectory]:
    """Integrate scenes of one kind over [0, T], all at once.

    Every n-th reported point is kept, the first and the last, and with steps the polynomials of
    all. Diagnostics do not touch the trajectory. The run goes on from its checkpoint, and keeps one
    now and then. `most` as for :func:`engine_on_mesh`.

    Raises
    ------
    ValueError
        For a mesh that does not end at T or has a break point of the forcing inside of a step,
        and a method that has no variable steps.
    MemoryError
        If there is no room for the points that are kept.
    """
    began, first = clock.perf_counter(), scenes[0]
    if not math.isclose(mesh.final_time, first.final_time, rel_tol=1e-12):
        raise ValueError(f"mesh: it ends at {mesh.final_time:g}, the run at {first.final_time:g}")
    mesh.check_breaks(first.break_points)
    # without room for its points a run says so here: libraries that are refused some later may
    # end the process
    np.empty((mesh.n_reported // every + 1, len(scenes), 2 * first.dimension + 2))
    keeps = with_steps or not diagnostics.is_empty
    keeps |= keeps_for_momenta(first, method, mesh.n_steps)
    this = prepare(scenes, method, mesh, every=every, with_steps=keeps, most=most)
    this.begin()
    ready = clock.perf_counter()
    run_key = (method.case, mesh.n_reported, first.final_time / max(mesh.n_reported, 1))
    seconds = this.march(checkpoints, run_key, (*scenes, method, mesh))
    share = 1.0 / len(scenes)
    return [
        trajectory_of(
            this,
            index,
            every,
            diagnostics,
            with_steps=with_steps,
            seconds=(share * (ready - began), share * seconds),
        )
        for index in range(len(scenes))
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A stretch of a run."""

    # the kept points after the start of the part (with the start for the first one)
    trajectory: Trajectory
    # where the next part begins; None after the end of the run, or a failure
    checkpoint: Checkpoint | None


def integrate_part(
    scene: Scene,
    method: Method,
    n_steps: int,
    *,
    until: int | None = None,
    checkpoint: Checkpoint | None = None,
    every: int = 1,
) -> Part:
    """Integrate from a checkpoint to the next place to stop.

    The trajectories of successive parts, one after the other, are that of the whole run to the
    last bit; but with a Riemann-Liouville derivative of an order above 1 and a start velocity,
    momenta and energies are those of the steps, which keep the error of the first one. A run that
    diverges may stop a step earlier in parts: its bound has the largest force that was met so far.

    Arguments as for :func:`fvi_cli.integrator.integrate.integrate`, always those of the whole run.
    It begins at the checkpoint, or the start, and stops when `until` steps of the mesh are done, or
    up to 4096 later.

    Raises
    ------
    ValueError
        If the checkpoint belongs to another run, or a number is outside of its range.
    """
    if every < 1:
        raise ValueError(f"every: {every} is not allowed; it must be at least 1")
    began = clock.perf_counter()
    mesh = mesh_for(scene, method, n_steps)
    step_size = scene.final_time / n_steps
    run_key = (method.case, n_steps, step_size, fingerprint(scene, method, mesh))
    if checkpoint is not None and checkpoint.run != run_key:
        own = f"{checkpoint.case} N={checkpoint.n_steps}"
        raise ValueError(
            f"checkpoint: it belongs to a run {own} of another scene, method or mesh, not to "
            f"{method.case} N={n_steps}"
        )
    done = 0 if checkpoint is None else checkpoint.done
    if until is not None and not done < until <= mesh.n_steps:
        raise ValueError(f"until: {until} is not allowed; it must be {done + 1} to {mesh.n_steps}")
    this = prepare([scene], method, mesh, every=every)
    if checkpoint is None:
        this.begin()
    else:
        this.go_on(checkpoint.arrays)
        this.recorder.go_on(this.state, checkpoint.done, checkpoint.reported)
    ready = clock.perf_counter()
    run(this.engine, this.source, state=this.state, recorder=this.recorder, until=until)
    trajectory = trajectory_of(
        this,
        0,
        every,
        NO_DIAGNOSTICS,
        with_steps=False,
        seconds=(ready - began, clock.perf_counter() - ready),
    )
    if trajectory.status != "ok" or this.recorder.done == mesh.n_steps:
        return Part(trajectory=trajectory, checkpoint=None)
    done, reported = this.progress
    return Part(
        trajectory=trajectory,
        checkpoint=Checkpoint(run=run_key, done=done, reported=reported, arrays=this.arrays()),
    )
