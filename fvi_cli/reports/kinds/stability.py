"""The report on stability over steps and parameters, and in planes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.integrator.stability.prediction import TOLERATED_GROWTH
from fvi_cli.reports.columns import Item, member_columns
from fvi_cli.reports.table import MOST_LINES, Block, Column, Report, Sheet, Within, listed, pivot
from fvi_cli.studies.members import label_of
from fvi_cli.studies.study import StabilityRow, StabilityTable

COLUMNS = (
    Column("case", get="row.run.method.case"),
    Column("n_steps", get="row.run.n_steps"),
    Column("step_size", get="row.run.step_size"),
    Column("predicted", get="row.prediction.verdict"),
    # natural logarithm of the growth of the worst mode in a step
    Column(
        "growth_per_step",
        within=Within(relative=2e-3, absolute=1e-9),
        get="row.prediction.growth_per_step",
    ),
    Column("reason", within=None, get="row.prediction.reason"),
)


def stability_report(name: str, tables: Sequence[StabilityTable]) -> Report:
    """The report on every method, member and step, and on stable shares of planes."""
    items = [Item(table=table, row=row) for table in tables for row in table.rows]
    experiment = Column("experiment", get="table.experiment.name")
    swept = member_columns((of.row.run.member for of in items), "row.run.member")
    columns = (experiment, *swept, *COLUMNS)
    return Report(
        name=f"{name}-stability",
        sheets=(Sheet(name="runs", columns=columns, items=items),),
        blocks=list(_blocks(name, tables)),
    )


def _blocks(name: str, tables: Sequence[StabilityTable]) -> Iterator[Block]:
    yield f"# Stability: {name}"
    yield (
        "Growth of the worst mode in one step. UNSTABLE: by more than "
        f"{TOLERATED_GROWTH:.0f} over the run; slow: by less."
    )
    for table in tables:
        if len(tables) > 1:
            yield f"## {table.experiment.name}"
        yield from _rows(table)
        if table.regions:
            yield from _regions(table)


def _rows(table: StabilityTable) -> Iterator[Block]:
    """A line for every method and member; of many members the number of unstable ones."""
    lines = {(row.run.method, row.run.member) for row in table.rows}
    named = any(member for _, member in lines) and len(lines) <= MOST_LINES
    found: dict[tuple[tuple[str, ...], int], list[StabilityRow]] = {}
    for row in table.rows:
        begin = (row.run.method.label, *([label_of(row.run.member)] if named else []))
        found.setdefault((begin, row.run.n_steps), []).append(row)
    yield pivot(
        ((begin, str(n), (_cell(rows),)) for (begin, n), rows in found.items()),
        corner=("method", "member")[: 1 + named],
        headings={str(n): (f"N = {n}",) for n in sorted({n for _, n in found})},
    )
    predictions = [row.prediction for row in table.rows]
    reasons = dict.fromkeys(one.reason for one in predictions if one.verdict == "unknown")
    yield from listed(f"unknown: {reason}" for reason in reasons)


def _cell(rows: Sequence[StabilityRow]) -> str:
    if len(rows) > 1:
        unstable = sum(row.prediction.verdict == "unstable" for row in rows)
        return f"{unstable} of {len(rows)} unstable"
    verdict, growth = rows[0].prediction.verdict, rows[0].prediction.growth_per_step
    factor = math.exp(min(growth, 700.0))
    if verdict == "unstable":
        return f"UNSTABLE {factor:.3g}"
    return f"slow {factor:.6g}" if growth else verdict


def _regions(table: StabilityTable) -> Iterator[Block]:
    """The share of every plane that is stable."""
    first = table.regions[0]
    yield (
        f"Share of the plane of h^2 k/m from {first.stiffness[0]:g} to {first.stiffness[-1]:g} and "
        f"mu h^(2 - order)/m from {first.damping[0]:g} to {first.damping[-1]:g} (logarithmic) "
        "where no mode grows by more than 0.1 % in a step:"
    )
    yield pivot(
        (
            ((one.method.label,), f"{one.order:g}", (f"{100 * one.share_stable:.1f} %",))
            for one in table.regions
        ),
        corner=("method",),
        headings={f"{one.order:g}": (f"order {one.order:g}",) for one in table.regions},
    )
