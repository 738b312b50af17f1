"""Orders of the members of a sweep: one by one for a few values of one key, else summarised."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from fvi_cli.reports.document import Block, CodeSpan, Grid, Heading, Paragraph, Words
from fvi_cli.reports.naming import DESIGN, members_in_words, number
from fvi_cli.reports.table import Column, grid_of, pivot
from fvi_cli.studies.members import counts_in_words, value_in_words
from fvi_cli.studies.order import OrderCase, OrderTable

OrderEntry = Callable[[OrderCase], str]

MOST_ROWS = 32
"""Up to so many members have rows of their own."""


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


def sweep_summary(tables: Sequence[OrderTable], entry: OrderEntry) -> list[Block]:
    """The swept keys, and the orders of the members."""
    members = [table.member for table in tables if table.member is not None]
    title: Words = (CodeSpan(tables[0].experiment), f": {members_in_words(members)}.")
    tells = next(iter(members[0].unnamed), "") if not members[0].name else DESIGN
    few = len(tables) <= MOST_ROWS and (members[0].name or len(members[0].values) == 1)
    grid = _by_value(tables, tells, entry) if few else _by_method(tables)
    return [Paragraph(words=title), grid]


def _by_value(tables: Sequence[OrderTable], key: str, entry: OrderEntry) -> Grid:
    """Rows: values of the swept key, or designs; columns: methods."""
    each = [(table, case) for table in tables for case in table.cases]
    return pivot(
        (((_label(table, key),), case.method.case, (entry(case),)) for table, case in each),
        corner=(key,),
        headings={case.method.case: (case.method.label,) for _, case in each},
    )


def _label(table: OrderTable, key: str) -> str:
    if key != DESIGN:
        return value_in_words(table.swept[key])
    return "" if table.member is None else table.member.label


@dataclass(frozen=True, kw_only=True)
class _Spread:
    """One method on all members of a sweep."""

    label: str
    found: Sequence[tuple[OrderTable, OrderCase]]

    @property
    def finest(self) -> list[tuple[float, OrderTable]]:
        """Pairs (error on the finest grid, table of the member)."""
        errors = [(case.rows[-1].error, table) for table, case in self.found]
        return [one for one in errors if math.isfinite(one[0])]

    def slope(self, measure: Callable[[Sequence[float]], float]) -> float:
        """A measure (e.g. the least) of the slopes of all members that have one."""
        values = [case.slope for _, case in self.found if math.isfinite(case.slope)]
        return measure(values) if values else math.nan

    @property
    def worst(self) -> tuple[float, OrderTable | None]:
        """The largest error on the finest grid, and the table of its member."""
        return max(self.finest, key=lambda one: one[0], default=(math.nan, None))


_MEASURES: dict[str, Callable[[Sequence[float]], float]] = {
    "slope: least": min,
    "median": statistics.median,
    "greatest": max,
}
_SPREAD_COLUMNS = (
    Column("label", title="method"),
    *(
        Column("slope", title=words, form=".2f", get=partial(_Spread.slope, measure=measure))
        for words, measure in _MEASURES.items()
    ),
    Column(
        "median",
        title="finest error: median",
        form=".1e",
        get=lambda one: statistics.median(e for e, _ in one.finest) if one.finest else math.nan,
    ),
    Column("largest", title="largest", form=".1e", get=lambda one: one.worst[0]),
    Column(
        "member",
        title="at",
        get=lambda one: one.worst[1].member.label if one.worst[1] else None,
    ),
    Column(
        "rows",
        title="rows",
        get=lambda one: counts_in_words(row.status for _, case in one.found for row in case.rows),
    ),
)


def _by_method(tables: Sequence[OrderTable]) -> Grid:
    """Rows: methods; columns: range of orders and errors over the members."""
    cases: dict[str, list[tuple[OrderTable, OrderCase]]] = {}
    for table in tables:
        for case in table.cases:
            cases.setdefault(case.method.label, []).append((table, case))
    items = [_Spread(label=label, found=found) for label, found in cases.items()]
    return grid_of(_SPREAD_COLUMNS, items)


def sweep_details(tables: Sequence[OrderTable], setting: Words) -> list[Block]:
    """Heading, equation, and the errors of all members on every number of steps."""
    cases = list(dict.fromkeys(case.method.label for table in tables for case in table.cases))
    found: dict[tuple[int, str], list[tuple[float, str]]] = {}
    sizes: dict[int, float] = {}
    for table in tables:
        for one in table.cases:
            for row in one.rows:
                sizes[row.n_steps] = row.step_size
                key = (row.n_steps, one.method.label)
                found.setdefault(key, []).append((row.error, row.status))

    def texts(rows: Sequence[tuple[float, str]]) -> tuple[str, str, str]:
        errors = [error for error, _ in rows if math.isfinite(error)]
        return (
            number(statistics.median(errors) if errors else math.nan, ".2e"),
            number(max(errors, default=math.nan), ".2e"),
            counts_in_words(status for _, status in rows),
        )

    grid = pivot(
        (
            ((str(n), f"{sizes[n]:.4g}"), case, texts(found[n, case]))
            for n in sorted(sizes)
            for case in cases
            if (n, case) in found
        ),
        corner=("N", "h"),
        headings={case: (f"{case}: median", "largest", "rows") for case in cases},
        text_columns=0,
    )
    return [Heading(level=2, words=tables[0].experiment), Paragraph(words=setting), grid]
