"""Runs: from scenes and steps to trajectories."""

from __future__ import annotations

import itertools
import math
import time as clock
from collections.abc import Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.meshes.controller import MOST_SHORTEST, AdaptiveSteps
from fvi_cli.integrator.meshes.graded import graded_start_mesh, start_power
from fvi_cli.integrator.meshes.mesh import (
    ON_GRID,
    Mesh,
    misplaced_break_point,
    uniform_mesh,
)
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.adaptive import AdaptiveSource, step_controller
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.run.scenes_run import ScenesRun, has_rough_momenta, trajectory_of
from fvi_cli.integrator.run.sources import MeshSource, Source
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread

AnySteps = int | Mesh | AdaptiveSteps


def mesh_for(scene: Scene, method: Method, n_steps: int | Mesh) -> Mesh:
    """The mesh of N reported steps that a method uses: equal, or finer after singular points."""
    if isinstance(n_steps, Mesh):
        return n_steps
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
        misplaced = misplaced_break_point(scene.break_points, scene.final_time, n_steps)
        if misplaced:
            raise ValueError(f"n_steps: {n_steps} puts {misplaced}")
    return uniform_mesh(scene.final_time, n_steps, scene.break_points)


def engine_for(scenes: Sequence[Scene], method: Method, steps: Mesh | AdaptiveSteps) -> Engine:
    """The engine of scenes for the steps of a mesh, or for adaptive steps.

    For adaptive steps the engine does not depend on their tolerance.

    Raises
    ------
    ValueError
        For a method of equal steps on a mesh that has others, and adaptive steps by no Gauss method
        of degree 2 or more.
    """
    if isinstance(steps, AdaptiveSteps):
        shortest = step_controller(scenes[0], method, steps).shortest_step
        return Engine(scenes, method, shortest_step=shortest, steps=MOST_SHORTEST, is_single=True)
    sizes = [one.step_size for one in steps.stretches]
    if not method.is_runge_kutta and max(sizes) - min(sizes) > ON_GRID * min(sizes):
        raise ValueError(f"mesh: {method.cq} takes equal steps only; use rk: gauss")
    return Engine(
        scenes,
        method,
        shortest_step=steps.shortest_step,
        steps=steps.equivalent_steps,
        n_steps=steps.n_steps,
    )


def prepare(
    scenes: Sequence[Scene],
    method: Method,
    steps: Mesh | AdaptiveSteps,
    *,
    every: int = 1,
    with_steps: bool = False,
    engine: Engine | None = None,
) -> ScenesRun:
    """Prepare a run up to its first step, including corrections of the start.

    Raises
    ------
    ValueError
        For starting weights with a general Lagrangian, and as for :func:`engine_for`.
    """
    engine = engine or engine_for(scenes, method, steps)
    mesh = None
    source: Source
    if isinstance(steps, Mesh):
        mesh, source = steps, MeshSource(steps)
    else:
        source = AdaptiveSource(scenes[0], method, steps)
    if mesh and method.start == "weights" and scenes[0].active_damping:
        _add_starting_weights(engine, mesh)
    recorder = Recorder(
        engine,
        every=every,
        with_steps=with_steps,
    )
    return ScenesRun(engine, source, recorder, mesh)


def _add_starting_weights(engine: Engine, mesh: Mesh) -> None:
    """Add the force of the starting weights of one scene to its loads."""
    # most runs need no scipy.special
    from fvi_cli.integrator.starting_weights import starting_loads

    (scene,), tables = engine.scenes, engine.tables
    h = scene.final_time / mesh.n_steps
    fresh = set(itertools.accumulate((one.n_steps for one in mesh.stretches), initial=0))

    def first_samples(loads: Array, n_steps: int) -> Array:
        state = engine.start()
        found = np.empty((n_steps, tables.sample_points.size, scene.dimension))
        for index in range(n_steps):
            own = engine.member_forces([loads[index : index + 1]])
            known = engine.loads(index * h, h, 1, is_fresh=index in fresh)
            steps = engine.solve(state, h, 1, own if known is None else known + own)
            inside = h * np.matmul(tables.sample_basis[1:].T, steps.unknowns[:, 0])
            place = engine.scene_positions(state.x[:, None] + inside)[0]
            found[index] = place - scene.initial_position
            engine.accept(state, steps, (index + 1) * h)
        return found

    loads = starting_loads(scene, engine.method, mesh.n_steps, first_samples)
    engine.loads_of[0].add(loads)


@in_one_thread
def integrate_scenes(
    scenes: Sequence[Scene],
    method: Method,
    steps: Mesh | AdaptiveSteps,
    *,
    every: int = 1,
    diagnostics: bool = False,
    with_steps: bool = False,
    engine: Engine | None = None,
) -> list[Trajectory]:
    """Integrate scenes of one kind over [0, T], all at once; one by adaptive steps.

    Every n-th reported point is kept, the first and the last; `with_steps` keeps the polynomials of
    all steps. Diagnostics do not change the trajectory. Adaptive runs may share `engine`.

    Raises
    ------
    ValueError
        For a mesh that does not end at T or has a break point of the forcing inside of a step,
        and a method that has no variable steps.
    MemoryError
        If there is no room for the points that are kept.
    """
    began, first = clock.perf_counter(), scenes[0]
    keeps = with_steps or diagnostics or has_rough_momenta(first, method)
    if isinstance(steps, Mesh):
        _check_mesh(steps, first)
        # a run without memory for its points fails here: later, a library may end the process
        np.empty((steps.n_reported // every + 1, len(scenes), 2 * first.dimension + 2))
    this = prepare(scenes, method, steps, every=every, with_steps=keeps, engine=engine)
    this.begin()
    ready = clock.perf_counter()
    seconds = this.march()
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


def _check_mesh(mesh: Mesh, scene: Scene) -> None:
    if not math.isclose(mesh.final_time, scene.final_time, rel_tol=1e-12):
        raise ValueError(f"mesh: it ends at {mesh.final_time:g}, the run at {scene.final_time:g}")
    mesh.check_breaks(scene.break_points)
