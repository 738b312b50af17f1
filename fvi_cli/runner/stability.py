"""Stability studies of a request."""

from __future__ import annotations

import logging

from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request, Source, Task, requested
from fvi_cli.runner.work import crash_of
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment
from fvi_cli.studies.stability_study import (
    StabilityTable,
    distinct_regions,
    stability_maps,
    stability_rows,
)

_logger = logging.getLogger(__name__)


def stability(source: Source, *, progress: bool = False) -> list[StabilityTable]:
    """What is predicted to be stable, as ``fvi stability`` studies it.

    Parameters
    ----------
    source
        As for :func:`load`.
    progress
        Show a progress bar where there is a terminal.

    A :class:`RequestError` reports an experiment in which nothing is integrated.
    """
    request = requested(source)
    return [_study(one, show_progress=progress) for one in request.loaded.experiments]


def stability_tasks(request: Request) -> list[Task]:
    """A task for every method whose stability would be predicted, with its numbers of steps."""
    return [
        Task(
            experiment=experiment.name,
            action=f"predict {method.label}",
            of=f"N = {', '.join(map(str, experiment.steps))}"
            + (f" for {len(experiment.members)} members" if experiment.members else ""),
        )
        for experiment in request.loaded.experiments
        for method in experiment.methods
    ]


def _study(experiment: Experiment, *, show_progress: bool) -> StabilityTable:
    if experiment.needs_search:
        raise RequestError(f"{experiment.name}: {NEEDS_LADDER}")
    region, runs = experiment.stability.region, experiment.runs()
    orders = region.orders if region is not None else ()
    total = len(runs) + len(orders) * len(distinct_regions(experiment.methods))
    rows = []
    with progress_bar(experiment.name, total, wanted=show_progress) as advance:
        try:
            for row in stability_rows(experiment, failed=crash_of):
                rows.append(row)
                advance(row.run.title)
        except ValueError as error:
            raise RequestError(str(error)) from None
        maps = stability_maps(experiment, advance)
    for row in rows:
        if row.failure:
            _logger.error("%s: %s", row.run.title, row.failure)
    return StabilityTable(experiment=experiment, rows=tuple(rows), regions=maps)
