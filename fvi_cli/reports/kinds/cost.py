"""The report on cost: error, time and work of every measured run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from fvi_cli.reports.document import Block, Bullets, Heading, Paragraph
from fvi_cli.reports.kinds.orders import NORMS, reference_in_words
from fvi_cli.reports.table import Column, Report, Sheet, grid_of
from fvi_cli.studies.cost import CostTable

RUN_COLUMNS = (
    Column("experiment", "name of the experiment", get="run.experiment.name"),
    Column("case", "name of the method in files", get="run.method.case"),
    Column("method", "name of the method", "method", get="run.method.label"),
    Column("n_steps", "number N of steps", "N", get="run.n_steps"),
    Column("step_size", "h, in the scene's unit of time", get="run.step_size"),
    Column("error", "error of the position, in its unit", "error", ".2e"),
    Column("seconds", "set-up and steps, least of the repeats", "least, s", ".2g"),
    Column("median_seconds", "the same, median of the repeats", "median, s", ".2g"),
    Column("repeats", "number of timed runs"),
    Column("history_operations", "multiply-adds on the history", "history operations"),
    Column("newton_iterations", "iterations in all steps", "Newton"),
    Column("status", "what was observed", "status"),
)


def cost_report(name: str, tables: Sequence[CostTable]) -> Report:
    """The report on the cost of the methods."""
    items = (row for table in tables for row in table.rows)
    return Report(
        name=f"{name}-cost",
        sheets=(Sheet.of("runs", RUN_COLUMNS, items, ("experiment", "case", "n_steps")),),
        blocks=[Heading(1, f"What accuracy costs: {name}"), *_blocks(tables)],
    )


def _blocks(tables: Sequence[CostTable]) -> Iterator[Block]:
    yield Paragraph("Seconds of set-up (from a cold start) and steps, one run after the other.")
    for table in tables:
        norm, reference = NORMS[table.experiment.norm], reference_in_words(table.reference)
        yield Heading(2, table.experiment.name)
        yield Paragraph(f"Errors in the {norm}, against {reference}.")
        yield grid_of(RUN_COLUMNS, table.rows)
        if failures := tuple(f"{r.run.title}: {r.message}" for r in table.rows if r.message):
            yield Bullets(failures)
