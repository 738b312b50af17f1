"""Cost tables: every measured run as CSV, and what accuracy costs in words and numbers."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence

from fvi_cli.integrator.method import PEER_NAMES, AnyMethod, Baseline
from fvi_cli.integrator.peers import PEER_LIMITS
from fvi_cli.reports.csv_table import field
from fvi_cli.reports.document import Block, Bullets, Grid, Heading, Paragraph
from fvi_cli.reports.naming import MethodName, method_names, number
from fvi_cli.studies.cost import CostRow, CostTable
from fvi_cli.studies.price import (
    ACCURACIES,
    Curve,
    cheapest_at,
    cheapest_bands,
    cost_curves,
    pareto_front,
)

COLUMNS = (
    "experiment",
    "case",
    "method",
    "n_steps",
    "step_size",
    "error",
    "setup_seconds",
    "stepping_seconds_min",
    "stepping_seconds_median",
    "storage_seconds",
    "spread",
    "repeats",
    "peak_memory_bytes",
    "history_operations",
    "newton_iterations",
    "status",
)
SUMMARY_COLUMNS = (
    "experiment",
    "case",
    "method",
    "order",
    "time_exponent",
    "factor_per_digit",
    *(f"seconds_to_{accuracy:.0e}" for accuracy in ACCURACIES),
    *(f"extrapolated_to_{accuracy:.0e}" for accuracy in ACCURACIES),
)
NOT_REACHED = "not reached"
_COARSEST, _FINEST = 1.0, 1e-13


def cost_csv(tables: Sequence[CostTable]) -> str:
    """One line for every run, numbers in full precision, under :data:`COLUMNS`."""
    return _csv(COLUMNS, (line for table in tables for line in _run_lines(table)))


def cost_summary_csv(tables: Sequence[CostTable]) -> str:
    """One line for every method under :data:`SUMMARY_COLUMNS`.

    Seconds are set-up plus stepping, interpolated, or ``not reached``; those that are extrapolated
    have columns of their own.
    """
    return _csv(SUMMARY_COLUMNS, (line for table in tables for line in _summary_lines(table)))


def _csv(columns: Sequence[str], lines: Iterator[Mapping[str, str]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(lines)
    return text.getvalue()


def _run_lines(table: CostTable) -> Iterator[dict[str, str]]:
    names = _names(table)
    for case in table.cases:
        for row in case.rows:
            yield {
                "experiment": table.experiment,
                "case": case.method.case,
                "method": names[case.method.case].label,
                "n_steps": str(row.n_steps),
                "step_size": field(row.step_size),
                "error": field(row.error),
                "setup_seconds": field(row.setup_seconds),
                "stepping_seconds_min": field(row.stepping_seconds_min),
                "stepping_seconds_median": field(row.stepping_seconds_median),
                "storage_seconds": field(row.storage_seconds),
                "spread": field(row.spread),
                "repeats": str(row.repeats),
                "peak_memory_bytes": str(row.peak_memory_bytes),
                "history_operations": str(row.history_operations),
                "newton_iterations": str(row.newton_iterations),
                "status": row.status,
            }


def _summary_lines(table: CostTable) -> Iterator[dict[str, str]]:
    names = _names(table)
    for curve in cost_curves(table):
        line = {
            "experiment": table.experiment,
            "case": curve.key,
            "method": curve_name(curve, names),
            "order": field(curve.order),
            "time_exponent": field(curve.time_exponent),
            "factor_per_digit": field(curve.price_of_a_digit),
        }
        for accuracy in ACCURACIES:
            seconds = curve.seconds_to(accuracy)
            line[f"seconds_to_{accuracy:.0e}"] = (
                NOT_REACHED if math.isnan(seconds) else field(seconds)
            )
            line[f"extrapolated_to_{accuracy:.0e}"] = field(curve.extrapolated_seconds(accuracy))
        yield line


def cost_json(name: str, tables: Sequence[CostTable]) -> str:
    """Everything that the other forms show; what is not a number is null."""
    content = {
        "name": name,
        "experiments": [
            {
                "experiment": table.experiment,
                "equation": table.equation,
                "gamma": table.gamma,
                "reference": table.reference,
                "norm": table.norm,
                "final_time": table.final_time,
                "runs": [_values(line) for line in _run_lines(table)],
                "methods": [_values(line) for line in _summary_lines(table)],
                "cheapest": _cheapest_values(table),
                "pareto_front": [
                    {"case": curve.key, "n_steps": point.row.n_steps}
                    for curve, point in pareto_front(cost_curves(table))
                ],
            }
            for table in tables
        ],
    }
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


_WORDS = ("experiment", "case", "method", "status")


def _values(line: Mapping[str, str]) -> dict[str, object]:
    return {key: text if key in _WORDS else _value(text) for key, text in line.items()}


def _value(text: str) -> object:
    if text == NOT_REACHED:
        return None
    if text.isdigit():
        return int(text)
    value = float(text)
    return value if math.isfinite(value) else None


def _cheapest_values(table: CostTable) -> list[dict[str, object]]:
    found = []
    for accuracy in ACCURACIES:
        cheapest = cheapest_at(cost_curves(table), accuracy)
        if cheapest.curve is not None:
            found.append(
                {"error": accuracy, "case": cheapest.curve.key, "seconds": cheapest.seconds}
            )
    return found


def curve_name(curve: Curve, names: Mapping[str, MethodName]) -> str:
    """What a reader calls the method of a curve."""
    # one name for all tolerances
    if curve.is_by_tolerance:
        return "DOP853"
    return names[curve.methods[0].case].label


def _names(table: CostTable) -> dict[str, MethodName]:
    return method_names([case.method for case in table.cases])


def cost_report(name: str, tables: Sequence[CostTable]) -> list[Block]:
    """The summary of every experiment, then every run."""
    blocks: list[Block] = [Heading(level=1, words=f"What accuracy costs: {name}")]
    blocks += cost_summary(tables)
    for table in tables:
        blocks += _details(table)
    return blocks


def cost_summary(tables: Sequence[CostTable], *, level: int = 2) -> list[Block]:
    """Seconds to accuracies, the price of a digit, and who is cheapest, of every experiment."""
    blocks: list[Block] = [
        Paragraph(
            words="Times are seconds, set-up (from a cold start) plus stepping, least of the "
            "repeats, one run after the other in one process. Order and time exponent (seconds "
            "against N) belong to the finest rows above the floor; one more digit costs the factor "
            "beside it. A dash says that an accuracy was not reached; a number in brackets with it "
            "is extrapolated, not measured."
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
    cheapest = [cheapest_at(curves, accuracy) for accuracy in ACCURACIES]
    last = tuple("-" if c.curve is None else curve_name(c.curve, names) for c in cheapest)
    bands = cheapest_bands(curves, _COARSEST, _FINEST)
    where = f"{table.equation}; T = {table.final_time:g}" if table.equation else ""
    return [
        Heading(level=level, words=table.experiment),
        Paragraph(words=f"{where}. Errors: norm {table.norm}, against {table.reference}."),
        Grid(
            header=(*header, *(f"{accuracy:.0e}" for accuracy in ACCURACIES)),
            rows=tuple(rows),
            summary_rows=(("cheapest", "", "", "", *last),),
        ),
        *_exact_methods(curves, names),
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
    header = (
        "method",
        "N",
        "error",
        "set-up, s",
        "stepping, s",
        "median, s",
        "spread",
        "repeats",
        "storage, s",
        "peak, MB",
        "history operations",
        "Newton",
        "status",
    )
    rows = tuple(
        (names[case.method.case].label, *_cells(row)) for case in table.cases for row in case.rows
    )
    blocks: list[Block] = [
        Heading(level=2, words=f"{table.experiment}: every run"),
        Grid(header=header, rows=rows, key_columns=2),
        Paragraph(
            words="The spread is the interquartile range of the stepping times over their median; "
            "a star marks more than a tenth. The peak is traced in a run of its own."
        ),
    ]
    failures = tuple(
        f"{names[case.method.case].label}, N = {row.n_steps}: {row.status}, {row.message}"
        for case in table.cases
        for row in case.rows
        if row.message
    )
    return [*blocks, Bullets(items=failures)] if failures else blocks


def _cells(row: CostRow) -> tuple[str, ...]:
    mark = " *" if row.has_wide_spread else ""
    return (
        str(row.n_steps),
        number(row.error, ".2e"),
        number(row.setup_seconds, ".2g"),
        number(row.stepping_seconds_min, ".2g"),
        number(row.stepping_seconds_median, ".2g"),
        number(row.spread, ".0%") + mark,
        str(row.repeats),
        number(row.storage_seconds, ".2g"),
        f"{row.peak_memory_bytes / 1e6:.2g}",
        str(row.history_operations),
        str(row.newton_iterations),
        row.status,
    )
