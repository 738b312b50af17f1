"""The report on cost: every measured run, and the time for given accuracies."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from fvi_cli.integrator.method_names import MethodName, method_names
from fvi_cli.reports.document import Block, Bullets, CodeSpan, Equation, Heading, Paragraph
from fvi_cli.reports.kinds.order_summary import NORMS, reference_in_words
from fvi_cli.reports.naming import number
from fvi_cli.reports.table import About, Column, Report, Sheet, Sheets, Words, grid_of, within
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.cost_curves import (
    ACCURACIES,
    CostCurve,
    cheapest_at,
    cheapest_bands,
    cost_curves,
    pareto_front,
)

NOT_REACHED = "not reached"

_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment")
RUN_COLUMNS = (
    _EXPERIMENT,
    Column("case", "name of the method in files", get="case.method.case"),
    Column("method", "name of the method", "method", get="label"),
    *within(
        "row",
        Column("n_steps", "number N of steps", "N"),
        Column("step_size", "h, in the scene's unit of time"),
        Column("error", "error of the position, in its unit", "error", ".2e"),
        Column(
            "setup_seconds",
            "everything of a run but its steps, from a cold start; least of the repeats",
            "set-up, s",
            ".2g",
        ),
        Column("stepping_seconds_min", "the steps; least of the repeats", "stepping, s", ".2g"),
        Column("stepping_seconds_median", "the steps; median of the repeats", "median, s", ".2g"),
        Column("storage_seconds", "writing the run to a file", "storage, s", ".2g"),
        Column(
            "spread", "interquartile range of the stepping times over their median", "spread", ".0%"
        ),
        Column("repeats", "number of timed runs", "repeats"),
        Column("peak_memory_bytes", "traced peak of a run of its own", "peak, bytes", ".2g"),
        Column("history_operations", "multiply-adds on the history", "history operations"),
        Column("newton_iterations", "iterations in all steps", "Newton"),
        Column("status", "what was observed", "status"),
    ),
)
_SLOPES = within(
    "curve",
    Column("order", "order between the two finest rows above the floor", "order", ".2f"),
    Column(
        "time_exponent",
        "slope of log(seconds) against log(N) over those of the four finest whose steps take "
        "most of the time",
        "time exponent",
        ".2f",
    ),
    Column(
        "factor_per_digit",
        "factor in seconds for a tenth of the error over the same rows",
        "one more digit",
        # factors so close to 1 are scatter of times
        lambda factor: "1" if factor < 1.005 else number(factor, ".3g"),
        get="cost_of_a_digit",
    ),
)


def _to(get: Callable[[CostCurve, float], Any], accuracy: float) -> Callable[[About], Any]:
    """A getter that calls `get` with the curve of a row and an accuracy."""
    return lambda of: get(of.curve, accuracy)


SUMMARY_COLUMNS = (
    _EXPERIMENT,
    Column("case", "name of the method in files; one for all tolerances", get="curve.key"),
    Column("method", "name of the method", "method", get="label"),
    *_SLOPES,
    *(
        Column(
            f"seconds_to_{accuracy:.0e}",
            f"set-up plus stepping to an error of {accuracy:.0e}, interpolated",
            missing=NOT_REACHED,
            get=_to(lambda curve, a: _finite(curve.seconds_to(a)), accuracy),
        )
        for accuracy in ACCURACIES
    ),
    *(
        Column(
            f"extrapolated_to_{accuracy:.0e}",
            f"a guess for an error of {accuracy:.0e}, which no run reached",
            get=_to(CostCurve.extrapolated_seconds, accuracy),
        )
        for accuracy in ACCURACIES
    ),
)
CHEAPEST_COLUMNS = (
    _EXPERIMENT,
    Column("error", "accuracy to reach", get="accuracy"),
    Column("case", "the method that is cheapest there", get="curve.key"),
    Column("method", "name of the method", get="label"),
    Column("seconds", "its set-up plus stepping", get=lambda of: of.curve.seconds_to(of.accuracy)),
)
TOLERANCE_COLUMNS = (
    _EXPERIMENT,
    *within(
        "row",
        Column("tolerance", "error that was asked for, at any time", "asked for", ".0e"),
        Column("outcome", "met, unreliable or refused", "outcome"),
        Column("error", "error at the points of the finest ladder", "error", ".1e"),
        Column("estimate", "estimated error at any time", "estimate", ".1e"),
        Column("n_steps", "steps of the run that was delivered", "steps"),
        Column("degree", "its stages", "stages"),
        Column("rounds", "runs of the search", "runs"),
        Column("seconds", "of the whole search, from a cold start", "seconds", ".2g"),
    ),
    Column(
        "on_a_ladder",
        "least seconds of any method on equal steps to the same error",
        "on a ladder, s",
        ".2g",
        get=lambda of: of.curve.seconds_to(of.row.error) if of.curve else math.nan,
    ),
    Column("case", "that method", "by", get=lambda of: of.label or "-"),
)
FRONT_COLUMNS = (
    _EXPERIMENT,
    Column("case", "method of a run that no other beats in both error and time", get="curve.key"),
    Column("n_steps", "its number of steps", get="row.n_steps"),
)


def cost_report(name: str, tables: Sequence[CostTable]) -> Report:
    """The report on the cost of the methods; it begins with seconds for accuracies."""

    def words(sheets: Sheets) -> Words:
        summary = [Heading(level=1, words=f"What accuracy costs: {name}"), *cost_summary(tables)]
        return summary, [*summary, *(block for table in tables for block in _details(table))]

    has_tolerances = any(table.by_tolerance for table in tables)
    sheets = (
        ("runs", RUN_COLUMNS, _runs, ("case", "n_steps"), True),
        ("summary", SUMMARY_COLUMNS, _curves, ("case",), True),
        ("cheapest", CHEAPEST_COLUMNS, _cheapest, ("error",), False),
        ("tolerances", TOLERANCE_COLUMNS, _tolerances, ("tolerance",), has_tolerances),
        ("pareto_front", FRONT_COLUMNS, _front, ("case", "n_steps"), False),
    )
    return Report(
        name=f"{name}-cost",
        sheets=tuple(
            Sheet.of(
                sheet,
                columns,
                (one for table in tables for one in items(table)),
                ("experiment", *keys),
                is_file=is_file,
            )
            for sheet, columns, items, keys, is_file in sheets
        ),
        words=words,
        is_timed=True,
    )


def _runs(table: CostTable) -> Iterator[About]:
    names = _names(table)
    for case in table.cases:
        label = names[case.method.case].label
        yield from (About(table=table, label=label, case=case, row=row) for row in case.rows)


def _curves(table: CostTable) -> Iterator[About]:
    for curve in cost_curves(table):
        yield About(table=table, curve=curve, label=curve_name(curve, _names(table)))


def _cheapest(table: CostTable) -> Iterator[About]:
    bands = cheapest_bands(cost_curves(table))
    for accuracy in ACCURACIES:
        if curve := cheapest_at(bands, accuracy):
            label = curve_name(curve, _names(table))
            yield About(table=table, curve=curve, label=label, accuracy=accuracy)


def _tolerances(table: CostTable) -> Iterator[About]:
    curves = [curve for curve in cost_curves(table) if not curve.is_exact_by_chance]
    for row in table.by_tolerance:
        reached = [one for one in curves if not math.isnan(one.seconds_to(row.error))]
        best = min(reached, key=lambda one: one.seconds_to(row.error), default=None)
        label = curve_name(best, _names(table)) if best else ""
        yield About(table=table, row=row, curve=best, label=label)


def _front(table: CostTable) -> Iterator[About]:
    for curve, row in pareto_front(cost_curves(table)):
        yield About(table=table, curve=curve, row=row)


def curve_name(curve: CostCurve, names: Mapping[str, MethodName]) -> str:
    """The name of the method of a curve for readers."""
    return names[curve.method.case].label


def _names(table: CostTable) -> dict[str, MethodName]:
    return method_names([case.method for case in table.cases])


def cost_summary(tables: Sequence[CostTable], *, level: int = 2) -> Iterator[Block]:
    """Seconds for accuracies, cost of a digit, and cheapest methods of every experiment."""
    yield Paragraph(
        words="Times are seconds, set-up (from a cold start) plus stepping, least of the "
        "repeats, one run after the other in one process. The order is that between the "
        "two finest rows above the floor; the time exponent (seconds against N) and the factor "
        "that one more digit costs belong to those of the four finest whose steps take most of "
        "the time. The cheapest method stays so "
        "until another is quicker by a tenth. A dash says that an accuracy was not reached; a "
        "number in brackets with it is extrapolated, not measured. Seconds and bytes are those "
        "of one machine."
    )
    for table in tables:
        yield Heading(level=level, words=table.experiment)
        yield from _summary(table)


def _summary(table: CostTable) -> Iterator[Block]:
    names, curves = _names(table), cost_curves(table)
    bands = cheapest_bands(curves)
    yield Paragraph(
        words=(
            Equation(table.equation or "an equation that is not stated"),
            f"; T = {table.final_time:g}. Errors in the {NORMS[table.norm]}, against "
            f"{reference_in_words(table.reference)}.",
        )
    )
    cheapest = [cheapest_at(bands, accuracy) for accuracy in ACCURACIES]
    last = tuple("-" if curve is None else curve_name(curve, names) for curve in cheapest)
    summary = (("cheapest", "", "", "", *last),)
    yield grid_of(_summary_columns(), _curves(table), summary_rows=summary, name=table.experiment)
    if hidden := [curve_name(curve, names) for curve in curves if curve.has_hidden_slopes]:
        yield Paragraph(
            words=f"{', '.join(hidden)}: no time exponent and no factor for a digit, since set-up "
            "and other costs that do not grow with N are more than half of the time in the finest "
            "rows."
        )
    if exact := [curve_name(curve, names) for curve in curves if curve.is_exact_by_chance]:
        yield Paragraph(
            words=f"{', '.join(exact)}: only round-off at every N. That is a property of "
            "this solution, not of others; these methods are left out below."
        )
    if table.by_tolerance:
        yield Paragraph(
            words=(
                "Runs with a tolerance (",
                CodeSpan("accuracy: {tolerance: ...}"),
                "), search included, beside the quickest run on equal steps to the same error, "
                "which is not known beforehand:",
            )
        )
        yield grid_of(TOLERANCE_COLUMNS, _tolerances(table), name=f"{table.experiment}-tolerances")
    yield Paragraph(words="Cheapest by accuracy:")
    yield Bullets(
        items=tuple(
            f"{band.coarse:.1e} to {band.fine:.1e}: {curve_name(band.curve, names)}, "
            f"{band.least_seconds:.2g} s to {band.most_seconds:.2g} s"
            for band in bands
        )
        or ("no method reached 1",)
    )


def _summary_columns() -> list[Column]:
    reached = [Column("", title=f"{a:.0e}", get=_to(_reached, a)) for a in ACCURACIES]
    return [Column("method", title="method", get="label"), *_SLOPES, *reached]


def _finite(value: float) -> float | None:
    return None if math.isnan(value) else value


def _reached(curve: CostCurve, accuracy: float) -> str:
    seconds = curve.seconds_to(accuracy)
    if not math.isnan(seconds):
        return f"{seconds:.2g}"
    guess = curve.extrapolated_seconds(accuracy)
    return "-" if math.isnan(guess) else f"- ({guess:.1g})"


def _details(table: CostTable) -> Iterator[Block]:
    names = _names(table)
    yield Heading(level=2, words=f"{table.experiment}: every run")
    yield grid_of(RUN_COLUMNS, _runs(table), key_columns=2, name=f"{table.experiment}-runs")
    yield Paragraph(
        words="The spread is the interquartile range of the stepping times over their median. "
        "The peak is traced in a run of its own."
    )
    failures = tuple(
        f"{names[case.method.case].label}, N = {row.n_steps}: {row.status}, {row.message}"
        for case in table.cases
        for row in case.rows
        if row.message
    )
    if failures:
        yield Bullets(items=failures)
