"""The report on orders of convergence, with every error, a column for each method."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import cast, get_args

from fvi_cli.integrator.method_names import MethodName
from fvi_cli.reports.document import (
    Block,
    Bullets,
    Equation,
    Grid,
    Heading,
    Paragraph,
    Piece,
    Rough,
    RoughEntry,
    Words,
    pieces,
    without_numbers,
)
from fvi_cli.reports.kinds.order_summary import (
    NORMS,
    legend,
    names_in_tables,
    orders_in_words,
    reference_in_words,
    steps_phrase,
    summary,
    unlike_expected,
)
from fvi_cli.reports.kinds.order_sweeps import split_sweeps, sweep_details
from fvi_cli.reports.naming import member_columns, number
from fvi_cli.reports.table import (
    About,
    Column,
    Report,
    Row,
    Sheet,
    Value,
    Within,
    number_of,
    pivot,
    within,
)
from fvi_cli.studies.experiment import Observed
from fvi_cli.studies.norms import round_up
from fvi_cli.studies.order import NEAR_FLOOR, OrderCase, OrderRow, OrderTable

ERROR = Within(relative=1e-3)
"""Tolerance for reliable errors."""

RELIABLE = 2 * NEAR_FLOOR
"""Errors above this many floors are equal on every machine.

It is twice the limit below which no order uses a row, so that on another machine an error near
that limit may lie on the other side.
"""

_EXPERIMENT = Column("experiment", "name of the experiment", get="table.experiment")


COLUMNS = (
    _EXPERIMENT,
    Column("case", "name of the method in files", get="case.method.case"),
    *within(
        "described",
        Column("cq", "convolution quadrature, or the baseline"),
        Column("sampling", "where the damping is sampled"),
        Column("degree", "degree of the polynomials"),
        Column("quadrature", "quadrature of the action and its number of points"),
        Column("start", "start correction"),
    ),
    Column("gamma", "orders of the damping, joined by ;", get="table.gamma"),
    Column("norm", "norm of the error", get="table.norm"),
    *within(
        "row",
        Column("n_steps", "number N of steps"),
        Column("step_size", "h, in the scene's unit of time"),
        Column("error", "error of the position, in its unit", compared=ERROR),
        # orders must follow from the stored errors, and agree with the new ones within 0.01
        Column(
            "pairwise_order",
            "order against the row before",
            compared=None,
            follows=True,
            get=lambda of: of.case.pairwise_order(of.index),
        ),
        Column("used_in_fit", "whether the slope uses the row", follows=True),
    ),
    *within(
        "case",
        Column(
            "slope",
            "least-squares slope of log(error) against log(h) over the rows used",
            compared=None,
            follows=True,
        ),
        Column(
            "fit_residual", "rms residual of that fit in log10(error)", compared=None, follows=True
        ),
    ),
    *within(
        "row",
        Column("expected_order", "order on smooth data"),
        Column("predicted", "predicted stability"),
        Column("status", "what was observed"),
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
EXPERIMENT_COLUMNS = (
    Column("experiment", "name of the experiment, and member of a sweep", get="title"),
    Column("equation", "equation of motion"),
    Column("reference", "what errors are measured against", compared=None),
    Column("final_time", "T, in the scene's unit of time"),
)


def order_report(name: str, tables: Sequence[OrderTable]) -> Report:
    """The report on the orders of all experiments of the configuration `name`.

    A sweep has a table for every member, and the last columns hold names and every swept key.
    """
    swept = member_columns((table.member for table in tables), lambda of: of.table.member)
    columns = (*COLUMNS, *swept, *EXTRA_COLUMNS)
    items = (
        About(table=table, case=case, index=index, row=row, described=described)
        for table in tables
        for case in table.cases
        for described in (SimpleNamespace(**case.columns()),)
        for index, row in enumerate(case.rows)
    )
    keys = ("experiment", "case", "n_steps", *(column.name for column in swept))
    runs = Sheet.of("runs", columns, items, keys, below_floor=_below_floor)
    experiments = Sheet.of(
        "experiments", EXPERIMENT_COLUMNS, tables, ("experiment",), is_file=False
    )
    return Report(
        name=name,
        sheets=(runs, experiments),
        words=lambda sheets: _words(name, tables),
        remake=lambda sheets: order_report(name, list(_with_rows(tables, sheets["runs"].rows))),
    )


def _words(name: str, tables: Sequence[OrderTable]) -> tuple[Sequence[Block], Sequence[Block]]:
    orders = [Heading(level=1, words=f"Orders of convergence: {name}"), *summary(name, tables)]
    return orders, [*orders, *legend(tables), *_all_details(tables)]


def _all_details(tables: Sequence[OrderTable]) -> Iterator[Block]:
    names = names_in_tables(tables)
    single, swept = split_sweeps(tables)
    for table in single:
        yield from details(table, names)
    for members in swept:
        yield from sweep_details(members, names, setting(members))


def _below_floor(stored: Row, fresh: Row) -> set[str]:
    """Columns not compared: errors near the floor with what follows, errors of diverged runs."""
    if fresh["status"] not in ("ok", "floor"):
        return {"error"}
    error, other, floor = (number_of(v) for v in (stored["error"], fresh["error"], fresh["floor"]))
    is_round_off = stored["status"] in ("ok", "floor") and max(error, other) <= RELIABLE * floor
    return {"error", "status", "used_in_fit"} if is_round_off else set()


def _status(value: Value) -> Observed:
    if value not in get_args(Observed):
        raise ValueError(f"status: {value!r} is not one of {', '.join(get_args(Observed))}")
    return cast(Observed, value)


def _with_rows(tables: Sequence[OrderTable], rows: Sequence[Row]) -> Iterator[OrderTable]:
    """The tables with the errors of `rows`, and the orders that follow from them."""
    stored = iter(rows)
    for table in tables:
        cases = []
        for case in table.cases:
            own = tuple(
                replace(row, error=number_of(found["error"]), status=_status(found["status"]))
                for row, found in zip(case.rows, stored, strict=False)
            )
            cases.append(replace(case, rows=own))
        yield replace(table, cases=tuple(cases))


def details(table: OrderTable, names: Mapping[str, MethodName]) -> Iterator[Block]:
    """Heading, equation, grids of errors and orders, remarks."""
    yield Heading(level=2, words=table.experiment)
    yield Paragraph(words=setting([table]))
    if not table.cases:
        yield Paragraph(words="No run is finished.")
        return
    yield replace(_grid(table.cases, names), name=f"{table.experiment}-runs")
    if remarks := _remarks(table, names):
        yield Bullets(items=tuple(remarks))


def setting(tables: Sequence[OrderTable]) -> Words:
    """Equation and norm of an experiment; `tables` are those of its members for a sweep."""
    table = tables[0]
    orders = orders_in_words(table)
    if any(other.gamma != table.gamma for other in tables):
        orders = "swept"
    floors = [row.floor for one in tables for case in one.cases for row in case.rows]
    return (
        "Equation: ",
        Equation(table.equation) if table.equation else "not stated",
        f"; {f'gamma = {orders}; ' if orders else ''}T = {table.final_time:g}. Errors in the "
        f"{NORMS[table.norm]}, against ",
        Rough(f"{reference_in_words(table.reference)}{_floor(floors)}"),
        ".",
    )


def _floor(floors: Sequence[float]) -> str:
    found = [floor for floor in floors if math.isfinite(floor)]
    if not found:
        return ""
    ends = dict.fromkeys(f"{end:.0e}" for end in (min(found), max(found)))
    return f"; floor {' to '.join(ends)}"


def _grid(cases: Sequence[OrderCase], names: Mapping[str, MethodName]) -> Grid:
    cells: list[tuple[int, str, str, Sequence[str]]] = sorted(
        (row.n_steps, f"{row.step_size:.4g}", case.method.case, _entries(case, k))
        for case in cases
        for k, row in enumerate(case.rows)
    )
    sizes = {n: size for n, size, _, _ in reversed(cells)}
    below: list[tuple[str, Callable[[OrderCase], str]]] = [
        ("slope", lambda case: f"{case.slope:.2f}" if case.has_order else "-"),
        ("residual", _residual),
        ("expected", lambda case: number(case.expected_order, ".3g")),
        ("stated", lambda case: number(case.claim, "g")),
    ]
    has_claims = any(not math.isnan(case.claim) for case in cases)
    return pivot(
        (((str(n), sizes[n]), case, texts) for n, _, case, texts in cells),
        corner=("N", "h"),
        headings={case.method.case: (names[case.method.case].label, "order") for case in cases},
        absent="not computed",
        summary=[
            ((title, ""), {case.method.case: ("", get(case)) for case in cases})
            for title, get in below[: 4 if has_claims else 3]
        ],
        text_columns=0,
    )


def _entries(case: OrderCase, k: int) -> list[str]:
    row = case.rows[k]
    both = k > 0 and case.has_order and row.used_in_fit and case.rows[k - 1].used_in_fit
    return [error_entry(row), f"{case.pairwise_order(k):.2f}" if both else ""]


def error_entry(row: OrderRow) -> str:
    """The error if the slope uses it; else in parentheses a bound, or the status of the run.

    Errors near the floor and of diverged runs are not shown, since they differ between machines.
    """
    if row.used_in_fit:
        return f"{row.error:.2e}"
    if row.status in ("ok", "floor"):
        if not row.is_near_floor:
            return "(not used)"
        return RoughEntry(f"(below {round_up(NEAR_FLOOR * row.floor)})")
    return f"({row.status})"


def _residual(case: OrderCase) -> str:
    # a line through two points has no residual
    used = sum(row.used_in_fit for row in case.rows)
    return number(case.fit_residual, ".3f") if case.has_order and used > 2 else "-"


def _remarks(table: OrderTable, names: Mapping[str, MethodName]) -> list[Words]:
    """Sentences below the grids; a sentence on several methods is given once."""
    sentences: list[Words] = []
    if any(not row.used_in_fit for case in table.cases for row in case.rows):
        sentences.append(
            "Rows in parentheses are not used for orders; floor: round-off, or ten times the error "
            f"of the reference; errors below {NEAR_FLOOR:g} floors are given as that bound, in "
            "full in the CSV form."
        )
    labels_by_sentence: dict[tuple[Piece, ...], list[str]] = {}
    for case in table.cases:
        for sentence in _of_case(case):
            labels_by_sentence.setdefault(pieces(sentence), []).append(
                names[case.method.case].label
            )
    sentences += [
        (f"{'; '.join(labels)}: ", *sentence, ".")
        for sentence, labels in labels_by_sentence.items()
    ]
    return sentences


def _of_case(case: OrderCase) -> Iterator[Words]:
    steps = [row.n_steps for row in case.rows]
    unstable = [row.n_steps for row in case.rows if row.predicted == "unstable"]
    if unstable:
        yield f"predicted unstable at {steps_phrase(steps, unstable)}"
    if case.expected_failure:
        yield "the configuration expects failures"
    if sentence := unlike_expected(case):
        yield sentence
    for steps_at, text, is_example in _remarks_by_steps(case):
        example = f" (numbers of N = {steps_at[0]})" if is_example else ""
        yield f"{steps_phrase(steps, steps_at)}: ", Rough(text), example


def _remarks_by_steps(case: OrderCase) -> list[tuple[list[int], str, bool]]:
    """Triples (N's, remark, whether its numbers differ); remarks equal up to numbers are one."""
    found: dict[str, tuple[list[int], list[str]]] = {}
    for row in case.rows:
        for text in (*row.remarks, *((row.message,) if row.message else ())):
            at, texts = found.setdefault(without_numbers(text), ([], []))
            at.append(row.n_steps)
            texts.append(text.rstrip("."))
    return [(at, texts[0], len(set(texts)) > 1) for at, texts in found.values()]
