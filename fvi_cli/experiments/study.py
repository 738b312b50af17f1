"""The study: a generator of finished runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from fvi_cli.experiments.experiment import Experiment, FinishedRun, Observed, Run
from fvi_cli.experiments.norms import error_norm
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.operators import left_operator
from fvi_cli.scenes.problem import DerivativeProblem, Problem

Array = NDArray[np.float64]

EPSILON = float(np.finfo(float).eps)
DIVERGED_RATIO = 10.0


def study(
    experiment: Experiment, finished: Callable[[Run], FinishedRun | None] = lambda run: None
) -> Iterator[FinishedRun]:
    """Every run of `experiment`, method by method, steps increasing.

    Parameters
    ----------
    experiment
        What to do.
    finished
        Gives back a run that was computed before, or None.
    """
    for run in experiment.runs():
        yield finished(run) or execute(run)


def execute(run: Run) -> FinishedRun:
    """Compute one run and its error."""
    problem = run.experiment.problem
    if isinstance(problem, DerivativeProblem):
        trajectory = _differentiate(problem, run)
    else:
        trajectory = integrate(problem.scene, run.method, run.n_steps)
    error, floor, reference = measure(run, trajectory)
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=error,
        floor=floor,
        status=_observed(run, trajectory, error, floor),
        expected_order=expected_order(run),
        reference=reference,
    )


def measure(run: Run, trajectory: Trajectory) -> tuple[float, float, str]:
    """Error, floor and the name of the reference; nan where there is nothing to compare with."""
    problem = run.experiment.problem
    largest = float(np.abs(trajectory.position).max(initial=0.0))
    floor = 100 * EPSILON * largest * float(np.sqrt(run.n_steps))
    if problem.exact is None or trajectory.status == "failed":
        return float("nan"), floor, problem.exact_source
    exact = problem.exact(trajectory.time)
    scale = float(np.abs(exact).max(initial=0.0))
    floor = 100 * EPSILON * scale * float(np.sqrt(run.n_steps))
    error = error_norm(trajectory.position, exact, run.step_size, run.experiment.norm)
    return error, floor, problem.exact_source


def _observed(run: Run, trajectory: Trajectory, error: float, floor: float) -> Observed:
    if trajectory.status != "ok":
        return trajectory.status
    problem = run.experiment.problem
    largest = float(np.abs(trajectory.position).max(initial=0.0))
    if problem.exact is not None:
        scale = float(np.abs(problem.exact(trajectory.time)).max(initial=0.0))
        # an error of ten times the whole solution is no approximation of it
        if not np.isfinite(error) or error > DIVERGED_RATIO * scale > 0:
            return "diverged"
        return "floor" if error < floor else "ok"
    return "diverged" if not np.isfinite(largest) else "ok"


def expected_order(run: Run) -> float:
    """Order that theory expects of this run's method on its problem; nan when none is stated."""
    method, problem = run.method, run.experiment.problem
    if not isinstance(method, Method) or not isinstance(problem, Problem):
        return float("nan")
    return float(method.classical_order)


def _differentiate(problem: DerivativeProblem, run: Run) -> Trajectory:
    """Convolution quadrature of the known function on the grid."""
    method = run.method
    if not isinstance(method, Method) or method.is_runge_kutta:
        raise ValueError("method: a fractional derivative is taken by BDF only")
    h = run.step_size
    grid = h * np.arange(run.n_steps + 1)
    began = time.perf_counter()
    values = left_operator(method.bdf_order, problem.order, h, problem.function(grid))
    return Trajectory(
        time=grid,
        position=values,
        n_steps=run.n_steps,
        step_size=h,
        history_operations=values.size * (run.n_steps + 2) // 2,
        stepping_seconds=time.perf_counter() - began,
    )
