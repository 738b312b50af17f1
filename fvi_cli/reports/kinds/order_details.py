"""Every error of an experiment, methods side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

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
from fvi_cli.reports.table import pivot
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


def _residual(case: OrderCase) -> str:
    # a line through two points has none, which says nothing
    used = sum(row.used_in_fit for row in case.rows)
    return number(case.fit_residual, ".3f") if case.has_order and used > 2 else "-"


def _remarks(table: OrderTable, names: Mapping[str, MethodName]) -> list[Words]:
    """Sentences below the grids; what is said of several methods is said once."""
    sentences: list[Words] = []
    if any(not row.used_in_fit for case in table.cases for row in case.rows):
        sentences.append(
            "Rows in parentheses are not used for orders; floor: round-off, or ten times the error "
            f"of the reference; errors below {NEAR_FLOOR:g} floors are given as a power of ten, in "
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
    yield from expected_orders(case)
    for steps_at, text, is_example in _remarks_by_steps(case):
        example = f" (numbers of N = {steps_at[0]})" if is_example else ""
        yield f"{steps_phrase(steps, steps_at)}: ", Rough(text), example


def _remarks_by_steps(case: OrderCase) -> list[tuple[list[int], str, bool]]:
    """Remarks and messages with the N that they are about; those that differ in numbers once."""
    found: dict[str, tuple[list[int], list[str]]] = {}
    for row in case.rows:
        for text in (*row.remarks, *((row.message,) if row.message else ())):
            at, texts = found.setdefault(without_numbers(text), ([], []))
            at.append(row.n_steps)
            texts.append(text.rstrip("."))
    return [(at, texts[0], len(set(texts)) > 1) for at, texts in found.values()]
