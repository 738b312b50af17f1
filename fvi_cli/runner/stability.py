"""Studies of stability that a request asks for."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from fvi_cli.errors import RequestError
from fvi_cli.runner.executors.executor import crash_told
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request, gather
from fvi_cli.studies.experiment import NEEDS_LADDER, Experiment
from fvi_cli.studies.stability_study import (
    StabilityTable,
    distinct_regions,
    regions,
    stability_rows,
)

_logger = logging.getLogger(__name__)


def ranges(over: Sequence[str]) -> list[str]:
    """Overrides that sweep over ``KEY=FROM:TO:NUMBER[:log]``.

    Raises
    ------
    RequestError
        For another form, and for more than two keys, which no picture shows.
    """
    if len(over) > 2:
        raise RequestError("--over: at most two keys are varied")
    entries = []
    for text in over:
        key, equals, numbers = text.partition("=")
        parts = numbers.split(":")
        if not (equals and key.strip() and len(parts) in (3, 4) and all(parts)):
            raise RequestError(
                f"--over: {text!r} is not allowed; it must be KEY=FROM:TO:NUMBER or "
                "KEY=FROM:TO:NUMBER:log"
            )
        spacing = parts[3] if len(parts) == 4 else "linear"
        entries.append(
            f"{key.strip()}: {{from: {parts[0]}, to: {parts[1]}, number: {parts[2]}, "
            f"spacing: {spacing}}}"
        )
    return [f"sweep={{{', '.join(entries)}}}"] if entries else []


def gather_over(
    configs: Sequence[str], overrides: Sequence[str], over: Sequence[str]
) -> list[Request]:
    """What is asked for, with a sweep over what `over` varies, in place of the file's own.

    Raises
    ------
    RequestError
        As :func:`fvi_cli.runner.request.gather`; what is wrong with a range is said of ``--over``.
    """
    try:
        return gather(configs, (*overrides, *ranges(over)))
    except RequestError as error:
        told = list(error.complaints)
        for key in (text.partition("=")[0].strip() for text in over):
            for start in (f"--set: sweep.{key}:", f"--set: {key}:", f"--set: sweep.{key}."):
                told = [line.replace(start, f"--over: {key}{start[-1]}", 1) for line in told]
        raise type(error)(*told) from None


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
    wanted = settings.is_observed if is_observed is None else is_observed
    runs = experiment.runs()
    orders = settings.region.orders if settings.region is not None else ()
    total = len(runs) + len(orders) * len(distinct_regions(experiment.methods))
    rows = []
    with progress_bar(experiment.name, total, wanted=show_progress) as advance:
        try:
            for row in stability_rows(experiment, with_observation=wanted, failed=crash_told):
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
