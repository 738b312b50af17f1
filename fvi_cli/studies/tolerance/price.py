"""What an accuracy costs that is asked for by tolerance, search and all."""

from __future__ import annotations

import math

from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.cost import ToleranceRow, timed_run
from fvi_cli.studies.experiment import Experiment
from fvi_cli.studies.norms import error_norm, point_weights
from fvi_cli.studies.study import reference_of
from fvi_cli.studies.tolerance.search import solve

TOLERANCES = tuple(10.0**-k for k in range(3, 12, 2))
"""1e-3, 1e-5, ... 1e-11."""

REPEATS = 3
LONG_SECONDS = 2.0
"""Searches that take longer are timed once."""


def measure_tolerance(experiment: Experiment, tolerance: float) -> ToleranceRow:
    """Search for a tolerance, timed.

    Raises
    ------
    ValueError
        If the experiment has no scene.
    """
    problem = experiment.problem
    if not isinstance(problem, Problem):
        raise ValueError(f"{experiment.name}: costs are measured of scenes, not of a derivative")
    scene, seconds = problem.scene, math.inf
    found: list[Trajectory] = []

    def search() -> Trajectory:
        found[:] = [solve(scene, tolerance=tolerance)]
        return found[0]

    for _ in range(REPEATS):
        seconds = min(seconds, timed_run(search)[0])
        if seconds > LONG_SECONDS:
            break
    (run,) = found
    if run.assessment is None or run.steps is None:
        raise ValueError(f"{experiment.name}: no run was made")
    finest = max(experiment.runs(), key=lambda one: one.n_steps)
    error = math.nan
    if run.status == "ok":
        times, exact = finest.times, reference_of(finest).values(finest.times)
        weights = point_weights(times, finest.step_size, 1, experiment.grading)
        error = error_norm(run.steps(times), exact, weights, experiment.norm)
    return ToleranceRow(
        tolerance=tolerance,
        outcome=run.assessment.outcome,
        error=error,
        estimate=run.assessment.estimate,
        n_steps=run.n_steps,
        degree=run.steps.tables.degree,
        rounds=len(run.assessment.attempts),
        seconds=seconds,
    )
