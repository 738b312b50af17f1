"""The run of an experiment with a tolerance in place of numbers of steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.observe.observer import observe_runs
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.studies.experiment import FinishedRun, Observed, Run
from fvi_cli.studies.norms import error_norm, point_weights, unit_of
from fvi_cli.studies.tolerance.runs import gauss
from fvi_cli.studies.tolerance.search import solve_by_two_runs

EPSILON = float(np.finfo(float).eps)


def run_for_tolerance(search: Run) -> FinishedRun:
    """Find the steps that the experiment's tolerance needs, and finish their run.

    The tolerance holds at any time, and so in every norm; in l2 it is times the root of T d. The
    error of the run is its true error at the reported times (in l2 on the mesh) where the exact
    solution is known, otherwise the estimate.

    The finished run belongs to the experiment with the chosen method and steps; its status is
    ``refused`` where the tolerance is not kept.
    """
    experiment, scene, accuracy = search.experiment, search.scene, search.experiment.accuracy
    if accuracy is None:
        raise ValueError(f"{experiment.name}: no tolerance is asked for")
    unit, norm = unit_of(experiment.norm, scene.final_time, scene.dimension), experiment.norm
    wanted = accuracy
    if accuracy.tolerance is not None:
        wanted = accuracy.model_copy(update={"tolerance": accuracy.tolerance / unit})
    found, other = solve_by_two_runs(scene, wanted)
    known = found.assessment
    if known is None:  # pragma: no cover - a solved run has one
        raise ValueError(f"{experiment.name}: no run was made")
    method = gauss(scene, 0 if found.steps is None else found.steps.tables.degree)
    run = experiment.chosen_run(method, max(found.n_steps, 1), search.member)
    if experiment.diagnostics and found.status == "ok" and found.steps is not None:
        # again on its own mesh
        mesh = found.steps.mesh(scene.break_points)
        found = integrate(scene, method, mesh, diagnostics=True, with_steps=True)
    trajectory = found
    if not run.observations.is_empty and found.status == "ok":
        (trajectory,) = observe_runs([scene], method, [found], [run.observations])
        trajectory = _with_errors(run, trajectory, other, known.estimate)
    known = replace(
        known,
        tolerance=accuracy.tolerance or unit * known.tolerance,
        estimate=unit * known.estimate,
    )
    error, reference, exact = known.estimate, "a second run, an estimate", run.problem.exact
    if exact is not None:
        measured = found if norm == "l2" else trajectory
        weights = point_weights(measured.time)
        error = error_norm(measured.position, exact(measured.time), weights, norm)
        reference = run.problem.exact_source
        if not (known.reason or error <= known.tolerance):
            reason = (
                f"the exact solution differs from the run by {error:.2g}, a second run by "
                f"{known.estimate:.2g}; write exact: none to go by the second run"
            )
            known = replace(known, reason=reason)
    floor = 100 * EPSILON * unit * float(np.abs(trajectory.position).max())
    status: Observed = "floor" if error < floor else "ok"
    steps = found.steps if run.keeps_steps else None
    trajectory = replace(trajectory, assessment=known, steps=steps, on_mesh=None)
    if known.reason:
        trajectory, status = replace(trajectory, status="refused", message=known.reason), "refused"
    return FinishedRun(
        run=run,
        trajectory=trajectory,
        error=error,
        floor=floor,
        status=status,
        reference=reference,
    )


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
