"""Integration by backward differences, on equal steps."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.diagnostics import Asked, BalanceData, diagnose
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem
from fvi_cli.integrator.equal_steps.routes import run
from fvi_cli.integrator.equal_steps.weights import ChannelSource, build_memory
from fvi_cli.integrator.growth_bound import GrowthBound, cut_at_bound, growth_bound
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import no_unique_solution
from fvi_cli.integrator.run.regular import regular_until
from fvi_cli.integrator.run.steps_of_run import RunSteps
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.steps.dynamics import dynamics_of
from fvi_cli.integrator.trajectory import Status, Trajectory

Array = NDArray[np.float64]


def integrate_equal_steps(scene: Scene, method: Method, n_steps: int, asked: Asked) -> Trajectory:
    """The whole trajectory by backward differences.

    Parameters
    ----------
    scene, method, n_steps, asked
        As for :func:`fvi_cli.integrator.integrate.integrate`.

    Raises
    ------
    ValueError
        If a break point of the forcing lies between two steps, and for starting weights with a
        general Lagrangian.
    """
    try:
        return _integrate(scene, method, n_steps, asked)
    except np.linalg.LinAlgError:
        return unsolved(scene, n_steps)


def _integrate(scene: Scene, method: Method, n_steps: int, asked: Asked) -> Trajectory:
    began = time.perf_counter()
    prepared = prepare(scene, method, n_steps)
    if method.start == "weights" and scene.active_damping:
        from fvi_cli.integrator.equal_steps.starting_weights import correct_start

        corrected, remarks = correct_start(prepared.problem, method, scene)
        prepared = replace(prepared, problem=corrected, remarks=remarks)
    prepared, bound = bounded(prepared)
    problem = prepared.problem
    ready = time.perf_counter()
    stepped = run(problem, method.history, with_increments=not asked.is_empty)
    stepped = cut_at_bound(problem, stepped, bound)
    seconds = (ready - began, time.perf_counter() - ready)
    trajectory = finished_trajectory(method, prepared, stepped, seconds)
    if asked.is_empty or trajectory.momentum is None or trajectory.energy is None:
        return trajectory
    motion = _balance_data(prepared, stepped, trajectory, trajectory.momentum, trajectory.energy)
    with np.errstate(all="ignore"):
        return replace(trajectory, diagnostics=diagnose(motion, asked))


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """What is ready before the first step: the step problem, and remarks.

    `forcing_moments` are the part of the known moments that belongs to the forcing of the scene.
    """

    problem: StepProblem
    remarks: tuple[str, ...] = ()
    forcing_moments: Array | None = None


def prepare(
    scene: Scene, method: Method, n_steps: int, source: ChannelSource | None = None
) -> Prepared:
    """Everything that is known before the first step; `source` as for `build_memory`.

    Raises
    ------
    ValueError
        As :func:`integrate_equal_steps`.
    """
    if scene.lagrangian is not None and method.start == "weights" and scene.active_damping:
        raise ValueError("start: weights are not made for a general Lagrangian; use none")
    tables = step_tables(method)
    h = scene.final_time / n_steps
    breaks = steps_at_break_points(scene, n_steps)
    memory = build_memory(scene, method, tables, n_steps, scene.active_damping, source=source)
    loads = StepLoads(scene, method, tables)
    of_forcing, of_damping = loads.of_run(h, breaks, n_steps)
    moments = of_forcing
    if of_damping is not None and method.sampling == "points":
        moments = of_damping if of_forcing is None else of_forcing + of_damping
    start = scene.initial_position, scene.initial_velocity
    problem = StepProblem(
        scene=scene,
        tables=tables,
        memory=memory,
        step_size=h,
        n_steps=n_steps,
        position=scene.initial_position,
        momentum=dynamics_of(scene).momentum(*start, 0.0),
        moments=moments,
        skip_first_kick=method.sampling == "nodes",
    )
    return Prepared(problem=problem, forcing_moments=of_forcing)


def bounded(prepared: Prepared) -> tuple[Prepared, GrowthBound]:
    """The bound of a run, which its steps need not go beyond."""
    bound = growth_bound(prepared.problem)
    farthest = float(bound.at(np.asarray(prepared.problem.scene.final_time)))
    problem = replace(prepared.problem, stop_beyond=farthest)
    return replace(prepared, problem=problem), bound


def finished_trajectory(
    method: Method, prepared: Prepared, stepped: Stepped, seconds: tuple[float, float]
) -> Trajectory:
    """What the steps gave; `seconds` of set-up and of the steps."""
    problem = prepared.problem
    scene = problem.scene
    position, momentum, failure = stepped.position, stepped.momentum, stepped.failure
    if method.sampling == "nodes" and problem.memory.channels:
        # p_k of the scheme is the one before the kick, of order 1 only; half the kick mends that
        momentum = momentum.copy()
        momentum[1:] -= 0.5 * problem.step_size * stepped.end_force[1:, 0]
    grid = problem.step_size * np.arange(position.shape[0], dtype=float)
    with np.errstate(all="ignore"):
        energy = dynamics_of(scene).energy(position, momentum, grid)
        if scene.lagrangian is not None:
            kept, why = regular_until(scene.lagrangian, position, momentum, energy, grid)
            if kept < grid.size:
                failure, grid = why, grid[:kept]
                position, momentum, energy = position[:kept], momentum[:kept], energy[:kept]
    whole = np.isfinite(position).all() and np.isfinite(momentum).all()
    status: Status = "ok"
    if failure or not whole:
        status = "diverged" if failure.startswith("diverged") or not whole else "failed"
    return Trajectory(
        time=grid,
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=problem.n_steps,
        step_size=problem.step_size,
        status=status,
        message=failure,
        history_operations=stepped.operations,
        newton=stepped.newton,
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        remarks=prepared.remarks,
    )


def _balance_data(
    prepared: Prepared, stepped: Stepped, trajectory: Trajectory, momentum: Array, energy: Array
) -> BalanceData:
    """What the balances of a trajectory need, with its momentum and energy."""
    problem = prepared.problem
    tables, h, n = problem.tables, problem.step_size, trajectory.position.shape[0] - 1
    if stepped.increments is None:
        raise ValueError("diagnostics: the increments of the steps were not kept")
    rates = np.einsum("vr,nvd->nrd", tables.slopes[1:], stepped.increments[:n] / h)
    force = stepped.end_force[: n + 1]
    damping = h * np.einsum("vm,kmd->kvd", problem.memory.force_weights, force[:n])
    forcing = None if prepared.forcing_moments is None else prepared.forcing_moments[:n]
    if problem.moments is not None:
        # what is known of the damping force itself: the jump of Riemann-Liouville at 0
        damping = damping - problem.moments[:n] + (0.0 if forcing is None else forcing)
    return BalanceData(
        steps=RunSteps(
            tables=tables,
            time=trajectory.time,
            position=trajectory.position,
            momentum=momentum,
            step_size=np.full(n, h),
            velocity=rates,
        ),
        dynamics=dynamics_of(problem.scene),
        energy=energy,
        damping=damping,
        forcing=forcing,
        kicks=h * force[:, 0] if problem.skip_first_kick else None,
    )


def unsolved(scene: Scene, n_steps: int) -> Trajectory:
    """The start of a motion whose steps have singular equations, as with negative stiffness."""
    h = scene.final_time / n_steps
    position, dynamics = scene.initial_position[None], dynamics_of(scene)
    momentum = dynamics.momentum(position, scene.initial_velocity[None], np.zeros(1))
    return Trajectory(
        time=np.zeros(1),
        position=position,
        momentum=momentum,
        energy=dynamics.energy(position, momentum, np.zeros(1)),
        n_steps=n_steps,
        step_size=h,
        status="failed",
        message=no_unique_solution(h),
    )
