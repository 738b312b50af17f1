"""The report on stability over steps and parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.integrator.stability.prediction import TOLERATED_GROWTH
from fvi_cli.reports.document import Block, CodeSpan, Grid, Heading, Paragraph
from fvi_cli.reports.naming import member_columns
from fvi_cli.reports.table import (
    About,
    Cell,
    Column,
    Report,
    Sheet,
    Within,
    pivot,
    within,
)
from fvi_cli.studies.members import label_of
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

MOST_LINES = 200
"""Most lines of a grid; a longer study lists only numbers of unstable members."""

PREDICTED = Within(relative=2e-3, absolute=1e-9)


_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment.name")
COLUMNS = (
    _EXPERIMENT,
    Column("member", "swept values", get=lambda of: label_of(of.row.run.member)),
    *within(
        "row.run",
        Column("case", "name of the method in files", get="method.case"),
        Column("n_steps", "number N of steps"),
        Column("step_size", "h, in the scene's unit of time"),
    ),
    *within(
        "row.prediction",
        Column("predicted", "stable, unstable or unknown", get="verdict"),
        Column(
            "growth_per_step",
            "natural logarithm of the growth of the worst mode in a step",
            compared=PREDICTED,
        ),
    ),
    Column("reason", "of the prediction", compared=None, get="row.prediction.reason"),
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
    return Report(
        name=f"{name}-stability",
        sheets=(
            Sheet.of("runs", columns, runs, ("experiment", "member", "case", "n_steps")),
            Sheet.of(
                "regions", REGION_COLUMNS, regions, ("experiment", "case", "order"), is_file=False
            ),
        ),
        blocks=list(_words(name, tables)),
    )


def _words(name: str, tables: Sequence[StabilityTable]) -> Iterator[Block]:
    yield Heading(level=1, words=f"Stability: {name}")
    yield Paragraph(
        words="Every cell gives the factor by which the worst mode grows in one step. UNSTABLE: it "
        f"grows by more than {TOLERATED_GROWTH:.0f} over the run; slow: it grows less over that "
        "number of steps."
    )
    for table in tables:
        yield Heading(level=2, words=(CodeSpan(table.experiment.name),))
        yield from _rows(table)
        yield from _regions(table)


def _rows(table: StabilityTable) -> Iterator[Block]:
    steps = sorted({row.run.n_steps for row in table.rows})
    lines: dict[tuple[str, ...], list[StabilityRow]] = {}
    swept = any(row.run.member is not None for row in table.rows)
    for row in table.rows:
        key = (row.run.method.label, *([label_of(row.run.member)] if swept else []))
        lines.setdefault(key, []).append(row)
    if len(lines) > MOST_LINES:
        yield _counts(table, steps)
    else:
        cells: list[Cell] = []
        for (label, *member), rows in lines.items():
            begin = (label, *member)
            cells += [(begin, f"N = {row.run.n_steps}", (_cell(row),)) for row in rows]
        titles = [f"N = {n}" for n in steps]
        corner = ("method", "member") if swept else ("method",)
        yield pivot(cells, corner=corner, headings={title: (title,) for title in titles})


def _counts(table: StabilityTable, steps: Sequence[int]) -> Grid:
    """For a study of many members the number of unstable ones."""
    found: dict[tuple[str, int], list[bool]] = {}
    for row in table.rows:
        key = (row.run.method.label, row.run.n_steps)
        found.setdefault(key, []).append(row.prediction.verdict == "unstable")
    return pivot(
        (
            ((label,), f"N = {n}", (f"{sum(unstable)} of {len(unstable)}",))
            for (label, n), unstable in found.items()
        ),
        corner=("method: unstable members",),
        headings={f"N = {n}": (f"N = {n}",) for n in steps},
    )


def _cell(row: StabilityRow) -> str:
    verdict, growth = row.prediction.verdict, row.prediction.growth_per_step
    factor = math.exp(min(growth, 700.0))
    if verdict == "unstable":
        return f"UNSTABLE {factor:.3g}"
    return f"slow {factor:.6g}" if growth else verdict


def _regions(table: StabilityTable) -> Iterator[Block]:
    if not table.regions:
        return
    first = table.regions[0]
    yield Paragraph(
        words="Share of the plane of h^2 k/m from "
        f"{first.stiffness[0]:g} to {first.stiffness[-1]:g} and mu h^(2 - order)/m from "
        f"{first.damping[0]:g} to {first.damping[-1]:g} (logarithmic) where no mode grows by more "
        "than 0.1 % in a step:"
    )
    orders = sorted({region.order for region in table.regions})
    yield pivot(
        (
            (
                (one.method.label,),
                f"{one.order:g}",
                (f"{100 * one.share_stable:.1f} %",),
            )
            for one in table.regions
        ),
        corner=("method",),
        headings={f"{order:g}": (f"order {order:g}",) for order in orders},
    )
