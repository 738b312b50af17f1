"""The paper's layout: one row for a problem, one column for a method, an order in every cell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.reports.document import Block, Grid, Paragraph
from fvi_cli.reports.kinds.order_sweeps import split_sweeps, sweep_summary
from fvi_cli.reports.naming import number
from fvi_cli.reports.table import pivot
from fvi_cli.studies.order import OrderCase, OrderTable

NORMS: Mapping[str, str] = {
    "max": "maximum norm over components and grid points",
    "final": "maximum norm over components at the final time",
    "l2": "l2 norm over the grid, weighted by h",
}


_SOURCES: Mapping[str, str] = {
    "expression": "the exact solution, an expression of the configuration",
    "unknown": "a reference that is not stated",
}


def reference_in_words(source: str) -> str:
    """The reference of errors, in words."""
    if source.startswith("refined run"):
        return f"a {source}"
    if source.startswith("N = "):
        return source
    return _SOURCES.get(source, f"the exact solution, {source}")


def short_titles(name: str, tables: Sequence[OrderTable]) -> dict[str, str]:
    """Titles of the experiments, without words that repeat the beginning of `name`.

    Every shortened title must begin with a letter; otherwise none is shortened.
    """
    titles = [table.experiment for table in tables]
    words = name.split("-")
    # a single title is not shortened
    for count in range(len(words) if len(titles) > 1 else 0, 0, -1):
        prefix = "-".join(words[:count]) + "-"
        short = {title: title.removeprefix(prefix) for title in titles}
        if all(rest != title and rest[:1].isalpha() for title, rest in short.items()):
            return short
    return {title: title for title in titles}


def summary(name: str, tables: Sequence[OrderTable]) -> Iterator[Block]:
    """Orders of all experiments in one table."""
    single, swept = split_sweeps(tables)
    titles = short_titles(name, single)
    groups = _groups(single)
    if not groups and not swept:
        yield Paragraph(words="No run is finished.")
        return
    yield from (_grid(group, titles) for group in groups)
    for members in swept:
        yield from sweep_summary(members, order_entry)


def _groups(tables: Sequence[OrderTable]) -> list[list[OrderTable]]:
    """Groups of experiments with the same methods, in the order of the configuration."""
    groups: dict[tuple[str, ...], list[OrderTable]] = {}
    for table in tables:
        cases = tuple(case.method.case for case in table.cases)
        if cases:
            groups.setdefault(cases, []).append(table)
    return list(groups.values())


def _grid(group: Sequence[OrderTable], titles: Mapping[str, str]) -> Grid:
    """Rows: problems and members of method families; columns: families of methods.

    If methods do not fill a rectangle, rows are methods and columns problems.
    """
    own = [case.method for case in group[0].cases]
    variants = list(dict.fromkeys(method.variant for method in own))
    families = list(dict.fromkeys(method.family for method in own))
    is_rectangle = len(variants) > 1 and len(own) == len(families) * len(variants)
    is_full = is_rectangle or len(own) == len(families)
    name = attrgetter("family" if is_rectangle else "label")
    names = list(dict.fromkeys(name(method) for method in own))
    each = [(t, case, case.method) for t in group for case in t.cases]
    if is_rectangle:
        each.sort(key=lambda one: (group.index(one[0]), variants.index(one[2].variant)))

    def column(table: OrderTable, method: AnyMethod) -> str:
        return str(name(method)) if is_full else titles[table.experiment]

    def begin(table: OrderTable, method: AnyMethod) -> tuple[str, ...]:
        if not is_full:
            return (method.label,)
        variant = [method.variant] if is_rectangle else []
        return (titles[table.experiment], *variant, orders_in_words(table) or "-", _ladder(table))

    claimed = {column(t, method) for t, case, method in each if not math.isnan(case.claim)}
    full = ("problem", *(["method"] if is_rectangle else []), "gamma", "N")
    return pivot(
        (
            (
                begin(t, method),
                at := column(t, method),
                (order_entry(case), *([number(case.claim, "g")] if at in claimed else [])),
            )
            for t, case, method in each
        ),
        corner=full if is_full else ("method",),
        headings={
            at: (at, "stated") if at in claimed else (at,)
            for at in (names if is_full else [titles[t.experiment] for t in group])
        },
    )


def orders_in_words(table: OrderTable) -> str:
    """The distinct orders of the damping."""
    return ", ".join(dict.fromkeys(filter(None, table.gamma.split(";"))))


def _ladder(table: OrderTable) -> str:
    steps = sorted({row.n_steps for case in table.cases for row in case.rows})
    return str(steps[0]) if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"


def order_entry(case: OrderCase) -> str:
    """The slope; without one the only error, or what became of the runs."""
    if math.isfinite(case.slope):
        return f"{case.slope:.2f}"
    if len(case.rows) == 1 and math.isfinite(case.rows[0].error):
        return f"error {case.rows[0].error:.1e}"
    lost = [row.status for row in case.rows if row.status not in ("ok", "floor")]
    if lost:
        return lost[0]
    return "floor" if case.rows else "-"
