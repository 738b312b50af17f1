"""The cost of accuracy, measured for every run of a request."""

from __future__ import annotations

import functools
import logging
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.runner.compute import compute_jobs
from fvi_cli.runner.executors.jobs import Crash, FinishedJob, Job, References, Results, jobs_of
from fvi_cli.runner.request import Request, Source, requested
from fvi_cli.runner.settings import Settings
from fvi_cli.storage import open_results
from fvi_cli.studies.cost import (
    TOLERANCES,
    CostRow,
    CostTable,
    ToleranceRow,
    cost_table,
    measure_cost,
    measure_tolerance,
)
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment, FinishedRun
from fvi_cli.studies.reference import refined_references

_logger = logging.getLogger(__name__)


def measurable(requests: Sequence[Request]) -> list[Request]:
    """The requests, after a check that they can be measured.

    Raises
    ------
    RequestError
        With one line for everything that cannot be measured.
    """
    complaints = []
    for request in requests:
        if request.stored is not None:
            complaints.append(
                f"{request.stored}: costs are measured anew; name the configuration instead"
            )
            continue
        for experiment in request.loaded.experiments:
            if experiment.members:
                complaints.append(
                    f"{experiment.name}: costs are measured for one scene; leave out sweep"
                )
            if experiment.needs_search:
                complaints.append(f"{experiment.name}: {NEEDS_LADDER}")
            if experiment.problem.exact_source == "none":
                complaints.append(
                    f"{experiment.name}: exact: none gives no errors; "
                    "write --set problem.exact=auto"
                )
            if experiment.problem.scene is None:
                complaints.append(
                    f"{experiment.name}: costs are measured for motions, "
                    "not for a fractional derivative"
                )
    if complaints:
        raise RequestError(*complaints)
    return list(requests)


def cost(source: Source, *, fail_fast: bool = False, progress: bool = False) -> list[CostTable]:
    """Error, time, memory and work of every method, as ``fvi cost`` measures them.

    One run after the other, in this process; writing is measured on a file in a temporary folder.

    Parameters
    ----------
    source
        As for :func:`load`.
    fail_fast, progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For a sweep, and where nothing is integrated.
    """
    (request,) = measurable([requested(source)])
    settings = Settings(output=Path(), fail_fast=fail_fast, show_progress=progress, keep=False)
    jobs: list[Job] = []
    for experiment in request.loaded.experiments:
        runs = experiment.runs()
        own = [replace(one, kind="cost") if one.kind == "run" else one for one in jobs_of(runs)]
        last = max(own, key=lambda one: one.runs[0].n_steps)
        jobs += own + [replace(last, tolerance=tolerance) for tolerance in TOLERANCES]
    rows: dict[Experiment, list[CostRow]] = {one: [] for one in request.loaded.experiments}
    searches: dict[Experiment, list[ToleranceRow]] = {one: [] for one in rows}

    def take(one: FinishedJob) -> bool:
        (run,), (found,) = one.job.runs, one.results
        if isinstance(found, ToleranceRow):
            searches[run.experiment].append(found)
            return False
        message = found.message if isinstance(found, Crash) else ""
        if one.job.tolerance is not None:
            _logger.warning("%s: %s", one.job.title, message)
            return False
        row = CostRow(
            n_steps=run.n_steps, step_size=run.step_size, status="failed", message=message
        )
        if isinstance(found, CostRow):
            row = found
        rows[run.experiment].append(row)
        _logger.debug("%s: %s, %.3g s", run.title, row.status, row.seconds)
        is_expected = run.experiment.expects_failure(run.method)
        return row.status not in ("ok", "floor") and not is_expected

    with (
        tempfile.TemporaryDirectory() as folder,
        open_results(Path(folder), request.name) as results,
    ):
        compute = functools.partial(_measure_job, store=lambda one: results.add([one]))
        compute_jobs(
            jobs,
            settings,
            title=request.name,
            compute=compute,
            take=take,
            store=results,
            is_kept=False,
        )
    tables = [cost_table(one, rows[one], searches[one]) for one in rows if rows[one]]
    for line in (line for table in tables for line in table.unexpected):
        _logger.warning("%s", line)
    return tables


def _measure_job(
    job: Job, references: References, store: Callable[[FinishedRun], object]
) -> Results:
    if job.is_reference:
        return refined_references(job.runs)
    (run,), reference = job.runs, references[0]
    if job.tolerance is not None:
        return [measure_tolerance(run, job.tolerance, reference)]
    return [measure_cost(run, store, reference)]
