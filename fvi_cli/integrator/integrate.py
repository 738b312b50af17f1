"""The one function in which scene and method meet."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import rgamma

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.baselines import integrate_baseline
from fvi_cli.integrator.break_points import steps_at_break_points
from fvi_cli.integrator.memory import build_memory
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.moments import (
    StepFunction,
    exact_moments,
    galerkin_moments,
    projected_moments,
)
from fvi_cli.integrator.starting_weights import correct_start
from fvi_cli.integrator.step_tables import StepTables, step_tables
from fvi_cli.integrator.stepping import StepProblem, Stepped, run_steps
from fvi_cli.integrator.trajectory import Trajectory

Array = NDArray[np.float64]


def integrate(scene: Scene, method: AnyMethod, n_steps: int) -> Trajectory:
    """Integrate `scene` over [0, T] by `method` in `n_steps` equal steps.

    Parameters
    ----------
    scene
        Effects and initial data; what is absent is not simulated.
    method
        Method or baseline.
    n_steps
        Number N >= 1 of steps; h = T / N.

    Returns
    -------
    Trajectory
        With status ``ok``, ``diverged`` (numbers ceased to be finite) or ``failed`` (equations
        could not be solved); it keeps what was finished.

    Raises
    ------
    ValueError
        If N is not a positive integer, or a break point of the forcing lies between two steps.
    """
    if not isinstance(n_steps, int | np.integer) or isinstance(n_steps, bool) or n_steps < 1:
        raise ValueError(f"n_steps: {n_steps!r} is not allowed; it must be an integer >= 1")
    n_steps = int(n_steps)
    if isinstance(method, Baseline):
        return integrate_baseline(scene, method, n_steps)
    began = time.perf_counter()
    problem, remarks = prepare(scene, method, n_steps)
    ready = time.perf_counter()
    if method.start == "weights" and scene.active_damping:
        problem, remark = correct_start(problem, method, scene)
        remarks = (*remarks, *remark)
    stepped = run_steps(problem)
    finished = time.perf_counter()
    return _trajectory(
        scene, method, problem, stepped, remarks, setup=ready - began, stepping=finished - ready
    )


def prepare(scene: Scene, method: Method, n_steps: int) -> tuple[StepProblem, tuple[str, ...]]:
    """Everything that is known before the first step, and remarks for the reader."""
    tables = step_tables(method)
    h = scene.final_time / n_steps
    breaks = steps_at_break_points(scene, n_steps)
    damping = scene.active_damping
    memory = build_memory(scene, method, tables, n_steps, damping)
    moments = None
    if scene.forcing is not None:
        moments = force_moments(scene.forcing.on_steps, method, tables, h, n_steps, (0, *breaks))
    jump = jump_force(scene)
    if jump is not None and method.sampling == "points":
        # singular at 0: always by exact moments
        added = exact_moments(jump, method, h, n_steps)
        moments = added if moments is None else moments + added
    return (
        StepProblem(
            scene=scene,
            tables=tables,
            memory=memory,
            step_size=h,
            n_steps=n_steps,
            position=scene.initial_position,
            momentum=scene.inertia.mass @ scene.initial_velocity,
            moments=moments,
            skip_first_kick=method.sampling == "nodes",
        ),
        (),
    )


def force_moments(
    force: StepFunction,
    method: Method,
    tables: StepTables,
    h: float,
    n_steps: int,
    singular_steps: tuple[int, ...],
) -> Array:
    """Moments of a known force as the method's ``forcing_quadrature`` asks for them."""
    if method.forcing_quadrature == "galerkin":
        return galerkin_moments(force, tables, h, n_steps)
    exact = exact_moments(force, method, h, n_steps, singular_steps)
    if method.forcing_quadrature == "exact":
        return exact
    return projected_moments(exact, method, tables)


def jump_force(scene: Scene) -> StepFunction | None:
    r"""What Riemann-Liouville adds to Caputo: :math:`-\mu q_0 t^{-\gamma} / \Gamma(1 - \gamma)`."""
    terms = [term for term in scene.active_damping if term.order < 1]
    if scene.derivative == "caputo" or not terms or not np.any(scene.initial_position != 0):
        return None

    def force(start: Array, h: float, offsets: Array) -> Array:
        time_values = start[:, None] + h * offsets
        total = np.zeros((*time_values.shape, scene.dimension))
        for term in terms:
            shape = -rgamma(1 - term.order) * time_values ** (-term.order)
            total += shape[..., None] * (scene.initial_position @ term.coefficient)
        return total

    return force


def _trajectory(
    scene: Scene,
    method: Method,
    problem: StepProblem,
    stepped: Stepped,
    remarks: tuple[str, ...],
    *,
    setup: float,
    stepping: float,
) -> Trajectory:
    momentum = stepped.momentum
    if method.sampling == "nodes" and problem.memory.channels:
        # p_k of the scheme is the one before the kick, of order 1 only; half the kick mends that
        momentum = momentum.copy()
        momentum[1:] -= 0.5 * problem.step_size * stepped.end_force[1:, 0]
    position = stepped.position
    with np.errstate(over="ignore", invalid="ignore"):
        energy = scene.energy(position, momentum)
    finite = bool(np.isfinite(position).all())
    status = "ok" if not stepped.failure else ("failed" if finite else "diverged")
    trajectory = Trajectory(
        time=problem.step_size * np.arange(position.shape[0]),
        position=position,
        momentum=momentum,
        energy=energy,
        n_steps=problem.n_steps,
        step_size=problem.step_size,
        message=stepped.failure,
        history_operations=stepped.operations,
        newton=stepped.newton,
        setup_seconds=setup,
        stepping_seconds=stepping,
        remarks=remarks,
    )
    if status == "failed":
        return replace(trajectory, status="failed")
    return replace(trajectory, status="diverged") if status == "diverged" else trajectory
