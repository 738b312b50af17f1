"""The run of an experiment that asks for a tolerance in place of numbers of steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.observations.observe import integrate_observed, observe_members
from fvi_cli.integrator.run.checkpoint import RunKeeper, part_of
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.accuracy_settings import Accuracy, Assurance
from fvi_cli.studies.experiment import FinishedRun, Observed, Run
from fvi_cli.studies.norms import error_norm
from fvi_cli.studies.tolerance.equal_steps import solve_on_equal_steps
from fvi_cli.studies.tolerance.runs import gauss
from fvi_cli.studies.tolerance.search import solve

EPSILON = float(np.finfo(float).eps)


def run_for_tolerance(
    search: Run,
    *,
    available_bytes: int | None = None,
    log: Callable[[str], object] = lambda line: None,
    checkpoints: RunKeeper | None = None,
) -> FinishedRun:
    """Find the steps that the experiment's tolerance takes, and finish that run.

    The tolerance holds at any time on adaptive meshes, so that it holds in every norm; in l2 it is
    that of a length times the root of T. Its error is the true one where the exact solution is
    known, at the times that are reported (in l2 on the mesh), otherwise the estimate. What is
    reported between the points of the mesh is held against the polynomials of the run itself, on
    equal steps against an adaptive run; where they differ by more than the tolerance it is not met.

    The finished run is that of the experiment with what was chosen, with an assurance; its status
    is ``refused`` where the tolerance is not kept. `available_bytes` limits runs on equal steps.
    """
    experiment = search.experiment
    accuracy, problem = _wanted(search)
    unit = math.sqrt(problem.final_time) if experiment.norm == "l2" else 1.0
    absolute = accuracy.tolerance
    truth: Trajectory | None = None
    if accuracy.mesh == "uniform":
        method, found, truth = solve_on_equal_steps(
            problem.scene,
            accuracy.candidates,
            tolerance=absolute,
            relative=accuracy.relative,
            norm=experiment.norm,
            available_bytes=available_bytes,
            log=log,
            checkpoints=checkpoints,
        )
        unit = 1.0
    else:
        absolute = None if absolute is None else absolute / unit
        found = solve(
            problem.scene,
            tolerance=absolute,
            relative=accuracy.relative,
            log=log,
            checkpoints=checkpoints,
        )
        if found.steps is None:
            raise ValueError(f"{experiment.name}: no run was made")
        method = gauss(problem.scene, found.steps.tables.degree)
    assessment = found.assessment
    if assessment is None:
        raise ValueError(f"{experiment.name}: no run was made")
    run = experiment.chosen_run(method, max(found.n_steps, 1), search.member)
    on_mesh = _diagnosed(run, problem, found, part_of(checkpoints, "diagnosed"))
    trajectory = on_mesh
    if not run.observations.is_empty and found.status == "ok":
        trajectory = _observed(run, problem, on_mesh, part_of(checkpoints, "observed"))
        if truth is None or experiment.norm == "max":
            assessment = _between_points(trajectory, truth or found, assessment)
    message = _message(run, assessment)
    assurance = Assurance(
        tolerance=accuracy.tolerance or unit * assessment.tolerance,
        estimate=unit * assessment.estimate,
        choice=message,
        attempts=assessment.attempts,
        outcome=assessment.outcome,
        relative=accuracy.relative,
    )
    error, reference = unit * assessment.estimate, "a second run, an estimate"
    exact = problem.exact
    if exact is not None:
        measured = on_mesh if experiment.norm == "l2" else trajectory
        spacing = np.diff(measured.time, prepend=0.0)
        error = error_norm(measured.position, exact(measured.time), spacing, experiment.norm)
        reference = problem.exact_source
    floor = 100 * EPSILON * unit * float(np.abs(trajectory.position).max())
    status: Observed = "floor" if error < floor else "ok"
    remarks = (*trajectory.remarks, f"accuracy: {message}")
    trajectory = replace(trajectory, remarks=remarks, assessment=assessment)
    if assessment.outcome != "met":
        reason = assessment.reason
        if assessment.outcome == "unreliable":
            reason = f"unreliable: {reason}"
        trajectory = replace(trajectory, status="refused", message=reason)
        status = "refused"
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


def _between_points(reported: Trajectory, truth: Trajectory, known: Assessment) -> Assessment:
    """What is known of the error at the times that are reported, held against polynomials."""
    if truth.steps is None or known.outcome != "met" or not reported.time.size:
        return known
    gaps = np.abs(reported.position - truth(reported.time)).max(axis=1)
    worst = int(np.argmax(np.where(np.isnan(gaps), math.inf, gaps)))
    if gaps[worst] <= known.estimate:
        return known
    estimate = known.estimate + float(gaps[worst])
    if estimate <= known.tolerance:
        return replace(known, estimate=estimate)
    time = float(reported.time[worst])
    return replace(
        known,
        outcome="unreliable",
        estimate=estimate,
        reason=f"between the points of the mesh, at t = {time:.6g}, two interpolants differ by "
        f"{gaps[worst]:.2g}; ask for fewer digits, or leave out `output`",
        time=time,
        place=tuple(reported.position[worst].tolist()),
    )


def _wanted(search: Run) -> tuple[Accuracy, Problem]:
    accuracy, problem = search.experiment.accuracy, search.problem
    if accuracy is None or not isinstance(problem, Problem):
        raise ValueError(f"{search.experiment.name}: a tolerance is for a scene without a ladder")
    return accuracy, problem


def _message(run: Run, assessment: Assessment) -> str:
    rounds = len(assessment.attempts)
    adaptive = run.experiment.accuracy is not None and run.experiment.accuracy.mesh == "adaptive"
    steps = f"{run.n_steps} adaptive steps" if adaptive else f"N = {run.n_steps}"
    return (
        f"{method_name(run.method)} on {steps}: estimated error {assessment.estimate:.2g} "
        f"for a tolerance of {assessment.tolerance:.3g}, {assessment.outcome} after {rounds} "
        f"round{'' if rounds == 1 else 's'}"
    )


def _diagnosed(
    run: Run, problem: Problem, found: Trajectory, checkpoints: RunKeeper | None
) -> Trajectory:
    """The run, once more on its own mesh where it is wanted with its bookkeeping."""
    request = run.experiment.diagnostics
    if request.is_empty or found.status != "ok" or not isinstance(run.method, Method):
        return found
    steps = found.n_steps
    scene, keeps = problem.scene, found.steps is not None
    mesh = steps if found.steps is None else found.steps.mesh(scene.break_points)
    again = integrate(
        scene, run.method, mesh, diagnostics=request, with_steps=keeps, checkpoints=checkpoints
    )
    return replace(again, assessment=found.assessment, doubts=found.doubts)


def _observed(
    run: Run, problem: Problem, found: Trajectory, checkpoints: RunKeeper | None
) -> Trajectory:
    """The run at the requested times, with its quantities and events."""
    request, method = run.observations, run.method
    if found.steps is not None and isinstance(method, Method):
        ((_, reported),) = observe_members(
            [problem.scene], method, [found], [request], checkpoints=checkpoints
        )
        return reported
    scene, diagnostics = problem.scene, run.experiment.diagnostics
    reported = integrate_observed(
        scene, method, run.n_steps, request, diagnostics=diagnostics, checkpoints=checkpoints
    )[1]
    return replace(reported, assessment=found.assessment)
