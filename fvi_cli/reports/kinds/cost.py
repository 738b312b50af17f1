"""What accuracy costs: every measured run, and the price of accuracies in words and numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fvi_cli.integrator.baselines.peers import PEER_LIMITS
from fvi_cli.integrator.method import PEER_NAMES, AnyMethod, Baseline
from fvi_cli.reports.document import Block, Bullets, Code, Equation, Grid, Heading, Paragraph
from fvi_cli.reports.naming import MethodName, method_names, number
from fvi_cli.reports.table import Column, Report, Row, Sheet, Value, row_of
from fvi_cli.studies.cost import CostTable
from fvi_cli.studies.price import (
    ACCURACIES,
    Curve,
    cheapest_at,
    cheapest_bands,
    cost_curves,
    pareto_front,
)

NOT_REACHED = "not reached"

RUN_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("case", "name of the method in files"),
    Column("method", "name of the method", title="method"),
    Column("n_steps", "number N of steps", title="N"),
    Column("step_size", "h, in the scene's unit of time"),
    Column("error", "error of the position, in its unit", title="error", form=".2e"),
    Column(
        "setup_seconds",
        "everything of a run but its steps, from a cold start; least of the repeats",
        title="set-up, s",
        form=".2g",
    ),
    Column(
        "stepping_seconds_min", "the steps; least of the repeats", title="stepping, s", form=".2g"
    ),
    Column(
        "stepping_seconds_median", "the steps; median of the repeats", title="median, s", form=".2g"
    ),
    Column("storage_seconds", "writing the run to a file", title="storage, s", form=".2g"),
    Column(
        "spread",
        "interquartile range of the stepping times over their median",
        title="spread",
        form=".0%",
    ),
    Column("repeats", "number of timed runs", title="repeats"),
    Column("peak_memory_bytes", "traced peak of a run of its own", title="peak, bytes", form=".2g"),
    Column("history_operations", "multiply-adds on the history", title="history operations"),
    Column("newton_iterations", "iterations in all steps", title="Newton"),
    Column("status", "what was observed", title="status"),
)
SUMMARY_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("case", "name of the method in files; one for all tolerances"),
    Column("method", "name of the method"),
    Column("order", "order between the two finest rows above the floor"),
    Column("time_exponent", "slope of log(seconds) against log(N) over the four finest"),
    Column("factor_per_digit", "factor in seconds for a tenth of the error"),
    *(
        Column(
            f"seconds_to_{accuracy:.0e}",
            f"set-up plus stepping to an error of {accuracy:.0e}, interpolated",
            missing=NOT_REACHED,
        )
        for accuracy in ACCURACIES
    ),
    *(
        Column(
            f"extrapolated_to_{accuracy:.0e}",
            f"a guess for an error of {accuracy:.0e}, which no run reached",
        )
        for accuracy in ACCURACIES
    ),
)
CHEAPEST_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("error", "accuracy to reach"),
    Column("case", "the method that is cheapest there"),
    Column("method", "name of the method"),
    Column("seconds", "its set-up plus stepping"),
)
TOLERANCE_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("tolerance", "error that was asked for, at any time", title="asked for", form=".0e"),
    Column("outcome", "met, unreliable or refused", title="outcome"),
    Column("error", "error at the points of the finest ladder", title="error", form=".1e"),
    Column("estimate", "estimated error at any time", title="estimate", form=".1e"),
    Column("n_steps", "steps of the run that was delivered", title="steps"),
    Column("degree", "its stages", title="stages"),
    Column("rounds", "runs of the search", title="runs"),
    Column("seconds", "of the whole search, from a cold start", title="seconds", form=".2g"),
    Column(
        "on_a_ladder",
        "least seconds of any method on equal steps to the same error",
        form=".2g",
        title="on a ladder, s",
    ),
    Column("case", "that method", title="by"),
)
FRONT_COLUMNS = (
    Column("experiment", "name of the experiment"),
    Column("case", "method of a run that no other beats in both error and time"),
    Column("n_steps", "its number of steps"),
)


def cost_report(name: str, tables: Sequence[CostTable]) -> Report:
    """What the methods of every experiment cost; seconds to accuracies come first."""
    title = Heading(level=1, words=f"What accuracy costs: {name}")
    prices = cost_summary(tables)
    words: list[Block] = [title, *prices]
    for table in tables:
        words += _details(table)
    return Report(
        name=f"{name}-cost",
        sheets=(
            _sheet(tables),
            Sheet(
                name="summary",
                columns=SUMMARY_COLUMNS,
                rows=tuple(row for table in tables for row in _prices(table)),
                keys=("experiment", "case"),
            ),
            Sheet(
                name="cheapest",
                columns=CHEAPEST_COLUMNS,
                rows=tuple(row for table in tables for row in _cheapest(table)),
                keys=("experiment", "error"),
                is_file=False,
            ),
            _tolerance_sheet(tables),
            Sheet(
                name="pareto_front",
                columns=FRONT_COLUMNS,
                rows=tuple(
                    row_of(FRONT_COLUMNS, p, table, case=curve.key)
                    for table in tables
                    for curve, p in pareto_front(cost_curves(table))
                ),
                keys=("experiment", "case", "n_steps"),
                is_file=False,
            ),
        ),
        summary=(title, *prices),
        blocks=tuple(words),
        is_timed=True,
    )


def _sheet(tables: Sequence[CostTable]) -> Sheet:
    rows = []
    for table in tables:
        names = _names(table)
        for case in table.cases:
            key, label = case.method.case, names[case.method.case].label
            rows += [row_of(RUN_COLUMNS, row, table, case=key, method=label) for row in case.rows]
    keys = ("experiment", "case", "n_steps")
    return Sheet(name="runs", columns=RUN_COLUMNS, rows=tuple(rows), keys=keys)


def _tolerance_sheet(tables: Sequence[CostTable]) -> Sheet:
    rows: list[Row] = []
    for table in tables:
        names = _names(table)
        curves = [curve for curve in cost_curves(table) if not curve.is_exact_by_chance]
        for row in table.by_tolerance:
            times = {curve.key: curve.seconds_to(row.error) for curve in curves}
            reached = [curve for curve in curves if not math.isnan(times[curve.key])]
            best = min(reached, key=lambda curve: times[curve.key], default=None)
            rows.append(
                row_of(
                    TOLERANCE_COLUMNS,
                    row,
                    table,
                    on_a_ladder=math.nan if best is None else times[best.key],
                    case="-" if best is None else curve_name(best, names),
                )
            )
    return Sheet(
        name="tolerances",
        columns=TOLERANCE_COLUMNS,
        rows=tuple(rows),
        keys=("experiment", "tolerance"),
        is_file=bool(rows),
    )


def _prices(table: CostTable) -> Iterator[dict[str, Value]]:
    names = _names(table)
    for curve in cost_curves(table):
        seconds = {accuracy: curve.seconds_to(accuracy) for accuracy in ACCURACIES}
        yield {
            "experiment": table.experiment,
            "case": curve.key,
            "method": curve_name(curve, names),
            "order": curve.order,
            "time_exponent": curve.time_exponent,
            "factor_per_digit": curve.price_of_a_digit,
            **{
                f"seconds_to_{accuracy:.0e}": None if math.isnan(value) else value
                for accuracy, value in seconds.items()
            },
            **{
                f"extrapolated_to_{accuracy:.0e}": curve.extrapolated_seconds(accuracy)
                for accuracy in ACCURACIES
            },
        }


def _cheapest(table: CostTable) -> Iterator[dict[str, Value]]:
    names, bands = _names(table), cheapest_bands(cost_curves(table))
    for accuracy in ACCURACIES:
        curve = cheapest_at(bands, accuracy)
        if curve is not None:
            yield {
                "experiment": table.experiment,
                "error": accuracy,
                "case": curve.key,
                "method": curve_name(curve, names),
                "seconds": curve.seconds_to(accuracy),
            }


def curve_name(curve: Curve, names: Mapping[str, MethodName]) -> str:
    """What a reader calls the method of a curve."""
    # one name for all tolerances
    if curve.is_by_tolerance:
        return "DOP853"
    return names[curve.methods[0].case].label


def _names(table: CostTable) -> dict[str, MethodName]:
    return method_names([case.method for case in table.cases])


def cost_summary(tables: Sequence[CostTable], *, level: int = 2) -> list[Block]:
    """Seconds to accuracies, the price of a digit, and who is cheapest, of every experiment."""
    blocks: list[Block] = [
        Paragraph(
            words="Times are seconds, set-up (from a cold start) plus stepping, least of the "
            "repeats, one run after the other in one process. The order is that between the "
            "two finest rows above the floor; the time exponent (seconds against N) and the factor "
            "that one more digit costs belong to the four finest. The cheapest method stays so "
            "until another is quicker by a tenth. A dash says that an accuracy was not reached; a "
            "number in brackets with it is extrapolated, not measured. Seconds and bytes are those "
            "of one machine."
        )
    ]
    if any(_is_peer(case.method) for table in tables for case in table.cases):
        blocks.append(Paragraph(words=f"Limits of the peers: {PEER_LIMITS}."))
    for table in tables:
        blocks += _summary(table, level)
    return blocks


def _is_peer(method: AnyMethod) -> bool:
    return isinstance(method, Baseline) and method.name in PEER_NAMES


def _summary(table: CostTable, level: int) -> list[Block]:
    names, curves = _names(table), cost_curves(table)
    header = ("method", "order", "time exponent", "one more digit")
    rows = [
        (
            curve_name(curve, names),
            number(curve.order, ".2f"),
            number(curve.time_exponent, ".2f"),
            _price(curve.price_of_a_digit),
            *(_reached(curve, accuracy) for accuracy in ACCURACIES),
        )
        for curve in curves
    ]
    bands = cheapest_bands(curves)
    cheapest = [cheapest_at(bands, accuracy) for accuracy in ACCURACIES]
    last = tuple("-" if curve is None else curve_name(curve, names) for curve in cheapest)
    return [
        Heading(level=level, words=table.experiment),
        Paragraph(
            words=(
                Equation(table.equation or "an equation that is not stated"),
                f"; T = {table.final_time:g}. Errors: norm {table.norm}, against "
                f"{table.reference}.",
            )
        ),
        Grid(
            header=(*header, *(f"{accuracy:.0e}" for accuracy in ACCURACIES)),
            rows=tuple(rows),
            summary_rows=(("cheapest", "", "", "", *last),),
        ),
        *_exact_methods(curves, names),
        *_asked_for(table),
        Paragraph(words="Cheapest by accuracy:"),
        Bullets(
            items=tuple(
                f"{band.coarse:.1e} to {band.fine:.1e}: {curve_name(band.curve, names)}, "
                f"{band.least_seconds:.2g} s to {band.most_seconds:.2g} s"
                for band in bands
            )
            or ("no method reached 1",)
        ),
    ]


def _asked_for(table: CostTable) -> list[Block]:
    """What accuracies took that were asked for by tolerance."""
    if not table.by_tolerance:
        return []
    return [
        Paragraph(
            words=(
                "Asked for by tolerance (",
                Code("accuracy: {tolerance: ...}"),
                "), search and all, beside the quickest run on equal steps to the same error, "
                "which nobody knows beforehand:",
            )
        ),
        _tolerance_sheet([table]).grid(key_columns=1),
    ]


def _exact_methods(curves: Sequence[Curve], names: Mapping[str, MethodName]) -> list[Block]:
    """What is to be said of methods that this problem happens to suit."""
    exact = [curve_name(curve, names) for curve in curves if curve.is_exact_by_chance]
    if not exact:
        return []
    return [
        Paragraph(
            words=f"{', '.join(exact)}: nothing but round-off at every N. That says something of "
            "this solution, not of others, and is left out below."
        )
    ]


def _price(factor: float) -> str:
    # set-up is all there is to pay, and times scatter
    return "1" if factor < 1.005 else number(factor, ".3g")


def _reached(curve: Curve, accuracy: float) -> str:
    seconds = curve.seconds_to(accuracy)
    if not math.isnan(seconds):
        return f"{seconds:.2g}"
    guess = curve.extrapolated_seconds(accuracy)
    return "-" if math.isnan(guess) else f"- ({guess:.1g})"


def _details(table: CostTable) -> list[Block]:
    names = _names(table)
    blocks: list[Block] = [
        Heading(level=2, words=f"{table.experiment}: every run"),
        _sheet([table]).grid(key_columns=2),
        Paragraph(
            words="The spread is the interquartile range of the stepping times over their median. "
            "The peak is traced in a run of its own."
        ),
    ]
    failures = tuple(
        f"{names[case.method.case].label}, N = {row.n_steps}: {row.status}, {row.message}"
        for case in table.cases
        for row in case.rows
        if row.message
    )
    return [*blocks, Bullets(items=failures)] if failures else blocks
