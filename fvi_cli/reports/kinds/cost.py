"""The report on cost: error, time and work of every measured run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvi_cli.reports.kinds.orders import errors_in_words
from fvi_cli.reports.table import Block, Column, Report, Sheet, grid_of, listed
from fvi_cli.studies.cost import CostTable

COLUMNS = (
    Column("experiment", get="finished.run.experiment.name"),
    Column("case", get="finished.run.method.case"),
    Column("method", "method", get="finished.run.method.label"),
    Column("n_steps", "N", get="finished.run.n_steps"),
    Column("step_size", get="finished.run.step_size"),
    Column("error", "error", ".2e", get="finished.error"),
    Column("seconds", "least, s", ".2g"),  # of all repeats
    Column("median_seconds", "median, s", ".2g"),
    Column("repeats"),
    Column(
        "history_operations", "history operations", get="finished.trajectory.history_operations"
    ),
    Column("newton_iterations", "Newton", get="finished.trajectory.newton_iterations"),
    Column("status", "status", get="finished.status"),
)


def cost_report(name: str, tables: Sequence[CostTable]) -> Report:
    """The report on the cost of the methods."""
    items = [row for table in tables for row in table.rows]
    return Report(
        name=f"{name}-cost",
        sheets=(Sheet(name="runs", columns=COLUMNS, items=items),),
        blocks=[f"# What accuracy costs: {name}", *_blocks(tables)],
    )


def _blocks(tables: Sequence[CostTable]) -> Iterator[Block]:
    yield "Seconds of set-up (from a cold start) and steps, one run after the other."
    for table in tables:
        if len(tables) > 1:
            yield f"## {table.experiment.name}"
        yield f"{errors_in_words(table.experiment.norm, table.rows[0].finished.reference)}."
        yield grid_of(COLUMNS, table.rows)
        runs = [row.finished for row in table.rows if row.finished.trajectory.message]
        yield from listed(f"{one.run.title}: {one.trajectory.message}" for one in runs)
