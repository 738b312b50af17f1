"""The report on cost: error, time and work of every measured run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvi_cli.reports.kinds.orders import errors_in_words
from fvi_cli.reports.table import Block, Column, Report, Sheet, grid_of, listed
from fvi_cli.studies.cost import CostTable

COLUMNS = (
    Column("experiment", get="run.experiment.name"),
    Column("case", get="run.method.case"),
    Column("method", "method", get="run.method.label"),
    Column("n_steps", "N", get="run.n_steps"),
    Column("step_size", get="run.step_size"),
    Column("error", "error", ".2e"),
    Column("seconds", "least, s", ".2g"),  # of all repeats
    Column("median_seconds", "median, s", ".2g"),
    Column("repeats"),
    Column("history_operations", "history operations"),
    Column("newton_iterations", "Newton"),
    Column("status", "status"),
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
        yield f"{errors_in_words(table.experiment.norm, table.reference)}."
        yield grid_of(COLUMNS, table.rows)
        yield from listed(f"{row.run.title}: {row.message}" for row in table.rows if row.message)
