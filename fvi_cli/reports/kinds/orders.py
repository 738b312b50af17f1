"""The report on orders of convergence, with every error, a column for each method."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from types import SimpleNamespace

from fvi_cli.reports.document import Block, Bullets, CodeSpan, Grid, Heading, Paragraph, Words
from fvi_cli.reports.kinds.order_summary import (
    NORMS,
    orders_in_words,
    reference_in_words,
    summary,
)
from fvi_cli.reports.kinds.order_sweeps import split_sweeps, sweep_details
from fvi_cli.reports.naming import listing, member_columns, number
from fvi_cli.reports.table import (
    About,
    Column,
    Report,
    Row,
    Sheet,
    Within,
    number_of,
    pivot,
    within,
)
from fvi_cli.studies.order import OrderCase, OrderTable

ERROR = Within(relative=1e-3)
"""Tolerance for reliable errors."""

RELIABLE = 2000.0
"""Errors above this many floors are equal on every machine."""

_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment")
COLUMNS = (
    Column("case", "name of the method in files", get="case.method.case"),
    *within(
        "described",
        Column("cq", "convolution quadrature, or the baseline"),
        Column("sampling", "where the damping is sampled"),
        Column("degree", "degree of the polynomials"),
        Column("quadrature", "quadrature of the action and its number of points"),
        Column("start", "start correction"),
    ),
    Column("norm", "norm of the error", get="table.norm"),
    *within(
        "row",
        Column("n_steps", "number N of steps"),
        Column("step_size", "h, in the scene's unit of time"),
        Column("error", "error of the position, in its unit", compared=ERROR),
        Column(
            "pairwise_order",
            "order against the row before",
            compared=None,
            get=lambda of: of.case.pairwise_order(of.index),
        ),
        Column("used_in_fit", "whether the slope uses the row"),
    ),
    *within(
        "case",
        Column(
            "slope",
            "least-squares slope of log(error) against log(h) over the rows used",
            compared=None,
        ),
    ),
    *within(
        "row",
        Column("expected_order", "order on smooth data"),
        Column("status", "what was observed"),
        Column("seconds", "of the steps", compared=None),
        Column("history_operations", "multiply-adds on the history", compared=None),
    ),
)
EXTRA_COLUMNS = within(
    "row",
    Column("floor", "errors below are round-off or the reference's own", "", "", None, "", True),
    Column("message", "what happened", "", "", None, "", True),
    Column(
        "remarks",
        "what a reader should know",
        compared=None,
        is_extra=True,
        get=lambda of: "; ".join(of.row.remarks),
    ),
)


def order_report(name: str, tables: Sequence[OrderTable]) -> Report:
    """The report on the orders of all experiments of the configuration `name`.

    A sweep has a table for every member, whose names and swept values stand behind that of the
    experiment.
    """
    swept = member_columns((table.member for table in tables), lambda of: of.table.member)
    items = (
        About(table=table, case=case, index=index, row=row, described=described)
        for table in tables
        for case in table.cases
        for described in (SimpleNamespace(**case.columns()),)
        for index, row in enumerate(case.rows)
    )
    columns = (_EXPERIMENT, *swept, *COLUMNS, *EXTRA_COLUMNS)
    keys = ("experiment", *(column.name for column in swept), "case", "n_steps")
    orders = [Heading(level=1, words=f"Orders of convergence: {name}"), *summary(name, tables)]
    return Report(
        name=name,
        sheets=(Sheet.of("runs", columns, items, keys, below_floor=_below_floor),),
        shown=orders,
        blocks=[*orders, *_all_details(tables)],
        has_latex=True,
    )


def _below_floor(stored: Row, fresh: Row) -> set[str]:
    """Columns not compared: errors near the floor, and of diverged runs."""
    if fresh["status"] not in ("ok", "floor"):
        return {"error"}
    error, other, floor = (number_of(v) for v in (stored["error"], fresh["error"], fresh["floor"]))
    is_round_off = stored["status"] in ("ok", "floor") and max(error, other) <= RELIABLE * floor
    return {"error", "status", "used_in_fit"} if is_round_off else set()


def _all_details(tables: Sequence[OrderTable]) -> Iterator[Block]:
    single, swept = split_sweeps(tables)
    for table in single:
        yield from details(table)
    for members in swept:
        yield from sweep_details(members, setting(members))


def details(table: OrderTable) -> Iterator[Block]:
    """Heading, equation, grid of errors and orders, remarks of the runs."""
    yield Heading(level=2, words=table.experiment)
    yield Paragraph(words=setting([table]))
    if not table.cases:
        yield Paragraph(words="No run is finished.")
        return
    yield _grid(table.cases)
    if remarks := _remarks(table):
        yield Bullets(items=tuple(remarks))


def setting(tables: Sequence[OrderTable]) -> Words:
    """Equation and norm of an experiment; `tables` are those of its members for a sweep."""
    table = tables[0]
    orders = orders_in_words(table)
    if any(other.gamma != table.gamma for other in tables):
        orders = "swept"
    is_marked = any(
        not row.used_in_fit for one in tables for case in one.cases for row in case.rows
    )
    return (
        "Equation: ",
        CodeSpan(table.equation) if table.equation else "not stated",
        f"; {f'gamma = {orders}; ' if orders else ''}T = {table.final_time:g}. Errors in the "
        f"{NORMS[table.norm]}, against {reference_in_words(table.reference)}"
        f"{'; in parentheses: not used for the slope' if is_marked else ''}.",
    )


def _grid(cases: Sequence[OrderCase]) -> Grid:
    cells: list[tuple[int, str, str, Sequence[str]]] = sorted(
        (row.n_steps, f"{row.step_size:.4g}", case.method.case, _entries(case, k))
        for case in cases
        for k, row in enumerate(case.rows)
    )
    sizes = {n: size for n, size, _, _ in reversed(cells)}
    below: list[tuple[str, Callable[[OrderCase], str]]] = [
        ("slope", lambda case: number(case.slope, ".2f")),
        ("on smooth data", lambda case: number(case.expected_order, ".3g")),
        ("stated", lambda case: number(case.claim, "g")),
    ]
    feet = [
        (title, [get(case) for case in cases])
        for title, get in below
        if title == "slope" or any(get(case) != "-" for case in cases)
    ]
    return pivot(
        (((str(n), sizes[n]), case, texts) for n, _, case, texts in cells),
        corner=("N", "h"),
        headings={case.method.case: (case.method.label, "order") for case in cases},
        absent="-",
        summary=[
            (
                (title, ""),
                {case.method.case: ("", word) for case, word in zip(cases, words, strict=True)},
            )
            for title, words in feet
        ],
        text_columns=0,
    )


def _entries(case: OrderCase, k: int) -> list[str]:
    """The measured error, in parentheses where the slope does not use it, and the order."""
    row = case.rows[k]
    error = row.status if math.isnan(row.error) else f"{row.error:.2e}"
    if row.status == "diverged":
        error = row.status
    is_marked = not row.used_in_fit and error != row.status
    order = number(case.pairwise_order(k), ".2f", "")
    return [f"({error})" if is_marked else error, order]


def _remarks(table: OrderTable) -> list[Words]:
    """What the runs say, once for every method and text; of failures that of the first run."""
    found: dict[tuple[str, str], list[int]] = {}
    for case in table.cases:
        label = case.method.label
        for row in case.rows:
            for text in row.remarks:
                found.setdefault((label, text), []).append(row.n_steps)
        failed = next((row for row in case.rows if row.message), None)
        if failed is not None:
            found.setdefault((label, failed.message), []).append(failed.n_steps)
    return [
        f"{label}, N = {listing(steps)}: {text.rstrip('.')}."
        for (label, text), steps in found.items()
    ]
