"""Stability over steps and parameters: predicted and observed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from fvi_cli.integrator.stability.limits import EVERY_UP_TO, FEW, SPACING, WIDE_SPACING
from fvi_cli.integrator.stability.prediction import TOLERATED_GROWTH
from fvi_cli.reports.document import Block, Code, Grid, Heading, Paragraph
from fvi_cli.reports.naming import method_names
from fvi_cli.reports.table import Column, Report, Row, Sheet, Within, row_of
from fvi_cli.studies.stability_study import StabilityRow, StabilityTable

MOST_LINES = 200
"""Lines of a grid; of a longer study only the numbers of unstable members are listed."""

PREDICTED = Within(relative=2e-3, absolute=1e-9)

COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("member", "swept values"),
    Column("case", "name of the method in files"),
    Column("n_steps", "number N of steps"),
    Column("step_size", "h, in the scene's unit of time"),
    Column("predicted", "stable, unstable or unknown"),
    Column(
        "growth_per_step",
        "natural logarithm of the growth of the worst mode in a step",
        compared=PREDICTED,
    ),
    Column("exact_growth_per_step", "the same of the exact scene", compared=PREDICTED),
    Column("growing_modes", "number of modes that grow"),
    Column("largest_stable_step", "smaller steps are stable over this time", compared=PREDICTED),
    Column(
        "lasting_step",
        "smaller steps are stable over a thousand times this time",
        compared=PREDICTED,
    ),
    Column("observed", "what a run from random data did"),
    Column("observed_growth_per_step", "natural logarithm of its growth in a step", compared=None),
    Column("observed_steps", "its number of steps", compared=None),
    Column("predicted_over_observed_steps", "what is predicted for that number of steps"),
    Column("agrees", "whether the two say the same"),
    Column("reason", "of the prediction", compared=None),
)
REGION_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("case", "name of the method in files"),
    Column("order", "order of the damping"),
    Column("points", "number of points of the plane"),
    Column("stable_share", "share of them that is stable", compared=PREDICTED),
)


def stability_report(name: str, tables: Sequence[StabilityTable]) -> Report:
    """Predicted and observed stability of every method, member and step, and shares of planes."""
    words = tuple(_words(name, tables))
    return Report(
        name=f"{name}-stability",
        sheets=(
            Sheet(
                name="runs",
                columns=COLUMNS,
                rows=tuple(_run(table, row) for table in tables for row in table.rows),
                keys=("experiment", "member", "case", "n_steps"),
            ),
            Sheet(
                name="regions",
                columns=REGION_COLUMNS,
                rows=tuple(
                    {
                        "experiment": table.experiment.name,
                        "case": region.method.case,
                        "order": float(region.order),
                        "points": int(region.level.size),
                        "stable_share": float(region.share_stable),
                    }
                    for table in tables
                    for region in table.regions
                ),
                keys=("experiment", "case", "order"),
                is_file=False,
            ),
        ),
        summary=words,
        blocks=words,
    )


def _run(table: StabilityTable, row: StabilityRow) -> Row:
    seen = row.observation
    return row_of(
        COLUMNS,
        row,
        row.prediction,
        row.run,
        experiment=table.experiment.name,
        member="" if row.run.member is None else row.run.member.label,
        case=row.run.method.case,
        predicted=row.prediction.verdict,
        exact_growth_per_step=row.prediction.exact_growth,
        observed=None if seen is None else seen.verdict,
        observed_growth_per_step=math.nan if seen is None else seen.growth_per_step,
        observed_steps=None if seen is None else seen.n_steps,
        predicted_over_observed_steps=None if seen is None else seen.predicted,
        agrees=None if seen is None else seen.agrees,
    )


def _words(name: str, tables: Sequence[StabilityTable]) -> list[Block]:
    blocks: list[Block] = [
        Heading(level=1, words=f"Stability: {name}"),
        Paragraph(
            words="Every cell gives the growth of the worst mode in one step, a factor; a run is "
            f"unstable (in CAPITALS) when it outgrows the exact scene by {TOLERATED_GROWTH:.0f} "
            "and the mode is none of the exact scene. Modes called slow grow, but too slowly for "
            "that number of steps. Below the stable h runs over this time are stable, below the "
            "lasting h also those over a thousand times this time: looked at are all steps T/N up "
            f"to N = {EVERY_UP_TO} and shorter ones that are {100 * SPACING:g} % apart, so that "
            "windows of instability narrower than that may be missed "
            f"({100 * WIDE_SPACING:g} % for scenes of more than {FEW} independent systems or with "
            "negative damping or stiffness)."
        ),
    ]
    for table in tables:
        blocks.append(Heading(level=2, words=(Code(table.experiment.name),)))
        blocks += _rows(table)
        blocks += _regions(table)
    return blocks


def _rows(table: StabilityTable) -> Iterator[Block]:
    names = method_names(table.experiment.methods)
    steps = sorted({row.run.n_steps for row in table.rows})
    lines: dict[tuple[str, str], list[StabilityRow]] = {}
    for row in table.rows:
        member = "" if row.run.member is None else row.run.member.label
        lines.setdefault((row.run.method.case, member), []).append(row)
    swept = any(member for _, member in lines)
    keys = ("method", "member") if swept else ("method",)
    if len(lines) > MOST_LINES:
        yield _counts(table, steps)
    else:
        cells = []
        for (case, member), rows in lines.items():
            found = {row.run.n_steps: row for row in rows}
            cells.append(
                (
                    names[case].label,
                    *((member,) if swept else ()),
                    *(_cell(found[n]) for n in steps),
                    _size(rows[0].largest_stable_step, table.experiment.problem.final_time),
                    _size(rows[0].lasting_step, table.experiment.problem.final_time),
                    *_exact(rows),
                )
            )
        header = (*keys, *(f"N = {n}" for n in steps), "stable h", "lasting h", "exact, per time")
        yield Grid(header=header, rows=tuple(cells), text_columns=len(keys), key_columns=len(keys))
    yield Paragraph(words=_agreement(table))
    for row in table.disagreements:
        yield Paragraph(words=f"Observed otherwise: {row.run.title}: {row.observation}")


def _counts(table: StabilityTable, steps: Sequence[int]) -> Grid:
    """For a study of many members: how many are unstable."""
    names = method_names(table.experiment.methods)
    cells = []
    for case, name in names.items():
        entries = []
        for n in steps:
            rows = [r for r in table.rows if r.run.method.case == case and r.run.n_steps == n]
            unstable = sum(row.verdict == "unstable" for row in rows)
            entries.append(f"{unstable} of {len(rows)}")
        cells.append((name.label, *entries))
    header = ("method: unstable members", *(f"N = {n}" for n in steps))
    return Grid(header=header, rows=tuple(cells))


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
    """Growth of the exact scene, from the smallest step."""
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
        words += f" Of {len(seen) - len(compared)} runs nothing is predicted."
    return words


def _regions(table: StabilityTable) -> Iterator[Block]:
    if not table.regions:
        return
    names = method_names(table.experiment.methods)
    orders = sorted({region.order for region in table.regions})
    shares: dict[str, dict[float, float]] = {}
    for region in table.regions:
        shares.setdefault(region.method.case, {})[region.order] = region.share_stable
    first = table.regions[0]
    yield Paragraph(
        words="Share of the plane of h^2 k/m from "
        f"{first.stiffness[0]:g} to {first.stiffness[-1]:g} and mu h^(2 - order)/m from "
        f"{first.damping[0]:g} to {first.damping[-1]:g} (logarithmic) where no mode grows by more "
        "than 0.1 % in a step:"
    )
    yield Grid(
        header=("method", *(f"order {order:g}" for order in orders)),
        rows=tuple(
            (names[case].label, *(f"{100 * by_order[order]:.1f} %" for order in orders))
            for case, by_order in shares.items()
        ),
    )
