"""Studies of stability that a request asks for."""

from __future__ import annotations

import logging

from fvi_cli.errors import RequestError
from fvi_cli.runner.executors.jobs import describe_crash
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment
from fvi_cli.studies.stability_study import (
    StabilityTable,
    distinct_regions,
    regions,
    stability_rows,
)

_logger = logging.getLogger(__name__)


def study_stability(
    request: Request, *, is_observed: bool | None, show_progress: bool
) -> list[StabilityTable]:
    """Look at every run of every experiment.

    Raises
    ------
    RequestError
        For an experiment in which nothing is integrated.
    """
    return [
        _study(experiment, is_observed=is_observed, show_progress=show_progress)
        for experiment in request.loaded.experiments
    ]


def _study(
    experiment: Experiment, *, is_observed: bool | None, show_progress: bool
) -> StabilityTable:
    if experiment.needs_search:
        raise RequestError(f"{experiment.name}: {NEEDS_LADDER}")
    settings = experiment.stability
    wanted = settings.observe if is_observed is None else is_observed
    runs = experiment.runs()
    orders = settings.region.orders if settings.region is not None else ()
    total = len(runs) + len(orders) * len(distinct_regions(experiment.methods))
    rows = []
    with progress_bar(experiment.name, total, wanted=show_progress) as advance:
        try:
            for row in stability_rows(experiment, with_observation=wanted, failed=describe_crash):
                rows.append(row)
                advance(row.run.title)
        except ValueError as error:
            raise RequestError(str(error)) from None
        maps = regions(experiment, advance)
    table = StabilityTable(experiment=experiment, rows=tuple(rows), regions=maps)
    for row in rows:
        if row.failure:
            _logger.error("%s: %s", row.run.title, row.failure)
    for row in table.disagreements:
        _logger.error("%s: predicted and observed differ: %s", row.run.title, row.observation)
    return table
