"""The study: a generator of finished runs."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS
from fvi_cli.integrator.break_points import interpolation_remarks
from fvi_cli.integrator.growth_bound import GAINS_ENERGY
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.observe import integrate_observed
from fvi_cli.integrator.run.checkpoint import RunKeeper
from fvi_cli.integrator.stability.limits import refusal
from fvi_cli.integrator.stability.prediction import (
    StabilityPrediction,
    predict_stability,
    stability_along,
)
from fvi_cli.integrator.trajectory import Status, Trajectory
from fvi_cli.mathematics.operators import left_operator
from fvi_cli.planning.expected_order import expected_order
from fvi_cli.planning.resolution import resolution_remarks
from fvi_cli.planning.round_off import relative_round_off
from fvi_cli.scenes.problem import DerivativeProblem, Problem
from fvi_cli.studies.experiment import (
    NEEDS_LADDER,
    Experiment,
    FinishedRun,
    Observed,
    Run,
)
from fvi_cli.studies.members import Member
from fvi_cli.studies.norms import NORMS, Measured, error_norm, point_weights
from fvi_cli.studies.reference import Reference, find_reference, find_references, unknown_reference

DIVERGED_RATIO = 10.0

KEPT_BYTES = 2**25
"""Runs whose points take no more are kept whole until their error is measured."""

UNRELIABLE = 0.01
"""A floor above this part of the largest value leaves no error to speak of."""


def study(
    experiment: Experiment, finished: Callable[[Run], FinishedRun | None] = lambda run: None
) -> Iterator[FinishedRun]:
    """Every run of `experiment`, method by method, steps increasing, or what `finished` has of it.

    Raises
    ------
    ValueError
        If the experiment asks for a tolerance
        (:func:`fvi_cli.studies.tolerance.experiment_run.run_for_tolerance` is for these).
    """
    if experiment.needs_search:
        raise ValueError(f"{experiment.name}: {NEEDS_LADDER}")
    for run in experiment.runs():
        yield finished(run) or execute(run)


def execute(
    run: Run, checkpoints: RunKeeper | None = None, reference: Reference | None = None
) -> FinishedRun:
    """Compute one run and its error, unless it is predicted to blow up and that is not wanted.

    A `reference` that is not given is found here.
    """
    problem, prediction = run.problem, prediction_of(run)
    reference = reference or reference_of(run)
    if is_refused(run, prediction):
        return refused(run, prediction, reference)
    if isinstance(problem, DerivativeProblem):
        trajectory = _differentiate(problem, run)
    elif not run.observations.is_empty:
        return _observed_and_assessed(run, problem, prediction, checkpoints, reference)
    else:
        request, is_ours = run.experiment.diagnostics, isinstance(run.method, Method)
        trajectory = with_remark_on_thinning(
            integrate(
                problem.scene,
                run.method,
                run.steps,
                every=thinning_of(run),
                diagnostics=request if is_ours else NO_DIAGNOSTICS,
                checkpoints=checkpoints,
            )
        )
        if not (request.is_empty or is_ours):
            remark = "no diagnostics: the method keeps no increments of its steps"
            trajectory = dataclasses.replace(trajectory, remarks=(*trajectory.remarks, remark))
    return assessed(run, trajectory, prediction, reference)


def _observed_and_assessed(
    run: Run,
    problem: Problem,
    prediction: StabilityPrediction,
    checkpoints: RunKeeper | None,
    reference: Reference,
) -> FinishedRun:
    """The run with its error on the mesh, reported at the times that are asked for."""
    request = run.observations
    pair = integrate_observed(
        problem.scene,
        run.method,
        run.n_steps if request.impacts else run.steps,
        request,
        diagnostics=run.experiment.diagnostics,
        checkpoints=checkpoints,
    )
    return assessed_pair(run, pair, prediction, reference)


def assessed_pair(
    run: Run,
    pair: tuple[Trajectory, Trajectory],
    prediction: StabilityPrediction,
    reference: Reference,
) -> FinishedRun:
    """A finished run from what it is on its mesh and at the times that are asked for."""
    on_mesh, reported = pair
    finished = assessed(run, dataclasses.replace(on_mesh, steps=None), prediction, reference)
    reported = dataclasses.replace(
        reported,
        steps=None,
        remarks=finished.trajectory.remarks,
        coordinates=run.observations.coordinates,
    )
    return dataclasses.replace(finished, trajectory=reported)


def is_refused(run: Run, prediction: StabilityPrediction) -> bool:
    """Whether the run is not to be computed, by what is predicted and what is wanted."""
    return prediction.verdict == "unstable" and not run.experiment.allow_unstable


def assessed(
    run: Run, trajectory: Trajectory, prediction: StabilityPrediction, reference: Reference
) -> FinishedRun:
    """The run with its error against `reference`, and what is to be said of it."""
    experiment = run.experiment
    remarks = trajectory.remarks
    if prediction.verdict == "unstable":
        # that is what was predicted; from which N on it shows depends on round-off
        remarks = tuple(one for one in remarks if one != GAINS_ENERGY)
    if isinstance(run.problem, Problem):
        remarks += interpolation_remarks(run.problem.scene, run.n_steps, grading=experiment.grading)
        remarks += _resolved(run, run.problem)
    remarks += stability_remarks(run, trajectory, prediction)
    exact = reference.at(trajectory.time)
    compared = exact if reference.is_known else trajectory.position
    scene = run.problem.scene if isinstance(run.problem, Problem) else None
    spacing = point_weights(trajectory.time, run.step_size, trajectory.every, experiment.grading)
    errors = dict.fromkeys(NORMS, float("nan"))
    if trajectory.status != "failed":
        errors = {norm: error_norm(trajectory.position, exact, spacing, norm) for norm in NORMS}
    measured = Measured(
        **errors,
        largest=float(np.abs(compared).max(initial=0.0)),
        round_off=relative_round_off(scene, run.method, run.n_steps),
        reference=reference.error,
    )
    if measured.floor("max", 1.0) > UNRELIABLE * measured.largest > 0:
        remarks += (
            "reference: unreliable, its refined runs differ by too much of the motion (chaos, or a "
            "motion too rough for them): the error is meaningless",
        )
    names = run.problem.coordinates if isinstance(run.problem, Problem) else ()
    trajectory = dataclasses.replace(trajectory, remarks=remarks, coordinates=names)
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        **judged(run, trajectory.status, measured),
        predicted=prediction.verdict,
        expected_order=expected_order_of(run),
        reference=reference.source,
        measured=measured,
    )


def judged(run: Run, status: Status, measured: Measured) -> dict[str, Any]:
    """Error, floor and status of a finished run in the norm of its experiment."""
    norm, final_time = run.experiment.norm, run.experiment.problem.final_time
    error, floor = getattr(measured, norm), measured.floor(norm, final_time)
    known: Observed = status
    if not math.isnan(measured.reference):
        known = _observed(status, error, floor, measured.scale(norm, final_time))
    return {"error": error, "floor": floor, "status": known}


def _resolved(run: Run, problem: Problem) -> tuple[str, ...]:
    """A warning where even the finest steps of a ladder are too long for what they meet."""
    experiment = run.experiment
    if run.n_steps < max(experiment.steps) or getattr(run.method, "name", "") == "dop853":
        return ()
    return resolution_remarks(problem.scene, run.n_steps, grading=experiment.grading)


def stability_remarks(
    run: Run, trajectory: Trajectory, prediction: StabilityPrediction
) -> tuple[str, ...]:
    """A warning of growth that is let through, or of a nonlinear scene that is linearised."""
    if prediction.is_noticed(run.n_steps) or prediction.linearised_verdict == "unstable":
        return (f"stability: {prediction.reason}",)
    problem = run.problem
    if not isinstance(problem, Problem) or problem.scene.is_linear:
        return ()
    worst = stability_along(problem.scene, run.method, run.n_steps, trajectory)
    if worst is None or worst[1].verdict != "unstable":
        return ()
    time, there = worst
    return (f"stability: nonlinear; linearised on the path at t = {time:.6g}: {there.reason}",)


def thinning_of(run: Run) -> int:
    """n: every n-th point is in memory; 1 unless there is no room for all and the method can.

    Errors are those of all points wherever these are in memory.
    """
    method, problem = run.method, run.problem
    is_memory_free = isinstance(method, Method) and method.history == "exponentials"
    dimension = problem.scene.dimension if isinstance(problem, Problem) else 1
    fits = 8 * (run.n_steps + 1) * (2 * dimension + 2) <= KEPT_BYTES
    return run.experiment.store_every if is_memory_free and not fits else 1


def with_remark_on_thinning(trajectory: Trajectory) -> Trajectory:
    """The trajectory, with a remark where points are missing from it."""
    if trajectory.every == 1:
        return trajectory
    remark = f"errors are measured on the stored points: every {trajectory.every}th, and the last"
    return dataclasses.replace(trajectory, remarks=(*trajectory.remarks, remark))


def prediction_of(run: Run) -> StabilityPrediction:
    """What is known of the run's stability before it is computed."""
    problem = run.problem
    if not isinstance(problem, Problem):
        return StabilityPrediction(verdict="unknown", reason="no motion to integrate")
    return predict_stability(problem.scene, run.method, run.n_steps)


def refused(run: Run, prediction: StabilityPrediction, reference: Reference) -> FinishedRun:
    """The run with its start and the reason why there is no more of it."""
    problem = run.problem
    if not isinstance(problem, Problem):  # pragma: no cover - only scenes are predicted
        raise ValueError("run: a derivative has no stability")
    scene = problem.scene
    position = scene.initial_position[None]
    momentum = (scene.inertia.mass @ scene.initial_velocity)[None]
    return FinishedRun(
        run=run,
        trajectory=Trajectory(
            time=np.zeros(1),
            position=position,
            momentum=momentum,
            energy=scene.energy(position, momentum),
            n_steps=run.n_steps,
            step_size=run.step_size,
            status="refused",
            message=refusal(scene, run.method, run.n_steps, prediction),
        ),
        error=float("nan"),
        floor=0.0,
        status="refused",
        predicted=prediction.verdict,
        expected_order=expected_order_of(run),
        reference=reference.source,
    )


def needs_refined_run(run: Run) -> bool:
    """Whether the error may be measured against a refined run, which is looked for."""
    problem = run.experiment.problem
    if run.is_search or run.experiment.observations.impacts or problem.exact_source == "none":
        return False
    return run.member is not None or problem.exact is None


def refined_references(runs: Sequence[Run]) -> list[Reference | None]:
    """Refined runs of the scenes of runs of one experiment, at the times of its whole ladder.

    None for a scene with an exact solution.
    """
    experiment, problems = runs[0].experiment, [run.problem for run in runs]
    wanted = [one for one in problems if one.exact is None]
    times = np.unique(
        np.concatenate([dataclasses.replace(runs[0], n_steps=n).times for n in experiment.steps])
    )
    found = iter(find_references(wanted, experiment.steps, grading=experiment.grading))
    return [next(found).tabulated(times) if one.exact is None else None for one in problems]


def reference_of(run: Run) -> Reference:
    """What the error of `run` is measured against; made once for all runs of its problem."""
    return _reference_of(run.experiment, run.member)


@functools.lru_cache(maxsize=8)
def _reference_of(experiment: Experiment, member: Member | None) -> Reference:
    problem = experiment.problem if member is None else member.problem
    if isinstance(problem, Problem) and experiment.observations.impacts:
        return unknown_reference(problem.scene, "none (a motion with impacts)")
    return find_reference(problem, experiment.steps, grading=experiment.grading)


def _observed(status: Status, error: float, floor: float, scale: float) -> Observed:
    if status != "ok":
        return status
    # an error of ten times the whole solution is no approximation of it
    if not np.isfinite(error) or error > DIVERGED_RATIO * scale > 0:
        return "diverged"
    return "floor" if error < floor else "ok"


def expected_order_of(run: Run) -> float:
    """The order that theory expects of a run in the norm of its experiment; nan: none is stated."""
    problem = run.problem
    if not isinstance(problem, Problem):
        return float("nan")
    experiment = run.experiment
    return expected_order(
        problem.scene, run.method, experiment.norm, run.n_steps, grading=experiment.grading
    )


def _differentiate(problem: DerivativeProblem, run: Run) -> Trajectory:
    """Convolution quadrature of the known function on the grid."""
    method = run.method
    if not isinstance(method, Method) or method.is_runge_kutta:
        raise ValueError("method: a fractional derivative is taken by BDF only")
    h = run.step_size
    grid = h * np.arange(run.n_steps + 1, dtype=float)
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
