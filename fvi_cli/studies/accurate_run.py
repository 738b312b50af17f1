"""The run of an experiment that asks for a tolerance in place of numbers of steps."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.accuracy import likely_choices, reach_tolerance
from fvi_cli.studies.accuracy_results import Choice, Reached
from fvi_cli.studies.accuracy_settings import Accuracy, Assurance
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import Reference
from fvi_cli.studies.study import assessed, observed_and_assessed, prediction_of, refused
from fvi_cli.studies.tolerance.experiment_run import solve_experiment


def choices_for(experiment: Experiment, *, available_bytes: int | None = None) -> list[Choice]:
    """What every candidate is thought to take, the one that would be tried first at the front."""
    accuracy, problem = _wanted(experiment)
    if experiment.finds_steps:
        return []
    return likely_choices(
        problem.scene,
        accuracy.candidates,
        accuracy.absolute,
        experiment.norm,
        available_bytes=available_bytes,
        allow_unstable=experiment.allow_unstable,
    )


def run_for_tolerance(
    experiment: Experiment,
    *,
    available_bytes: int | None = None,
    tell: Callable[[str], object] = lambda line: None,
) -> FinishedRun:
    """Choose method and number of steps for the experiment's tolerance, and finish that run.

    Its error is the true one where the exact solution is known, otherwise the estimate.

    Parameters
    ----------
    experiment
        An experiment with a tolerance and one scene.
    available_bytes, tell
        As for :func:`fvi_cli.studies.accuracy.reach_tolerance`.

    Returns
    -------
    FinishedRun
        Of the experiment with what was chosen, with an assurance. Status ``refused`` where the
        tolerance is below the floor or cannot be reached.
    """
    accuracy, problem = _wanted(experiment)
    if experiment.finds_steps:
        return solve_experiment(experiment, problem, accuracy, tell)
    reached = reach_tolerance(
        problem.scene,
        accuracy.candidates,
        accuracy.absolute,
        experiment.norm,
        available_bytes=available_bytes,
        allow_unstable=experiment.allow_unstable,
        tell=tell,
    )
    chosen = experiment.with_choice(reached.method, reached.n_steps)
    (run,) = chosen.runs()
    assurance = Assurance(
        tolerance=accuracy.absolute,
        estimate=reached.estimate,
        choice=reached.message,
        attempts=reached.attempts,
        outcome="refused" if reached.verdict == "refused" else "met",
    )
    finished = _refused(run, reached) if reached.verdict == "refused" else _kept(run, reached)
    return dataclasses.replace(finished, assurance=assurance)


def _wanted(experiment: Experiment) -> tuple[Accuracy, Problem]:
    if experiment.accuracy is None or experiment.members:
        raise ValueError(f"{experiment.name}: a tolerance is for one scene without a ladder")
    if not isinstance(experiment.problem, Problem):
        raise ValueError(f"{experiment.name}: a derivative has no steps to be chosen")
    return experiment.accuracy, experiment.problem


def _kept(run: Run, reached: Reached) -> FinishedRun:
    problem = run.problem
    known = problem.exact is not None
    reference = _nothing(run)
    if problem.exact is not None:
        reference = Reference(values=problem.exact, error=0.0, source=problem.exact_source)
    told = f"accuracy: {reached.message}"
    if run.observations.is_empty or not isinstance(problem, Problem):
        trajectory = _diagnosed(run, reached.trajectory)
        trajectory = dataclasses.replace(trajectory, remarks=(*trajectory.remarks, told))
        finished = assessed(run, trajectory, prediction_of(run), reference)
    else:
        finished = observed_and_assessed(run, problem, prediction_of(run), reference)
        trajectory = finished.trajectory
        trajectory = dataclasses.replace(trajectory, remarks=(*trajectory.remarks, told))
        finished = dataclasses.replace(finished, trajectory=trajectory)
    if known:
        return finished
    source = f"N = {reached.n_steps // 2} steps of the same method, an estimate"
    return dataclasses.replace(finished, error=reached.estimate, reference=source)


def _diagnosed(run: Run, trajectory: Trajectory | None) -> Trajectory:
    """The run, once more where it is wanted with its bookkeeping; the same to round-off."""
    asked = run.experiment.diagnostics
    problem = run.problem
    if trajectory is not None and (asked.is_empty or not isinstance(run.method, Method)):
        return trajectory
    if not isinstance(problem, Problem):  # pragma: no cover - refused before
        raise ValueError("accuracy: nothing is integrated")
    return integrate(problem.scene, run.method, run.n_steps, diagnostics=asked)


def _refused(run: Run, reached: Reached) -> FinishedRun:
    finished = refused(run, prediction_of(run), _nothing(run))
    trajectory = dataclasses.replace(finished.trajectory, message=reached.message)
    return dataclasses.replace(finished, trajectory=trajectory)


def _nothing(run: Run) -> Reference:
    dimension = run.problem.scene.dimension if isinstance(run.problem, Problem) else 1
    return Reference(
        values=lambda times: np.full((times.size, dimension), math.nan),
        error=math.nan,
        source="none",
    )
