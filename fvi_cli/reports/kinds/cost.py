"""The report on cost: error, time and work of every measured run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvi_cli.reports.document import Block, Bullets, Heading, Paragraph
from fvi_cli.reports.kinds.order_summary import NORMS, reference_in_words
from fvi_cli.reports.table import About, Column, Report, Sheet, grid_of, within
from fvi_cli.studies.cost import CostTable

RUN_COLUMNS = (
    Column("experiment", "name of the experiment", get="table.experiment.name"),
    Column("case", "name of the method in files", get="row.run.method.case"),
    Column("method", "name of the method", "method", get="label"),
    *within(
        "row",
        Column("n_steps", "number N of steps", "N", get="run.n_steps"),
        Column("step_size", "h, in the scene's unit of time", get="run.step_size"),
        Column("error", "error of the position, in its unit", "error", ".2e"),
        Column("seconds", "set-up and steps, least of the repeats", "least, s", ".2g"),
        Column("median_seconds", "the same, median of the repeats", "median, s", ".2g"),
        Column("repeats", "number of timed runs"),
        Column("history_operations", "multiply-adds on the history", "history operations"),
        Column("newton_iterations", "iterations in all steps", "Newton"),
        Column("status", "what was observed", "status"),
    ),
)


def cost_report(name: str, tables: Sequence[CostTable]) -> Report:
    """The report on the cost of the methods."""
    items = (one for table in tables for one in _runs(table))
    keys = ("experiment", "case", "n_steps")
    return Report(
        name=f"{name}-cost",
        sheets=(Sheet.of("runs", RUN_COLUMNS, items, keys),),
        blocks=[Heading(level=1, words=f"What accuracy costs: {name}"), *_blocks(tables)],
    )


def _runs(table: CostTable) -> Iterator[About]:
    for row in table.rows:
        yield About(table=table, row=row, label=row.run.method.label)


def _blocks(tables: Sequence[CostTable]) -> Iterator[Block]:
    yield Paragraph(
        words="Seconds of set-up (from a cold start) and steps, on one machine, one run after the "
        "other."
    )
    for table in tables:
        yield Heading(level=2, words=table.experiment.name)
        yield Paragraph(
            words=f"Errors in the {NORMS[table.experiment.norm]}, against "
            f"{reference_in_words(table.reference)}."
        )
        yield grid_of(RUN_COLUMNS, _runs(table))
        if failures := tuple(f"{r.run.title}: {r.message}" for r in table.rows if r.message):
            yield Bullets(items=failures)
