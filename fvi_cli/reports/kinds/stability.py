"""The report on stability over steps and parameters, and in planes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.integrator.stability.prediction import TOLERATED_GROWTH
from fvi_cli.reports.document import Block, Heading, Paragraph
from fvi_cli.reports.naming import member_columns
from fvi_cli.reports.table import About, Column, Report, Sheet, Within, pivot, within
from fvi_cli.studies.members import label_of
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

MOST_LINES = 200
"""Most lines of a grid; a longer study lists only numbers of unstable members."""
PREDICTED = Within(relative=2e-3, absolute=1e-9)
_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment.name")
COLUMNS = (
    _EXPERIMENT,
    Column("member", "swept values", get=lambda of: label_of(of.row.run.member)),
    Column("case", "name of the method in files", get="row.run.method.case"),
    Column("n_steps", "number N of steps", get="row.run.n_steps"),
    Column("step_size", "h, in the scene's unit of time", get="row.run.step_size"),
    *within(
        "row.prediction",
        Column("predicted", "stable, unstable or unknown", get="verdict"),
        Column(
            "growth_per_step",
            "natural logarithm of the growth of the worst mode in a step",
            compared=PREDICTED,
        ),
        Column("reason", "of the prediction", compared=None),
    ),
)
REGION_COLUMNS = (
    _EXPERIMENT,
    Column("case", "name of the method in files", get="row.method.case"),
    Column("order", "order of the damping", get=lambda of: float(of.row.order)),
    Column("points", "number of points of the plane", get=lambda of: int(of.row.level.size)),
    Column(
        "stable_share",
        "share of them that is stable",
        compared=PREDICTED,
        get=lambda of: float(of.row.share_stable),
    ),
)


def stability_report(name: str, tables: Sequence[StabilityTable]) -> Report:
    """The report on every method, member and step, and on stable shares of planes."""
    runs = [About(table=table, row=row) for table in tables for row in table.rows]
    regions = [About(table=table, row=one) for table in tables for one in table.regions]
    members = (of.row.run.member for of in runs)
    columns = (*COLUMNS, *member_columns(members, lambda of: of.row.run.member))
    of_region = ("experiment", "case", "order")
    return Report(
        name=f"{name}-stability",
        sheets=(
            Sheet.of("runs", columns, runs, ("experiment", "member", "case", "n_steps")),
            Sheet.of("regions", REGION_COLUMNS, regions, of_region, is_file=False),
        ),
        blocks=list(_blocks(name, tables)),
    )


def _blocks(name: str, tables: Sequence[StabilityTable]) -> Iterator[Block]:
    yield Heading(1, f"Stability: {name}")
    yield Paragraph(
        "Every cell gives the factor by which the worst mode grows in one step. UNSTABLE: it "
        f"grows by more than {TOLERATED_GROWTH:.0f} over the run; slow: it grows less over that "
        "number of steps."
    )
    for table in tables:
        yield Heading(2, table.experiment.name)
        yield from _rows(table)
        yield from _regions(table)


def _rows(table: StabilityTable) -> Iterator[Block]:
    """A line for every method and member; of many members the number of unstable ones."""
    swept = any(row.run.member is not None for row in table.rows)
    found: dict[tuple[tuple[str, ...], int], list[StabilityRow]] = {}
    is_long = len({(row.run.method, row.run.member) for row in table.rows}) > MOST_LINES
    for row in table.rows:
        member = (label_of(row.run.member),) if swept and not is_long else ()
        found.setdefault(((row.run.method.label, *member), row.run.n_steps), []).append(row)
    yield pivot(
        ((begin, f"N = {n}", (_cell(rows),)) for (begin, n), rows in found.items()),
        corner=("method", "member")[: 1 + (swept and not is_long)],
        headings={f"N = {n}": (f"N = {n}",) for n in sorted({n for _, n in found})},
    )


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
    if not table.regions:
        return
    first = table.regions[0]
    yield Paragraph(
        "Share of the plane of h^2 k/m from "
        f"{first.stiffness[0]:g} to {first.stiffness[-1]:g} and mu h^(2 - order)/m from "
        f"{first.damping[0]:g} to {first.damping[-1]:g} (logarithmic) where no mode grows by more "
        "than 0.1 % in a step:"
    )
    orders = sorted({region.order for region in table.regions})
    yield pivot(
        (
            ((one.method.label,), f"{one.order:g}", (f"{100 * one.share_stable:.1f} %",))
            for one in table.regions
        ),
        corner=("method",),
        headings={f"{order:g}": (f"order {order:g}",) for order in orders},
    )
