"""Every error of an experiment, methods side by side."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fvi_cli.reports.document import (
    Block,
    Bullets,
    Equation,
    Grid,
    Heading,
    Paragraph,
    Piece,
    Rough,
    Words,
    pieces,
    without_numbers,
)
from fvi_cli.reports.kinds.order_summary import NORMS, expected_orders, steps_phrase
from fvi_cli.reports.naming import MethodName, number
from fvi_cli.studies.order import NEAR_FLOOR, OrderCase, OrderRow, OrderTable

_SOURCES: Mapping[str, str] = {
    "expression": "the exact solution, an expression of the configuration",
    "unknown": "a reference that is not stated",
}


def details(table: OrderTable, names: Mapping[str, MethodName]) -> list[Block]:
    """Heading, equation, grids of errors and orders, remarks."""
    blocks: list[Block] = [
        Heading(level=2, words=table.experiment),
        Paragraph(words=setting([table])),
    ]
    if not table.cases:
        return [*blocks, Paragraph(words="No run is finished.")]
    blocks.append(_grid(table.cases, names))
    remarks = _remarks(table, names)
    if remarks:
        blocks.append(Bullets(items=tuple(remarks)))
    return blocks


def setting(tables: Sequence[OrderTable]) -> Words:
    """Equation and norm of an experiment, which has a table for every member of a sweep."""
    table = tables[0]
    orders = table.gamma.replace(";", ", ")
    if any(other.gamma != table.gamma for other in tables):
        orders = "swept"
    floors = [row.floor for one in tables for case in one.cases for row in case.rows]
    return (
        "Equation: ",
        Equation(table.equation) if table.equation else "not stated",
        f"; {f'gamma = {orders}; ' if orders else ''}T = {table.final_time:g}. Errors in the "
        f"{NORMS[table.norm]}, against ",
        Rough(f"{_reference(table.reference)}{_floor(floors)}"),
        ".",
    )


def _floor(floors: Sequence[float]) -> str:
    found = [floor for floor in floors if math.isfinite(floor)]
    if not found:
        return ""
    ends = dict.fromkeys(f"{end:.0e}" for end in (min(found), max(found)))
    return f"; floor {' to '.join(ends)}"


def _reference(source: str) -> str:
    if source.startswith("refined run"):
        return f"a {source}"
    if source.startswith("N = "):
        return source
    return _SOURCES.get(source, f"the exact solution, {source}")


def _grid(cases: Sequence[OrderCase], names: Mapping[str, MethodName]) -> Grid:
    header = ["N", "h"]
    for case in cases:
        header += [names[case.method.case].label, "order"]
    steps = sorted({row.n_steps for case in cases for row in case.rows})
    found = [{row.n_steps: k for k, row in enumerate(case.rows)} for case in cases]
    rows = []
    for n_steps in steps:
        sizes = [
            case.rows[at[n_steps]].step_size
            for case, at in zip(cases, found, strict=True)
            if n_steps in at
        ]
        line = [str(n_steps), f"{sizes[0]:.4g}"]
        for case, at in zip(cases, found, strict=True):
            line += _entries(case, at[n_steps]) if n_steps in at else ["not computed", ""]
        rows.append(tuple(line))
    return Grid(
        header=tuple(header),
        rows=tuple(rows),
        summary_rows=tuple(_summary_rows(cases)),
        text_columns=0,
        key_columns=2,
        groups=(2,) * len(cases),
    )


def _entries(case: OrderCase, k: int) -> list[str]:
    row = case.rows[k]
    both = k > 0 and row.used_in_fit and case.rows[k - 1].used_in_fit
    return [error_entry(row), f"{row.pairwise_order:.2f}" if both else ""]


def error_entry(row: OrderRow) -> str:
    """The error where the slope uses it; else in parentheses a bound, or what happened.

    Digits of errors near the floor, and of runs that diverged, are those of one machine.
    """
    if row.used_in_fit:
        return f"{row.error:.2e}"
    if row.status in ("ok", "floor"):
        return f"(below {bound_of_near(row):.0e})" if row.is_near_floor else "(not used)"
    return f"({row.status})"


def bound_of_near(row: OrderRow) -> float:
    """The power of ten above all errors that are near the floor of `row`."""
    return float(f"1e{math.ceil(math.log10(NEAR_FLOOR * row.floor))}") if row.floor > 0 else 0.0


def _summary_rows(cases: Sequence[OrderCase]) -> list[tuple[str, ...]]:
    lines = [
        ("slope", [number(case.slope, ".2f") for case in cases]),
        ("residual", [_residual(case) for case in cases]),
        ("expected", [number(case.expected_order, ".3g") for case in cases]),
    ]
    if any(not math.isnan(case.claim) for case in cases):
        lines.append(("stated", [number(case.claim, "g") for case in cases]))
    rows = []
    for title, values in lines:
        row = [title, ""]
        for value in values:
            row += ["", value]
        rows.append(tuple(row))
    return rows


def _residual(case: OrderCase) -> str:
    # a line through two points has none, which says nothing
    used = sum(row.used_in_fit for row in case.rows)
    return number(case.fit_residual, ".3f") if used > 2 else "-"


def _remarks(table: OrderTable, names: Mapping[str, MethodName]) -> list[Words]:
    """Sentences below the grids; what is said of several methods is said once."""
    sentences: list[Words] = []
    if any(not row.used_in_fit for case in table.cases for row in case.rows):
        sentences.append(
            "Rows in parentheses are not used for orders; floor: round-off, or ten times the error "
            f"of the reference; errors below {NEAR_FLOOR:g} floors are told by a power of ten, in "
            "full in the CSV form."
        )
    said: dict[tuple[Piece, ...], list[str]] = {}
    for case in table.cases:
        for sentence in _of_case(case):
            said.setdefault(pieces(sentence), []).append(names[case.method.case].label)
    sentences += [(f"{'; '.join(labels)}: ", *sentence, ".") for sentence, labels in said.items()]
    return sentences


def _of_case(case: OrderCase) -> Iterator[Words]:
    steps = [row.n_steps for row in case.rows]
    unstable = [row.n_steps for row in case.rows if row.predicted == "unstable"]
    if unstable:
        yield f"predicted unstable at {steps_phrase(steps, unstable)}"
    if case.expected_failure:
        yield "the configuration expects failures"
    yield from expected_orders(case)
    for told, text, is_example in _told(case):
        example = f" (numbers of N = {told[0]})" if is_example else ""
        yield f"{steps_phrase(steps, told)}: ", Rough(text), example


def _told(case: OrderCase) -> list[tuple[list[int], str, bool]]:
    """Remarks and messages with the N that they are about; those that differ in numbers once."""
    found: dict[str, tuple[list[int], list[str]]] = {}
    for row in case.rows:
        for text in (*row.remarks, *((row.message,) if row.message else ())):
            at, texts = found.setdefault(without_numbers(text), ([], []))
            at.append(row.n_steps)
            texts.append(text.rstrip("."))
    return [(at, texts[0], len(set(texts)) > 1) for at, texts in found.values()]
