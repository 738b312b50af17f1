"""Stability studies of a request."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from fvi_cli.errors import RequestError
from fvi_cli.runner.executors.jobs import describe_crash
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Source, ranges, requested
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment
from fvi_cli.studies.stability_study import (
    StabilityTable,
    distinct_regions,
    stability_maps,
    stability_rows,
)

_logger = logging.getLogger(__name__)


def stability(
    source: Source, *, over: Sequence[str] = (), observe: bool | None = None, progress: bool = False
) -> list[StabilityTable]:
    """What is stable, predicted and observed, as ``fvi stability`` studies it.

    Parameters
    ----------
    source
        As for :func:`load`.
    over
        Keys to vary, such as ``problem.stiffness=1:1e6:40:log``; at most two, and none for a
        configuration that is already loaded.
    observe
        Compare with runs from random data; default as configured.
    progress
        Show a progress bar where there is a terminal.

    A :class:`RequestError` reports an experiment in which nothing is integrated.
    """
    request = requested(source, overrides=ranges(over))
    return [
        _study(experiment, is_observed=observe, show_progress=progress)
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
        maps = stability_maps(experiment, advance)
    table = StabilityTable(experiment=experiment, rows=tuple(rows), regions=maps)
    for row in rows:
        if row.failure:
            _logger.error("%s: %s", row.run.title, row.failure)
    for row in table.disagreements:
        _logger.error("%s: predicted and observed differ: %s", row.run.title, row.observation)
    return table
