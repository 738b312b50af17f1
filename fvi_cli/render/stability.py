"""What ``fvi stability`` computes, prints and writes."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.render.runs import compare_figures, write_figures
from fvi_cli.reports.stability import (
    compare_stability_tables,
    stability_text,
    write_stability_tables,
)
from fvi_cli.runner.campaign import Request, gather
from fvi_cli.runner.progress import progress_bar
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
        As :func:`fvi_cli.runner.campaign.gather`; what is wrong with a range is said of ``--over``.
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
    if experiment.is_open:
        raise RequestError(f"{experiment.name}: {NEEDS_LADDER}")
    settings = experiment.stability
    wanted = settings.is_observed if is_observed is None else is_observed
    runs = experiment.runs()
    orders = settings.region.orders if settings.region is not None else ()
    total = len(runs) + len(orders) * len(distinct_regions(experiment.methods))
    rows = []
    with progress_bar(experiment.name, total, wanted=show_progress) as advance:
        try:
            for row in stability_rows(experiment, with_observation=wanted):
                rows.append(row)
                advance(row.run.title)
        except ValueError as error:
            raise RequestError(str(error)) from None
        maps = regions(experiment, advance)
    table = StabilityTable(experiment=experiment, rows=tuple(rows), regions=maps)
    for row in table.disagreements:
        _logger.error("%s: predicted and observed differ: %s", row.run.title, row.observation)
    return table


def write(name: str, tables: Sequence[StabilityTable], output: Path) -> tuple[str, list[Path]]:
    """Write tables and figures; returns the text for the terminal and the paths."""
    from fvi_cli.plotting.stability import stability_figures

    paths = write_stability_tables(output / "tables", name, tables)
    paths += write_figures(stability_figures(name, tables), output)
    return stability_text(name, tables), paths


def compare(name: str, tables: Sequence[StabilityTable], output: Path) -> list[str]:
    """One line for everything in which the stored tables and figures say something else."""
    from fvi_cli.plotting.stability import stability_figures

    differences = compare_stability_tables(output / "tables", name, tables)
    return differences + compare_figures(stability_figures(name, tables), output)
