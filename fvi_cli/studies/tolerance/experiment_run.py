"""The run of an experiment on the mesh that its tolerance takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.observations.observe import observe
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.accuracy_settings import Accuracy, Assurance
from fvi_cli.studies.experiment import Experiment, FinishedRun, Observed, Run
from fvi_cli.studies.norms import error_norm
from fvi_cli.studies.tolerance.runs import gauss, mesh_of_run
from fvi_cli.studies.tolerance.search import solve

EPSILON = float(np.finfo(float).eps)


def solve_experiment(
    experiment: Experiment,
    problem: Problem,
    accuracy: Accuracy,
    tell: Callable[[str], object],
) -> FinishedRun:
    """Solve the scene of an experiment to its tolerance.

    The tolerance holds at any time, so that it holds in every norm; in l2 it is that of a length
    times the root of T.
    """
    unit = math.sqrt(problem.final_time) if experiment.norm == "l2" else 1.0
    absolute = None if accuracy.tolerance is None else accuracy.tolerance / unit
    found = solve(problem.scene, tolerance=absolute, relative=accuracy.relative, tell=tell)
    assessment = found.assessment
    if assessment is None or found.steps is None:
        raise ValueError(f"{experiment.name}: nothing was run")
    method = gauss(problem.scene, found.steps.tables.degree)
    (run,) = experiment.with_choice(method, max(found.n_steps, 1)).runs()
    message = _message(run, assessment)
    assurance = Assurance(
        tolerance=accuracy.tolerance or unit * assessment.tolerance,
        estimate=unit * assessment.estimate,
        choice=message,
        attempts=assessment.attempts,
        outcome=assessment.outcome,
        relative=accuracy.relative,
    )
    trajectory = _diagnosed(run, problem, found)
    remarks = (*trajectory.remarks, f"accuracy: {message}")
    trajectory = replace(trajectory, remarks=remarks)
    error, reference = unit * assessment.estimate, "a second run, an estimate"
    exact = problem.exact
    if exact is not None:
        spacing = np.diff(trajectory.time, prepend=0.0)
        error = error_norm(trajectory.position, exact(trajectory.time), spacing, experiment.norm)
        reference = problem.exact_source
    floor = 100 * EPSILON * unit * float(np.abs(trajectory.position).max())
    status: Observed = "floor" if error < floor else "ok"
    if assessment.outcome != "met":
        reason = assessment.reason
        if assessment.outcome == "unreliable":
            reason = f"unreliable: {reason}"
        trajectory = replace(trajectory, status="refused", message=reason)
        status = "refused"
    if not run.observations.is_empty and found.status == "ok":
        _, reported = observe(problem.scene, method, trajectory, run.observations)
        trajectory = replace(reported, remarks=remarks)
    trajectory = replace(trajectory, steps=None)
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=error,
        floor=floor,
        status=status,
        predicted="unknown",
        reference=reference,
        assurance=assurance,
    )


def _message(run: Run, assessment: Assessment) -> str:
    rounds = len(assessment.attempts)
    return (
        f"{run.method.case} on {run.n_steps} adaptive steps: estimated error "
        f"{assessment.estimate:.2g} at any time for a tolerance of {assessment.tolerance:.3g}, "
        f"{assessment.outcome} after {rounds} round{'' if rounds == 1 else 's'}"
    )


def _diagnosed(run: Run, problem: Problem, found: Trajectory) -> Trajectory:
    """The run, once more on its own mesh where it is wanted with its bookkeeping."""
    asked = run.experiment.diagnostics
    if asked.is_empty or found.steps is None or found.status != "ok":
        return found
    mesh = mesh_of_run(found.steps, problem.scene.break_points)
    again = integrate(problem.scene, run.method, mesh, diagnostics=asked, with_steps=True)
    return replace(again, assessment=found.assessment, doubts=found.doubts)
