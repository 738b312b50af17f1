"""The cost of accuracy, measured for every run of a request."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request, Source, Task, requested
from fvi_cli.studies.cost import REPEATS, CostTable, measure_cost
from fvi_cli.studies.experiment import NEEDS_LADDER
from fvi_cli.studies.reference import reference_of

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


def cost(source: Source, *, repeats: int = REPEATS, progress: bool = False) -> list[CostTable]:
    """Error, time and work of every method, as ``fvi cost`` measures them.

    One run after the other, in this process.

    Parameters
    ----------
    source
        As for :func:`load`.
    repeats
        How often every run is timed.
    progress
        As for :func:`run`.

    Raises
    ------
    RequestError
        For a sweep, and where nothing is integrated.
    """
    if repeats < 1:
        raise RequestError(f"--repeats {repeats}: is not allowed; it must be 1 or more")
    (request,) = measurable([requested(source)])
    tables = []
    experiments = request.loaded.experiments
    count = sum(len(experiment.runs()) for experiment in experiments)
    with progress_bar(request.name, count, wanted=progress) as done:
        for experiment in experiments:
            runs, rows = experiment.runs(), []
            reference = reference_of(runs[0])
            for run in runs:
                rows.append(measure_cost(run, reference, repeats=repeats))
                done(run.title)
            tables.append(
                CostTable(experiment=experiment, reference=reference.source, rows=tuple(rows))
            )
    for line in (line for table in tables for line in table.unexpected):
        _logger.warning("%s", line)
    return tables


def cost_tasks(request: Request) -> list[Task]:
    """A task for every method that would be timed, with its numbers of steps."""
    return [
        Task(
            experiment=experiment.name,
            action=f"time {method.label}",
            of=f"N = {', '.join(map(str, experiment.steps))}",
        )
        for experiment in request.loaded.experiments
        for method in experiment.methods
    ]
