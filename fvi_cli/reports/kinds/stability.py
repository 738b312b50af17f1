"""The report on stability over steps and parameters: predicted and observed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from fvi_cli.integrator.method_names import method_names
from fvi_cli.integrator.stability.limits import EVERY_UP_TO, FEW, SPACING, WIDE_SPACING
from fvi_cli.integrator.stability.prediction import TOLERATED_GROWTH
from fvi_cli.reports.document import Block, CodeSpan, Grid, Heading, Near, Paragraph
from fvi_cli.reports.naming import member_columns
from fvi_cli.reports.table import (
    About,
    Cell,
    Column,
    Report,
    Row,
    Sheet,
    Value,
    Within,
    alike,
    pivot,
    with_stored,
    within,
)
from fvi_cli.studies.members import label_of
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

MOST_LINES = 200
"""Most lines of a grid; a longer study lists only numbers of unstable members."""

PREDICTED = Within(relative=2e-3, absolute=1e-9)


def _seen(name: str, missing: Value = None) -> Callable[[About], Any]:
    """A getter for an attribute of the observation; `missing` if there is none."""
    return lambda of: missing if of.row.observation is None else getattr(of.row.observation, name)


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
        Column(
            "exact_growth_per_step",
            "the same of the exact scene",
            compared=PREDICTED,
            get="exact_growth",
        ),
        Column("growing_modes", "number of modes that grow"),
    ),
    *within(
        "row",
        Column("largest_stable_step", "smaller steps are stable over this time", "", "", PREDICTED),
        Column(
            "lasting_step",
            "smaller steps are stable over a thousand times this time",
            compared=PREDICTED,
        ),
    ),
    Column("observed", "what a run from random data did", get=_seen("verdict")),
    Column(
        "observed_growth_per_step",
        "natural logarithm of its growth in a step",
        compared=None,
        get=_seen("growth_per_step", math.nan),
    ),
    Column("observed_steps", "its number of steps", compared=None, get=_seen("n_steps")),
    Column(
        "predicted_over_observed_steps",
        "what is predicted for that number of steps",
        get=_seen("predicted"),
    ),
    Column("agrees", "whether the two say the same", get=_seen("agrees")),
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
        words=lambda sheets: alike(_words(name, tables)),
        remake=lambda sheets: stability_report(name, _with_rows(tables, sheets["runs"].rows)),
    )


def _with_rows(tables: Sequence[StabilityTable], rows: Sequence[Row]) -> list[StabilityTable]:
    """The tables with the numbers of stored rows."""
    stored = iter(rows)
    return [
        replace(
            table,
            rows=tuple(
                with_stored(row, COLUMNS, found, "row")
                for row, found in zip(table.rows, stored, strict=False)
            ),
        )
        for table in tables
    ]


def _words(name: str, tables: Sequence[StabilityTable]) -> Iterator[Block]:
    yield Heading(level=1, words=f"Stability: {name}")
    yield Paragraph(
        words="Every cell gives the factor by which the worst mode grows in one step. UNSTABLE: a "
        "mode that the exact scene does not have outgrows it over the run by more than "
        f"{TOLERATED_GROWTH:.0f}; slow: such a mode grows, but less over that number of steps. "
        "Steps below the stable h are stable over this time, those below the lasting h over a "
        "thousand times this time. The search covers all steps T/N up to "
        f"N = {EVERY_UP_TO} and shorter ones that are {100 * SPACING:g} % apart: "
        "narrower windows of instability may be missed "
        f"({100 * WIDE_SPACING:g} % for scenes of more than {FEW} independent systems or with "
        "negative damping or stiffness)."
    )
    for table in tables:
        yield Heading(level=2, words=(CodeSpan(table.experiment.name),))
        scene = table.experiment.problem.scene
        if scene is not None and not scene.is_linear:
            yield Paragraph(
                words="The scene is nonlinear: this holds for its linearisation at the start."
            )
        experiment = table.experiment.name if len(tables) > 1 else ""
        yield from _rows(table, experiment)
        yield from _regions(table, "-".join(filter(None, (experiment, "regions"))))


def _rows(table: StabilityTable, name: str) -> Iterator[Block]:
    names = method_names(table.experiment.methods)
    steps = sorted({row.run.n_steps for row in table.rows})
    lines: dict[tuple[str, ...], list[StabilityRow]] = {}
    swept = any(row.run.member is not None for row in table.rows)
    for row in table.rows:
        key = (row.run.method.case, *([label_of(row.run.member)] if swept else []))
        lines.setdefault(key, []).append(row)
    if len(lines) > MOST_LINES:
        yield replace(_counts(table, steps), name=name)
    else:
        cells: list[Cell] = []
        for (case, *member), rows in lines.items():
            begin, final_time = (names[case].label, *member), table.experiment.problem.final_time
            cells += [(begin, f"N = {row.run.n_steps}", (_cell(row),)) for row in rows]
            cells += [
                (begin, "stable h", (_size(rows[0].largest_stable_step, final_time),)),
                (begin, "lasting h", (_size(rows[0].lasting_step, final_time),)),
                (begin, "exact, per time", _exact(rows)),
            ]
        titles = [*(f"N = {n}" for n in steps), "stable h", "lasting h", "exact, per time"]
        corner = ("method", "member") if swept else ("method",)
        yield pivot(cells, corner=corner, headings={title: (title,) for title in titles}, name=name)
    yield Paragraph(words=_agreement(table))
    for row in table.disagreements:
        yield Paragraph(words=(Near(f"Observed otherwise: {row.run.title}: {row.observation}"),))


def _counts(table: StabilityTable, steps: Sequence[int]) -> Grid:
    """For a study of many members the number of unstable ones."""
    names = method_names(table.experiment.methods)
    found: dict[tuple[str, int], list[bool]] = {}
    for row in table.rows:
        key = (row.run.method.case, row.run.n_steps)
        found.setdefault(key, []).append(row.verdict == "unstable")
    return pivot(
        (
            ((names[case].label,), f"N = {n}", (f"{sum(unstable)} of {len(unstable)}",))
            for (case, n), unstable in found.items()
        ),
        corner=("method: unstable members",),
        headings={f"N = {n}": (f"N = {n}",) for n in steps},
    )


def _cell(row: StabilityRow) -> str:
    if row.verdict == "unknown":
        return "unknown"
    growth = row.prediction.growth_per_step
    factor = math.exp(min(growth, 700.0))
    if row.verdict == "unstable":
        return f"UNSTABLE {factor:.3g}"
    if not growth:
        return "stable"
    return f"grows {factor:.3g}" if row.prediction.exact_growth else f"slow {factor:.6g}"


def _size(step: float, final_time: float) -> str:
    if math.isnan(step):
        return "-"
    return f"{step:.3g}" if step < final_time else "no limit"


def _exact(rows: Sequence[StabilityRow]) -> tuple[str, ...]:
    """Growth rate of the exact scene, taken from the row with the smallest step."""
    finest = min(rows, key=lambda row: row.run.step_size)
    growth = finest.prediction.exact_growth / finest.run.step_size
    return (f"{growth:.4g}" if growth else "0",)


def _agreement(table: StabilityTable) -> str:
    seen = [row.observation for row in table.rows if row.observation is not None]
    if not seen:
        return "Not observed."
    compared = [one for one in seen if one.agrees is not None]
    agreed = sum(one.agrees is True for one in compared)
    words = f"Observed from random data: {agreed} of {len(compared)} runs as predicted."
    if len(compared) < len(seen):
        words += f" Of {len(seen) - len(compared)} runs the stability is unknown."
    return words


def _regions(table: StabilityTable, name: str) -> Iterator[Block]:
    if not table.regions:
        return
    names = method_names(table.experiment.methods)
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
                (names[one.method.case].label,),
                f"{one.order:g}",
                (f"{100 * one.share_stable:.1f} %",),
            )
            for one in table.regions
        ),
        corner=("method",),
        headings={f"{order:g}": (f"order {order:g}",) for order in orders},
        is_near=True,
        name=name,
    )
