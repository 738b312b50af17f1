"""Integration of scenes with a general Lagrangian."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.diagnostics import NOTHING, Asked, diagnose
from fvi_cli.integrator.engine import run
from fvi_cli.integrator.integrate import force_moments, jump_force
from fvi_cli.integrator.known_lagrangian import known_motion, lagrangian_residual
from fvi_cli.integrator.known_part import NO_SERIES, KnownPart, plan_series, settled_method
from fvi_cli.integrator.memory import build_memory
from fvi_cli.integrator.method import AnyMethod, Baseline
from fvi_cli.integrator.moments import exact_moments, galerkin_moments
from fvi_cli.integrator.motion import Motion
from fvi_cli.integrator.run.regular import regular_until
from fvi_cli.integrator.step_increments import run_with_increments
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.stepping import Stepped, StepProblem
from fvi_cli.integrator.trajectory import Status, Trajectory
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]


def integrate_general(
    scene: Scene, method: AnyMethod, n_steps: int, asked: Asked = NOTHING
) -> Trajectory:
    """Integrate a scene with a general Lagrangian in `n_steps` equal steps.

    Parameters
    ----------
    scene, method, n_steps, asked
        As for :func:`fvi_cli.integrator.integrate.integrate`.

    Raises
    ------
    ValueError
        For baselines and starting weights, and if a break point of the forcing lies between two
        steps.
    """
    lagrangian = scene.lagrangian
    if lagrangian is None:
        raise ValueError("lagrangian: the scene has none")
    if isinstance(method, Baseline):
        raise ValueError(f"baseline: {method.name} is not made for a general Lagrangian")
    if method.start == "weights" and scene.active_damping:
        raise ValueError("start: weights are not made for a general Lagrangian; use series or none")
    began = time.perf_counter()
    tables = step_tables(method)
    h = scene.final_time / n_steps
    breaks = steps_at_break_points(scene, n_steps)
    series = plan_series(scene, method, n_steps) if method.start == "series" else NO_SERIES
    decision = None if series.known is None else series.known.start
    window = None if decision is None else decision.window
    method = settled_method(scene, method, series)
    moments, of_forcing, jump = None, None, None
    if decision is not None and window is not None:
        # smooth by construction: the action's own rule is exact enough
        moments = galerkin_moments(
            lagrangian_residual(scene, lagrangian, decision), tables, h, n_steps
        )
    else:
        if scene.forcing is not None:
            moments = force_moments(
                scene.forcing.on_steps, method, tables, h, n_steps, (0, *breaks)
            )
        of_forcing = moments
        jump = None if method.sampling == "nodes" else jump_force(scene)
        if jump is not None:
            # singular at 0: always by exact moments
            added = exact_moments(jump, method, h, n_steps)
            moments = added if moments is None else moments + added
    from_rest = window is not None
    memory = build_memory(scene, method, tables, n_steps, scene.active_damping, from_rest=from_rest)
    rest = np.zeros(scene.dimension)
    start_momentum = lagrangian.momentum(scene.initial_position, scene.initial_velocity, 0.0)
    problem = StepProblem(
        scene=scene,
        tables=tables,
        memory=memory,
        step_size=h,
        n_steps=n_steps,
        position=rest if from_rest else scene.initial_position,
        momentum=rest if from_rest else start_momentum,
        moments=moments,
        known_motion=None
        if window is None
        else known_motion(lagrangian, window, tables, h, 0, n_steps),
        skip_first_kick=method.sampling == "nodes",
    )
    ready = time.perf_counter()
    if asked.is_empty:
        stepped = run(problem, method.history)
    else:
        stepped = run_with_increments(problem, method)
    finished = time.perf_counter()
    trajectory = _trajectory(
        lagrangian,
        problem,
        stepped,
        window,
        remarks=series.remarks,
        seconds=(ready - began, finished - ready),
    )
    if asked.is_empty or trajectory.momentum is None or trajectory.energy is None:
        return trajectory
    known = None
    if decision is not None and window is not None:
        known = KnownPart(scene=scene, start=decision)
    motion = Motion(
        scene=scene,
        method=method,
        tables=tables,
        memory=memory,
        step_size=h,
        stepped=stepped,
        moments=moments,
        forcing_moments=of_forcing,
        known=known,
        jump=jump,
        position=trajectory.position,
        momentum=trajectory.momentum,
        energy=trajectory.energy,
    )
    with np.errstate(all="ignore"):
        return replace(trajectory, diagnostics=diagnose(motion, asked))


def _trajectory(
    lagrangian: Lagrangian,
    problem: StepProblem,
    stepped: Stepped,
    window: WindowedSeries | None,
    *,
    remarks: tuple[str, ...],
    seconds: tuple[float, float],
) -> Trajectory:
    position, momentum = stepped.position, stepped.momentum
    grid = problem.step_size * np.arange(position.shape[0], dtype=float)
    if problem.skip_first_kick and problem.memory.channels:
        # p_k of the scheme is the one before the kick, of order 1 only; half the kick mends that
        momentum = momentum.copy()
        momentum[1:] -= 0.5 * problem.step_size * stepped.end_force[1:, 0]
    with np.errstate(all="ignore"):
        if window is not None:
            known, rate = window.position(grid), window.velocity(grid)
            position = position + known
            momentum = momentum + lagrangian.momentum(known, rate, grid)
        velocity = lagrangian.velocity(position, momentum, grid)
        energy = lagrangian.energy(position, velocity, grid)
    kept, failure = regular_until(lagrangian, position, momentum, energy, grid)
    if kept == grid.size:
        failure = stepped.failure
    finite = bool(np.isfinite(position[:kept]).all() and np.isfinite(momentum[:kept]).all())
    status: Status = "ok" if not failure else ("failed" if finite else "diverged")
    return Trajectory(
        time=grid[:kept],
        position=position[:kept],
        momentum=momentum[:kept],
        energy=energy[:kept],
        n_steps=problem.n_steps,
        step_size=problem.step_size,
        status=status,
        message=failure,
        history_operations=stepped.operations,
        newton=stepped.newton,
        setup_seconds=seconds[0],
        stepping_seconds=seconds[1],
        remarks=remarks,
    )
