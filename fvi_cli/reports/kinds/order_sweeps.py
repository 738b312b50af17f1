"""Orders of the members of a sweep: one by one for a few values of one key, else summed up."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence

from fvi_cli.reports.document import Block, Code, Grid, Heading, Paragraph, Words
from fvi_cli.reports.kinds.members import DESIGN, members_in_words
from fvi_cli.reports.naming import MethodName, number
from fvi_cli.reports.table import pivot
from fvi_cli.studies.members import counts_in_words, value_in_words
from fvi_cli.studies.order import OrderCase, OrderTable

OrderEntry = Callable[[OrderCase], str]

MOST_ROWS = 32
"""Members that have a row of their own."""


def split_sweeps(
    tables: Sequence[OrderTable],
) -> tuple[list[OrderTable], list[list[OrderTable]]]:
    """Tables of experiments without a sweep, and the tables of members by experiment."""
    single = [table for table in tables if not table.swept]
    swept: dict[str, list[OrderTable]] = {}
    for table in tables:
        if table.swept:
            swept.setdefault(table.experiment, []).append(table)
    return single, list(swept.values())


def sweep_summary(
    tables: Sequence[OrderTable], names: Mapping[str, MethodName], entry: OrderEntry
) -> list[Block]:
    """What is swept, and the orders of its members."""
    members = [table.member for table in tables if table.member is not None]
    title: Words = (Code(tables[0].experiment), f": {members_in_words(members)}.")
    tells = next(iter(members[0].unnamed), "") if not members[0].name else DESIGN
    few = len(tables) <= MOST_ROWS and (members[0].name or len(members[0].values) == 1)
    grid = _by_value(tables, tells, names, entry) if few else _by_method(tables, names)
    return [Paragraph(words=title), grid]


def _by_value(
    tables: Sequence[OrderTable], key: str, names: Mapping[str, MethodName], entry: OrderEntry
) -> Grid:
    """Rows: values of the swept key, or designs; columns: methods."""
    cases = list(dict.fromkeys(case.method.case for table in tables for case in table.cases))
    rows = []
    for table in tables:
        found = {case.method.case: case for case in table.cases}
        orders = [entry(found[case]) if case in found else "not computed" for case in cases]
        label = value_in_words(table.swept[key]) if key != DESIGN else ""
        if table.member is not None and key == DESIGN:
            label = table.member.label
        rows.append((label, *orders))
    return Grid(header=(key, *(names[case].label for case in cases)), rows=tuple(rows))


def _by_method(tables: Sequence[OrderTable], names: Mapping[str, MethodName]) -> Grid:
    """Rows: methods; columns: how orders and errors are spread over the members."""
    cases: dict[str, list[tuple[OrderTable, OrderCase]]] = {}
    for table in tables:
        for case in table.cases:
            cases.setdefault(case.method.case, []).append((table, case))
    rows = []
    for name, found in cases.items():
        slopes = [case.slope for _, case in found if math.isfinite(case.slope)]
        lasts = [case.last_order for _, case in found if math.isfinite(case.last_order)]
        finest = [
            (case.rows[-1].error, table)
            for table, case in found
            if math.isfinite(case.rows[-1].error)
        ]
        worst, member = max(finest, key=lambda one: one[0], default=(math.nan, None))
        rows.append(
            (
                names[name].label,
                *_spread(slopes),
                *_spread(lasts),
                number(statistics.median(e for e, _ in finest) if finest else math.nan, ".1e"),
                number(worst, ".1e"),
                "-" if member is None or member.member is None else member.member.label,
                counts_in_words(row.status for _, case in found for row in case.rows),
            )
        )
    header = ["method", "slope: least", "median", "greatest", "finest order: least", "median"]
    header += ["greatest", "finest error: median", "largest", "at", "rows"]
    return Grid(header=tuple(header), rows=tuple(rows), groups=(3, 3, 3, 1))


def _spread(values: Sequence[float]) -> tuple[str, str, str]:
    if not values:
        return "-", "-", "-"
    return f"{min(values):.2f}", f"{statistics.median(values):.2f}", f"{max(values):.2f}"


def sweep_details(
    tables: Sequence[OrderTable], names: Mapping[str, MethodName], setting: Words
) -> list[Block]:
    """Heading, equation, and the errors of all members on every number of steps."""
    cases = list(dict.fromkeys(case.method.case for table in tables for case in table.cases))
    found: dict[tuple[int, str], list[tuple[float, str]]] = {}
    sizes: dict[int, float] = {}
    for table in tables:
        for one in table.cases:
            for row in one.rows:
                sizes[row.n_steps] = row.step_size
                key = (row.n_steps, one.method.case)
                found.setdefault(key, []).append((row.error, row.status))

    def texts(rows: Sequence[tuple[float, str]]) -> tuple[str, str, str]:
        errors = [error for error, _ in rows if math.isfinite(error)]
        return (
            number(statistics.median(errors) if errors else math.nan, ".2e"),
            number(max(errors, default=math.nan), ".2e"),
            counts_in_words(status for _, status in rows),
        )

    none = number(math.nan, ".2e")
    grid = pivot(
        (
            (
                (str(n), f"{sizes[n]:.4g}"),
                case,
                texts(found[n, case]) if (n, case) in found else (none, none, "not computed"),
            )
            for n in sorted(sizes)
            for case in cases
        ),
        corner=("N", "h"),
        beside={case: (f"{names[case].label}: median", "largest", "rows") for case in cases},
        text_columns=0,
    )
    remark = "Every member has its own rows in the CSV and JSON forms of this table."
    return [
        Heading(level=2, words=tables[0].experiment),
        Paragraph(words=setting),
        grid,
        Paragraph(words=remark),
    ]
