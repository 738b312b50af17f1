"""Runs, on meshes and by adaptive steps: from scenes to trajectories."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import diagnose
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.meshes.controller import MOST_SHORTEST, AdaptiveSteps, shortest_step
from fvi_cli.integrator.meshes.graded import graded_start_mesh, start_power
from fvi_cli.integrator.meshes.mesh import ON_GRID, Mesh, mesh_through, uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.adaptive import AdaptiveSource
from fvi_cli.integrator.run.loop import MeshSource, Source, march
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array

AnySteps = int | Mesh | AdaptiveSteps


class Kept(NamedTuple):
    """What is kept of a run."""

    diagnostics: bool = False  # works and energies; they do not change the trajectory
    with_steps: bool = False  # the polynomials of all steps


def mesh_for(scene: Scene, method: Method, n_steps: int | Mesh) -> Mesh:
    """The mesh of N reported steps that a method uses: equal, or finer after singular points."""
    if isinstance(n_steps, Mesh):
        return n_steps
    if method.start == "graded":
        return graded_start_mesh(
            uniform_mesh(scene.final_time, n_steps, scene.break_points),
            stages=method.degree,
            exponent=lambda at_start: start_power(
                scene, at_start=at_start, forcing_quadrature=method.forcing_quadrature
            ),
        )
    return uniform_mesh(scene.final_time, n_steps, scene.break_points)


def engine_for(scenes: Sequence[Scene], method: Method, steps: Mesh | AdaptiveSteps) -> Engine:
    """The engine of scenes for the steps of a mesh, or for adaptive steps.

    Raises
    ------
    ValueError
        For a method of equal steps on a mesh that has others, and adaptive steps by no Gauss method
        of degree 2 or more.
    """
    if isinstance(steps, AdaptiveSteps):
        if method.cq != "gauss" or method.degree < 2:
            raise ValueError(
                "mesh: adaptive steps are for Gauss methods of degree 2 and more, not "
                f"for {method.label}"
            )
        shortest = shortest_step(scenes[0])
        return Engine(scenes, method, shortest_step=shortest, steps=MOST_SHORTEST, is_single=True)
    sizes = [one.step_size for one in steps.stretches]
    if not method.is_runge_kutta and max(sizes) - min(sizes) > ON_GRID * min(sizes):
        raise ValueError(
            f"steps: {method.cq} takes equal steps with break points at their ends; use rk: gauss"
        )
    return Engine(
        scenes,
        method,
        shortest_step=steps.shortest_step,
        steps=steps.equivalent_steps,
        n_steps=steps.n_steps,
    )


def integrate_scenes(
    scenes: Sequence[Scene], method: Method, steps: Mesh | AdaptiveSteps, kept: Kept
) -> list[Trajectory]:
    """Integrate scenes of one kind over [0, T], all at once; one by adaptive steps.

    Raises
    ------
    ValueError
        For a mesh that does not end at T or has a break point of the forcing inside of a step,
        and a method that has no variable steps.
    """
    first = scenes[0]
    if isinstance(steps, Mesh):
        if not math.isclose(steps.final_time, first.final_time, rel_tol=1e-12):
            words = f"it ends at {steps.final_time:g}, the run at {first.final_time:g}"
            raise ValueError(f"mesh: {words}")
        steps.check_breaks(first.break_points)
    engine = engine_for(scenes, method, steps)
    source: Source
    if isinstance(steps, AdaptiveSteps):
        source = AdaptiveSource(first, method, steps)
    else:
        source = MeshSource(steps)
        if method.start == "weights" and first.active_damping:
            _add_starting_weights(engine, steps)
    return run_through(engine, source, kept)


def run_through(engine: Engine, source: Source, kept: Kept) -> list[Trajectory]:
    """Do the steps of a source."""
    # above order 1 velocities begin like a power of t behind such loads, and so do momenta
    is_rough = engine.method.cq == "gauss" and any(
        one.acts_above_order_1 and (one.initial_loads or source.pushes) for one in engine.scenes
    )
    recorder = Recorder(engine, with_steps=kept.with_steps or kept.diagnostics or is_rough)
    march(engine, source, recorder)
    trajectories = []
    for index, scene in enumerate(engine.scenes):
        steps = recorder.steps(index)
        damping, done = engine.damping, steps.n_steps * engine.width
        if source.pushes:
            jump = np.array(source.pushes[: steps.n_steps + 1])
            steps = replace(steps, momentum=steps.momentum + jump, jump=jump)
        if is_rough:
            steps = replace(steps, momentum=steps.momenta_of_polynomials(scene))
        energy, failure = _energies(scene, steps.time, steps.position, steps.momentum)
        failure = failure or recorder.failures.get(index, "")
        steps, works = steps.first(energy.size - 1), None
        if kept.diagnostics and steps.n_steps:
            with np.errstate(all="ignore"):
                works = diagnose(scene, engine.method, steps, engine.loads_of[index])
        run = Trajectory(
            time=steps.time,
            position=steps.position,
            momentum=steps.momentum,
            energy=energy,
            n_steps=source.n_steps,
            step_size=scene.final_time / max(source.n_steps, 1),
            status="failed" if failure else "ok",
            message=failure,
            history_operations=0 if damping is None else done * damping.operations_per_step,
            newton_iterations=recorder.iterations_of(index),
            diagnostics=works,
            steps=steps if kept.with_steps else None,
        )
        if source.reported is not None:
            points = source.reported[: energy.size].copy()
            points[-1] = True
            run = run.at(points)
        trajectories.append(run)
    return trajectories


def _energies(scene: Scene, time: Array, position: Array, momentum: Array) -> tuple[Array, str]:
    """Energies at points, up to where they are finite, and why no more."""
    with np.errstate(all="ignore"):
        energy = scene.energy(position, momentum, time)
    # energies of linear scenes may overflow where motions are right
    wrong = np.flatnonzero(~(np.isfinite(energy) | scene.is_linear))
    if not wrong.size:
        return energy, ""
    at = int(wrong[0])
    near = ", ".join(f"{value:.4g}" for value in position[at])
    words = f"t = {float(time[at]):.6g}: the energy is not finite near q = [{near}]"
    # where no velocity is found from the momentum at the start, the start is kept
    if at == 0 and scene.lagrangian is not None:
        energy[0] = scene.lagrangian.energy(scene.initial_position, scene.initial_velocity, 0.0)
    return energy[: max(at, 1)], words


def _add_starting_weights(engine: Engine, mesh: Mesh) -> None:
    """Add the force of the starting weights of one scene to its loads."""
    # most runs need no scipy.special
    from fvi_cli.integrator.starting_weights import starting_loads

    (scene,), tables, given = engine.scenes, engine.tables, engine.loads_of[0]

    def first_samples(loads: Array, n_steps: int) -> Array:
        given.add(loads)
        times, sizes = mesh.times[: n_steps + 1], mesh.sizes[:n_steps]
        start = mesh_through(times, sizes, np.arange(1, n_steps), scene.break_points)
        recorder = Recorder(engine, with_steps=True)
        march(engine, MeshSource(start), recorder)
        steps = recorder.steps(0)
        inside = np.einsum("vm,nvd->nmd", tables.sample_basis[1:], steps.unknowns)
        moved = steps.position[:-1, None] + steps.step_size[:, None, None] * inside
        samples = np.full((n_steps, *moved.shape[1:]), np.nan)
        samples[: len(moved)] = moved - scene.initial_position
        return samples

    given.add(starting_loads(scene, engine.method, mesh.n_steps, first_samples))
