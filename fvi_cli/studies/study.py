"""Runs with their errors, computed and measured."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvi_cli.integrator.integrate import integrate_members
from fvi_cli.integrator.meshes.graded import order_on
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import StabilityPrediction, predict_stability
from fvi_cli.integrator.stability.region import StabilityMap
from fvi_cli.integrator.trajectory import Status, Trajectory
from fvi_cli.mathematics.bdf import left_operator
from fvi_cli.scenes.problem import DerivativeProblem
from fvi_cli.studies.experiment import Experiment, FinishedRun, Observed, Run
from fvi_cli.studies.norms import NORMS, Measured, error_norm, point_weights, unit_of
from fvi_cli.studies.reference import WITHOUT_END, Reference, reference_of
from fvi_cli.studies.tolerance.experiment_run import run_for_tolerance

DIVERGED_RATIO = 10.0
EPSILON = float(np.finfo(float).eps)


def execute(run: Run, reference: Reference | None = None) -> FinishedRun:
    """Compute one run and its error, as :func:`execute_batch` does."""
    (found,) = execute_batch((run,), [reference])
    return found


def execute_batch(runs: Sequence[Run], references: Sequence[Reference | None]) -> list[FinishedRun]:
    """Compute runs by one method on one number of steps, e.g. members of a sweep; or one search.

    A run that fails does not disturb the others. A reference that is None is found here.
    """
    if runs[0].is_search:
        return list(map(run_for_tolerance, runs))
    found = {
        run: _differentiate(run.problem, run)
        for run in runs
        if isinstance(run.problem, DerivativeProblem)
    }
    moving = [run for run in runs if run not in found]
    method, diagnostics = runs[0].method, runs[0].experiment.diagnostics
    trajectories = integrate_members(
        [run.scene for run in moving],
        method,
        [run.steps for run in moving],
        observe=[run.observations for run in moving],
        diagnostics=diagnostics and isinstance(method, Method),
        with_steps=runs[0].keeps_steps,
    )
    found |= zip(moving, trajectories, strict=True)
    return [
        assessed(run, found[run], prediction_of(run), reference or reference_of(run))
        for run, reference in zip(runs, references, strict=True)
    ]


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
        seconds=time.perf_counter() - began,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityRow:
    """One method on one member with one step size."""

    run: Run
    prediction: StabilityPrediction


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """The stability study of one experiment."""

    experiment: Experiment
    rows: tuple[StabilityRow, ...]
    regions: tuple[StabilityMap, ...] = ()


def prediction_of(run: Run) -> StabilityPrediction:
    """The predicted stability of a run."""
    scene = run.problem.scene
    if scene is None:
        return StabilityPrediction(verdict="unknown", reason="no motion to integrate")
    return predict_stability(scene, run.method, run.n_steps)


def assessed(
    run: Run, found: Trajectory, prediction: StabilityPrediction, reference: Reference
) -> FinishedRun:
    """The run with its error against `reference` on its mesh, and with remarks on it."""
    trajectory = found.on_mesh or found
    exact = reference.values(trajectory.time)
    compared = exact if reference.is_known else trajectory.position
    weights = point_weights(trajectory.time)
    errors = dict.fromkeys(NORMS, float("nan"))
    if trajectory.status != "failed":
        errors = {norm: error_norm(trajectory.position, exact, weights, norm) for norm in NORMS}
    measured = Measured(
        **errors,
        largest=float(np.abs(compared).max(initial=0.0)),
        round_off=100.0 * EPSILON * math.sqrt(run.n_steps),
        reference=reference.error,
    )
    remarks = _remarks(run, trajectory, prediction)
    if reference.source.startswith(WITHOUT_END):
        remarks += (f"error: not known, reference: {reference.source}",)
    coordinates = run.problem.coordinates
    return FinishedRun(
        run=run,
        trajectory=replace(found, on_mesh=None, remarks=remarks, coordinates=coordinates),
        **judged(run, trajectory.status, measured),
        predicted=prediction.verdict,
        order_smooth=order_smooth_of(run),
        reference=reference.source,
        measured=measured,
    )


def _remarks(run: Run, trajectory: Trajectory, prediction: StabilityPrediction) -> tuple[str, ...]:
    """Remarks on a run for the reader of a table."""
    experiment, scene, n_steps = run.experiment, run.problem.scene, run.n_steps
    found = list(trajectory.remarks)
    if scene is not None:
        # only on the finest steps of a ladder
        if n_steps >= max(experiment.steps) and scene.forcing is not None:
            # the longest of N steps that end at T (k/N)^r
            share = 1.0 - (1.0 - 1.0 / n_steps) ** experiment.grading
            found += scene.forcing.remarks(scene.final_time, scene.final_time * share)
        if prediction.verdict == "unstable":
            found.append(f"predicted unstable: {prediction.reason}")
    return tuple(found)


def judged(run: Run, status: Status, measured: Measured) -> dict[str, Any]:
    """Error, floor and status of a finished run in the norm of its experiment."""
    norm, problem = run.experiment.norm, run.experiment.problem
    unit = unit_of(norm, problem.final_time, problem.dimension)
    error, floor = getattr(measured, norm), unit * measured.floor
    known: Observed = status
    if status == "ok" and not math.isnan(measured.reference):
        # the error is many times the whole solution: this is no approximation
        if not np.isfinite(error) or error > DIVERGED_RATIO * unit * measured.largest > 0:
            known = "diverged"
        elif error < floor:
            known = "floor"
    return {"error": error, "floor": floor, "status": known}


def order_smooth_of(run: Run) -> float:
    """Order on smooth data; nan where it is not to be expected."""
    scene = run.problem.scene
    return math.nan if scene is None else order_on(scene, run.method, run.experiment.grading)


def with_peak_errors(finished: Sequence[FinishedRun]) -> list[FinishedRun]:
    """Runs of ladders with the errors of their peaks, where two runs of a method reached T.

    The error of a run is its difference from the finest run; the error of the finest run is its
    difference from the run before, which is larger than its error. Runs for a tolerance keep their
    errors.
    """
    ladders: dict[tuple[object, ...], list[int]] = {}
    for index, one in enumerate(finished):
        if one.status in ("ok", "floor") and not one.run.is_search and one.trajectory.observed:
            member = one.run.member and one.run.member.number
            key = (one.run.experiment.name, member, one.run.method.case)
            ladders.setdefault(key, []).append(index)
    found = list(finished)
    for ladder in ladders.values():
        ladder.sort(key=lambda index: finished[index].run.n_steps)
        pairs = [(index, ladder[-1]) for index in ladder[:-1]]
        for index, other in (*pairs, *((b, a) for a, b in itertools.pairwise(ladder[-2:]))):
            found[index] = _compared(finished[index], finished[other])
    return found


def _compared(one: FinishedRun, other: FinishedRun) -> FinishedRun:
    own, its = one.trajectory.observed, other.trajectory.observed
    if own is None or its is None:
        return one
    extents = {
        name: replace(extent, error=abs(extent.peak - its.extents[name].peak))
        for name, extent in own.extents.items()
    }
    return replace(one, trajectory=replace(one.trajectory, observed=replace(own, extents=extents)))
