"""The run of an experiment with a tolerance in place of numbers of steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from fvi_cli.integrator.integrate import integrate, integrate_members
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.observer import observe_runs
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.studies.accuracy_settings import Assurance
from fvi_cli.studies.experiment import FinishedRun, Observed, Run
from fvi_cli.studies.norms import error_norm, point_weights, unit_of
from fvi_cli.studies.tolerance.runs import gauss
from fvi_cli.studies.tolerance.search import solve_by_two_runs

EPSILON = float(np.finfo(float).eps)


def run_for_tolerance(
    search: Run, *, log: Callable[[str], object] = lambda line: None
) -> FinishedRun:
    """Find the steps that the experiment's tolerance needs, and finish their run.

    The tolerance holds at any time, and so in every norm; in l2 it is times the root of T d.
    The error of the run is its true error at the reported times (in l2 on the mesh) where the exact
    solution is known, otherwise the estimate.

    The finished run belongs to the experiment with the chosen method and steps, and has an
    assurance; its status is ``refused`` where the tolerance is not kept.
    """
    experiment, scene, accuracy = search.experiment, search.scene, search.experiment.accuracy
    if accuracy is None:
        raise ValueError(f"{experiment.name}: no tolerance is asked for")
    unit = unit_of(experiment.norm, scene.final_time, scene.dimension)
    tolerance = accuracy.tolerance
    wanted = accuracy
    if tolerance is not None:
        wanted = accuracy.model_copy(update={"tolerance": tolerance / unit})
    found, other = solve_by_two_runs(scene, wanted, log=log)
    method = gauss(scene, 0 if found.steps is None else found.steps.tables.degree)
    known = found.assessment
    if known is None:  # pragma: no cover - a solved run has one
        raise ValueError(f"{experiment.name}: no run was made")
    run = experiment.chosen_run(method, max(found.n_steps, 1), search.member)
    on_mesh = trajectory = _diagnosed(run, found)
    if not run.observations.is_empty and found.status == "ok":
        trajectory = _observed(run, on_mesh)
        trajectory = _with_errors(run, trajectory, other, known.estimate)
    error, reference, exact = unit * known.estimate, "a second run, an estimate", run.problem.exact
    if exact is not None:
        measured = on_mesh if experiment.norm == "l2" else trajectory
        weights = point_weights(measured.time, found.step_size, 1)
        error = error_norm(measured.position, exact(measured.time), weights, experiment.norm)
        reference = run.problem.exact_source
        known = _held_against_exact(
            known, error, accuracy.tolerance or unit * known.tolerance, unit
        )
    floor = 100 * EPSILON * unit * float(np.abs(trajectory.position).max())
    status: Observed = "floor" if error < floor else "ok"
    steps = on_mesh.steps if run.keeps_steps else None
    trajectory = replace(trajectory, assessment=known, steps=steps, on_mesh=None)
    if known.outcome != "met":
        reason = "unreliable: " * (known.outcome == "unreliable") + known.reason
        trajectory, status = replace(trajectory, status="refused", message=reason), "refused"
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=error,
        floor=floor,
        status=status,
        reference=reference,
        assurance=Assurance(
            tolerance=tolerance or unit * known.tolerance,
            estimate=unit * known.estimate,
            attempts=known.attempts,
            outcome=known.outcome,
            relative=accuracy.relative,
        ),
    )


def _diagnosed(run: Run, found: Trajectory) -> Trajectory:
    """The run; if diagnostics are requested it is computed again on its own mesh, with them."""
    request = run.experiment.diagnostics
    if not request or found.status != "ok" or not isinstance(run.method, Method):
        return found
    again = integrate(
        run.scene,
        run.method,
        found.n_steps if found.steps is None else found.steps.mesh(run.scene.break_points),
        diagnostics=request,
        with_steps=found.steps is not None,
    )
    return replace(again, assessment=found.assessment)


def _observed(run: Run, found: Trajectory) -> Trajectory:
    """The run at the requested times, with its quantities and events."""
    request, diagnostics = run.observations, run.experiment.diagnostics
    if found.steps is not None:
        (reported,) = observe_runs([run.scene], run.method, [found], [request])
        return reported
    (reported,) = integrate_members(
        [run.scene], run.method, run.n_steps, observe=[request], diagnostics=diagnostics
    )
    return reported


def _with_errors(
    run: Run, reported: Trajectory, other: Trajectory | None, error: float
) -> Trajectory:
    """The run with the errors of its quantities: their differences from the `other` run.

    Reported values and peaks are compared. The differences are enlarged by the factor by which the
    estimated `error` of the position is larger than the difference of positions.
    """
    observed = reported.observed
    if observed is None or not observed.quantities or other is None or other.steps is None:
        return reported
    times = np.unique(reported.time)
    request = replace(run.observations, times=times, output=None, events={}, impacts={})
    method = gauss(run.scene, other.steps.tables.degree)
    (there,) = observe_runs([run.scene], method, [other], [request])
    if there.observed is None:  # pragma: no cover - it was asked for
        return reported
    at, extents = np.searchsorted(times, reported.time), {}
    difference = float(np.abs(reported.position - there.position[at]).max(initial=0.0))
    factor = max(1.0, error / difference) if difference else 1.0
    for name, extent in observed.extents.items():
        gaps = observed.quantities[name] - there.observed.quantities[name][at]
        # forces that are infinite at the start have no difference
        gaps = np.append(gaps[np.isfinite(gaps)], extent.peak - there.observed.extents[name].peak)
        extents[name] = replace(extent, error=factor * float(np.abs(gaps).max()))
    return replace(reported, observed=replace(observed, extents=extents))


def _held_against_exact(
    known: Assessment, error: float, tolerance: float, unit: float
) -> Assessment:
    """The assessment; unreliable where the exact solution differs by more than the tolerance."""
    if known.outcome != "met" or error <= tolerance:
        return known
    return replace(
        known,
        outcome="unreliable",
        reason=f"the exact solution differs from the run by {error:.2g}, a second run by "
        f"{unit * known.estimate:.2g}; write exact: none to go by the second run",
    )
