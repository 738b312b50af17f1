"""The report on orders of convergence: every error, and the slopes of all methods."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace

from fvi_cli.reports.document import Block, Bullets, Grid, Heading, Paragraph
from fvi_cli.reports.naming import listing, member_columns, members_in_words, number
from fvi_cli.reports.table import (
    About,
    Cell,
    Column,
    Report,
    Row,
    Sheet,
    Within,
    number_of,
    pivot,
    within,
)
from fvi_cli.studies.members import counts_in_words
from fvi_cli.studies.order import OrderCase, OrderTable

ERROR = Within(relative=1e-3)
"""Tolerance for reliable errors."""
RELIABLE = 2000.0
"""Errors above this many floors are equal on every machine."""
MOST_MEMBERS = 32
"""Up to so many members have a row of their own."""
MOST_METHODS = 8
"""More methods of a single experiment have a row each."""
NORMS: Mapping[str, str] = {
    "max": "maximum norm over components and grid points",
    "final": "maximum norm over components at the final time",
    "l2": "l2 norm over the grid, weighted by h",
}
_SOURCES: Mapping[str, str] = {
    "expression": "the exact solution, an expression of the configuration",
    "unknown": "a reference that is not stated",
}
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
    Column(
        "slope",
        "least-squares slope of log(error) against log(h) over the rows used",
        compared=None,
        get="case.slope",
    ),
    *within(
        "row",
        Column("order_smooth", "order on smooth data", get="order_smooth"),
        Column("status", "what was observed"),
        Column("seconds", "of the steps", compared=None),
        Column("history_operations", "multiply-adds on the history", compared=None),
        Column("floor", "errors below are round-off or the reference's own", is_extra=True),
        Column("message", "what happened", is_extra=True),
    ),
    Column(
        "remarks",
        "what a reader should know",
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
    columns = (_EXPERIMENT, *swept, *COLUMNS)
    keys = ("experiment", *(column.name for column in swept), "case", "n_steps")
    orders = [Heading(1, f"Orders of convergence: {name}"), *_summary(name, tables)]
    return Report(
        name=name,
        sheets=(Sheet.of("runs", columns, items, keys, below_floor=_below_floor),),
        shown=orders,
        blocks=[*orders, *_details(tables)],
        has_latex=True,
    )


def _below_floor(stored: Row, fresh: Row) -> set[str]:
    """Columns not compared: errors near the floor, and of diverged runs."""
    if fresh["status"] not in ("ok", "floor"):
        return {"error"}
    error, other, floor = (number_of(v) for v in (stored["error"], fresh["error"], fresh["floor"]))
    is_round_off = stored["status"] in ("ok", "floor") and max(error, other) <= RELIABLE * floor
    return {"error", "status", "used_in_fit"} if is_round_off else set()


def reference_in_words(source: str) -> str:
    """The reference of errors, in words."""
    if source.startswith("reference run"):
        return f"a {source}"
    if source.startswith("N = "):
        return source
    return _SOURCES.get(source, f"the exact solution, {source}")


# --- the slopes of all experiments ----------------------------------------------------------------


def _summary(name: str, tables: Sequence[OrderTable]) -> Iterator[Block]:
    """Slopes of all experiments; of the members of a sweep one by one, or summed up."""
    groups: dict[tuple[str, ...], list[OrderTable]] = {}
    swept: dict[str, list[OrderTable]] = {}
    for table in tables:
        cases = tuple(case.method.case for case in table.cases)
        if table.swept:
            swept.setdefault(table.experiment, []).append(table)
        elif cases:
            groups.setdefault(cases, []).append(table)
    titles = [table.experiment for group in groups.values() for table in group]
    prefix = f"{name}-" if all(title.startswith(f"{name}-") for title in titles) else ""
    for group in groups.values():
        yield _slopes(group, prefix)
    for experiment, members in swept.items():
        found = [table.member for table in members if table.member is not None]
        yield Paragraph(f"`{experiment}`: {members_in_words(found)}.")
        few = len(members) <= MOST_MEMBERS
        yield _slopes(members) if few else _spread(members)
    if not groups and not swept:
        yield Paragraph("No run is finished.")


def _label(table: OrderTable) -> str:
    return "" if table.member is None else table.member.label


def _slopes(group: Sequence[OrderTable], prefix: str = "") -> Grid:
    """Rows: experiments or members, columns: methods, with the orders that are stated.

    Many methods of a single experiment have a row each.
    """
    stated = {c.method.case for table in group for c in table.cases if not math.isnan(c.claim)}

    def texts(case: OrderCase) -> list[str]:
        return [_slope(case), *[number(case.claim, "g")] * (case.method.case in stated)]

    if len(group) == 1 and len(group[0].cases) > MOST_METHODS:
        heads = ("slope", "stated")[: 1 + bool(stated)]
        lines = [(case.method.label, *texts(case), "-") for case in group[0].cases]
        rows = tuple(line[: 1 + len(heads)] for line in lines)
        return Grid(header=("method", *heads), rows=rows)
    corner = ("member",) if group[0].swept else ("problem", "gamma", "N")
    return pivot(
        (
            (_begin(table, prefix), case.method.case, texts(case))
            for table in group
            for case in table.cases
        ),
        corner=corner,
        headings={
            case.method.case: (case.method.label, *["stated"] * (case.method.case in stated))
            for table in group
            for case in table.cases
        },
    )


def _begin(table: OrderTable, prefix: str) -> tuple[str, ...]:
    """The member, or experiment, orders of the damping, and the ladder."""
    if table.swept:
        return (_label(table),)
    steps = sorted({row.n_steps for case in table.cases for row in case.rows})
    ladder = str(steps[0]) if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"
    return table.experiment.removeprefix(prefix), _orders(table) or "-", ladder


def _orders(table: OrderTable) -> str:
    return ", ".join(dict.fromkeys(filter(None, table.gamma.split(";"))))


def _slope(case: OrderCase) -> str:
    """The slope; without one the only error, or what became of the runs."""
    if math.isfinite(case.slope):
        return f"{case.slope:.2f}"
    if len(case.rows) == 1 and math.isfinite(case.rows[0].error):
        return f"error {case.rows[0].error:.1e}"
    lost = [row.status for row in case.rows if row.status not in ("ok", "floor")]
    return lost[0] if lost else "floor" if case.rows else "-"


def _spread(tables: Sequence[OrderTable]) -> Grid:
    """Rows: methods; columns: range of slopes and of the finest errors over the members."""
    found: dict[str, list[tuple[OrderTable, OrderCase]]] = {}
    for table in tables:
        for case in table.cases:
            found.setdefault(case.method.label, []).append((table, case))
    cells: list[Cell] = []
    for label, own in found.items():
        slopes = [case.slope for _, case in own if math.isfinite(case.slope)]
        errors = {table.title: case.rows[-1].error for table, case in own}
        finite = {title: error for title, error in errors.items() if math.isfinite(error)}
        worst = max(finite, key=finite.__getitem__, default="")
        at = next((_label(table) for table, _ in own if table.title == worst), "-")
        texts = [f"{measure(slopes):.2f}" if slopes else "-" for measure in _MEASURES]
        texts += [f"{measure(finite.values()):.1e}" if finite else "-" for measure in _MEASURES[1:]]
        counts = counts_in_words(row.status for _, case in own for row in case.rows)
        cells.append(((label,), "", [*texts, at, counts]))
    heads = ("slope: least", "median", "greatest", "finest error: median", "largest", "at", "rows")
    return pivot(cells, corner=("method",), headings={"": heads})


_MEASURES = (min, statistics.median, max)


# --- the errors of every experiment ---------------------------------------------------------------


def _details(tables: Sequence[OrderTable]) -> Iterator[Block]:
    """Of every experiment heading, equation, errors and remarks of the runs."""
    groups: dict[str, list[OrderTable]] = {}
    for table in tables:
        groups.setdefault(table.experiment, []).append(table)
    for name, own in groups.items():
        yield Heading(2, name)
        yield Paragraph(_setting(own))
        if not own[0].cases:
            yield Paragraph("No run is finished.")
        else:
            yield _member_errors(own) if own[0].swept else _errors(own[0].cases)
        remarks = [] if own[0].swept else _remarks(own[0])
        if remarks:
            yield Bullets(tuple(remarks))


def _setting(tables: Sequence[OrderTable]) -> str:
    """Equation and norm of an experiment; `tables` are those of its members for a sweep."""
    table = tables[0]
    orders = "swept" if any(one.gamma != table.gamma for one in tables) else _orders(table)
    rows = (row for one in tables for case in one.cases for row in case.rows)
    mark = (
        "; in parentheses: not used for the slope" if not all(r.used_in_fit for r in rows) else ""
    )
    equation = f"`{table.equation}`" if table.equation else "not stated"
    return (
        f"Equation: {equation}; {f'gamma = {orders}; ' if orders else ''}T = {table.final_time:g}. "
        f"Errors in the {NORMS[table.norm]}, against {reference_in_words(table.reference)}{mark}."
    )


def _errors(cases: Sequence[OrderCase]) -> Grid:
    """A line for every N with the error and the order of every method; slope and theory below."""
    cells = sorted(
        (row.n_steps, f"{row.step_size:.4g}", case.method.case, _entries(case, k))
        for case in cases
        for k, row in enumerate(case.rows)
    )
    sizes = {n: size for n, size, _, _ in reversed(cells)}
    below = {
        "slope": [number(case.slope, ".2f") for case in cases],
        "on smooth data": [number(case.order_smooth, ".3g") for case in cases],
        "stated": [number(case.claim, "g") for case in cases],
    }
    return pivot(
        (((str(n), sizes[n]), case, texts) for n, _, case, texts in cells),
        corner=("N", "h"),
        headings={case.method.case: (case.method.label, "order") for case in cases},
        foot=[
            ((title, ""), {c.method.case: ("", one) for c, one in zip(cases, words, strict=True)})
            for title, words in below.items()
            if title == "slope" or set(words) != {"-"}
        ],
        text_columns=0,
    )


def _entries(case: OrderCase, k: int) -> list[str]:
    """The measured error, in parentheses where the slope does not use it, and the order."""
    row = case.rows[k]
    if math.isnan(row.error) or row.status == "diverged":
        return [row.status, ""]
    error = f"{row.error:.2e}" if row.used_in_fit else f"({row.error:.2e})"
    return [error, number(case.pairwise_order(k), ".2f", "")]


def _member_errors(tables: Sequence[OrderTable]) -> Grid:
    """A line for every N with the median and the largest error of the members."""
    found: dict[tuple[int, str, str], list[tuple[float, str]]] = {}
    for table in tables:
        for case in table.cases:
            for row in case.rows:
                key = (row.n_steps, f"{row.step_size:.4g}", case.method.label)
                found.setdefault(key, []).append((row.error, row.status))

    def texts(rows: Sequence[tuple[float, str]]) -> tuple[str, str, str]:
        errors = [error for error, _ in rows if math.isfinite(error)]
        least, most = (statistics.median(errors), max(errors)) if errors else (math.nan, math.nan)
        counts = counts_in_words(status for _, status in rows)
        return number(least, ".2e"), number(most, ".2e"), counts

    return pivot(
        (((str(n), size), case, texts(found[n, size, case])) for n, size, case in sorted(found)),
        corner=("N", "h"),
        headings={
            case: (f"{case}: median", "largest", "rows")
            for case in dict.fromkeys(case for _, _, case in found)
        },
        text_columns=0,
    )


def _remarks(table: OrderTable) -> list[str]:
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
