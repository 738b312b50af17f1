"""The cost of accuracy, measured for every run of a configuration."""

from __future__ import annotations

import functools
import logging
from collections.abc import Iterator

from fvi_cli.config import LoadedConfig
from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import Task, carry_out
from fvi_cli.runner.request import Source, load
from fvi_cli.studies.cost import REPEATS, CostRow, CostTable, measure_cost
from fvi_cli.studies.experiment import NEEDS_LADDER, Run
from fvi_cli.studies.reference import reference_of

_logger = logging.getLogger(__name__)


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
    config = load(source)
    tasks = cost_tasks(config, repeats=repeats)
    rows: list[CostRow] = carry_out(tasks, config.name, progress=progress)
    tables = []
    for experiment in config.experiments:
        own = tuple(row for row in rows if row.run.experiment is experiment)
        reference = reference_of(own[0].run).source
        tables.append(CostTable(experiment=experiment, reference=reference, rows=own))
    for line in (line for table in tables for line in table.unexpected):
        _logger.warning("%s", line)
    return tables


def cost_tasks(config: LoadedConfig, *, repeats: int = REPEATS) -> list[Task]:
    """A task for every run that is timed; raises :class:`RequestError` as :func:`cost` does."""
    if complaints := list(_complaints(config)):
        raise RequestError(*complaints)
    return [
        Task(
            experiment=experiment.name,
            action=f"time {run.method.label}",
            of=f"N = {run.n_steps}",
            work=functools.partial(_row, run, repeats),
        )
        for experiment in config.experiments
        for run in experiment.runs()
    ]


def _row(run: Run, repeats: int) -> CostRow:
    return measure_cost(run, reference_of(run), repeats=repeats)


def _complaints(config: LoadedConfig) -> Iterator[str]:
    """Why costs of an experiment cannot be measured."""
    for one in config.experiments:
        if one.members:
            yield f"{one.name}: costs are measured for one scene; leave out sweep"
        elif one.problem.scene is None:
            yield f"{one.name}: costs are measured for motions, not for a fractional derivative"
        elif one.needs_search:
            yield f"{one.name}: {NEEDS_LADDER}"
        elif one.problem.exact_source == "none":
            yield f"{one.name}: exact: none gives no errors; write --set problem.exact=auto"
