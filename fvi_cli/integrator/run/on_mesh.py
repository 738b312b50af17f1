"""Runs on a mesh: from scenes and steps to trajectories."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS, DiagnosticsRequest
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.loop.checkpoint import RunKeeper
from fvi_cli.integrator.loop.loop import run
from fvi_cli.integrator.loop.plan import MeshPlan, plan_steps
from fvi_cli.integrator.loop.recorder import Recorder
from fvi_cli.integrator.loop.source import MeshSource
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.graded_start import graded_start_mesh
from fvi_cli.integrator.meshes.mesh import ON_GRID, Mesh, uniform_mesh
from fvi_cli.integrator.meshes.singular_start import start_power
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.regular import keeps_for_momenta
from fvi_cli.integrator.run.scenes_run import ScenesRun, trajectory_of
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
