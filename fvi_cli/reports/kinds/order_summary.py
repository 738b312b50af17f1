"""The paper's layout: one row for a problem, one column for a method, an order in every cell."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fvi_cli.integrator.method_names import MethodName, describe_method, method_names
from fvi_cli.reports.document import Block, Bullets, CodeSpan, Grid, Paragraph, Words
from fvi_cli.reports.kinds.order_sweeps import split_sweeps, sweep_summary
from fvi_cli.reports.naming import listing, number
from fvi_cli.reports.table import pivot
from fvi_cli.studies.order import OrderCase, OrderTable

NOTED_DIFFERENCE = 0.06
"""A sentence points out slopes that differ by more from the stated order."""

ASYMPTOTIC_DIFFERENCE = 0.1
"""A slope that differs by more from the finest pairwise or the expected order is no order."""

UNLIKE_EXPECTED = 0.3
"""A sentence points out finest orders that differ by more from the expected one (guessed)."""

FAILURES = ("diverged", "failed", "refused")

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


def names_in_tables(tables: Sequence[OrderTable]) -> dict[str, MethodName]:
    """Names of all methods in `tables`, by case."""
    return method_names([case.method for table in tables for case in table.cases])


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
    """Orders of all experiments in one table, and remarks on them."""
    names = names_in_tables(tables)
    single, swept = split_sweeps(tables)
    titles = short_titles(name, single)
    groups = _groups(single)
    if not groups and not swept:
        yield Paragraph(words="No run is finished.")
        return
    yield Paragraph(words=_explanation(tables))
    yield from (_grid(group, names, titles) for group in groups)
    for members in swept:
        yield from sweep_summary(members, names, order_entry)
    remarks = [
        sentence
        for say in (_stated, _failures)
        for table in single
        for sentence in say(table, names, titles)
    ]
    if remarks:
        yield Bullets(items=tuple(remarks))


def legend(tables: Sequence[OrderTable]) -> Iterator[Block]:
    """A list of the methods with their cases in other files; common properties are given once."""
    names = names_in_tables(tables)
    methods = {case.method.case: case.method for table in tables for case in table.cases}
    described = {case: describe_method(method) for case, method in methods.items()}
    if not described:
        return
    first, *others = described.values()
    shared = [one for one in first if others and all(one in phrases for phrases in others)]
    items: list[Words] = []
    for case, phrases in described.items():
        own = ", ".join(phrase for phrase in phrases if phrase not in shared)
        items.append((f"{names[case].label}: {own}{', ' if own else ''}case ", CodeSpan(case)))
    yield Paragraph(words=f"Methods, all with {', '.join(shared)}:" if shared else "Methods:")
    yield Bullets(items=tuple(items))


def _explanation(tables: Sequence[OrderTable]) -> str:
    cases = [case for table in tables for case in table.cases]
    if all(len(case.rows) == 1 for case in cases):
        text = "Entries: the error on the only step size."
    else:
        text = (
            "Entries: the least-squares slope of log(error) against log(h) over all rows that can "
            "be used, then the order between the two finest of them. Where the two disagree, the "
            "slope is not asymptotic."
        )
    if any(sum(row.used_in_fit for row in case.rows) == 2 for case in cases):
        text += " One number alone comes from two rows."
    if any(order_entry(case) == "floor" for case in cases):
        text += (
            " floor: round-off leaves no order; above it there is one error, or there are few over "
            "less than a factor of two in N that lie on no line."
        )
    if any(order_entry(case).startswith("none") for case in cases):
        text += " none: errors do not fall as steps become smaller."
    norms = {table.norm for table in tables}
    if len(norms) == 1:
        text += f" Errors are measured in the {NORMS[norms.pop()]}."
    if any(not math.isnan(case.claim) for case in cases):
        text += " stated: the order that the source of the experiment states."
    if any(row.status in FAILURES for case in cases for row in case.rows):
        text += " A star marks methods that failed on some step sizes."
    return text


def _groups(tables: Sequence[OrderTable]) -> list[list[OrderTable]]:
    """Groups of experiments with the same methods, in the order of the configuration."""
    groups: dict[tuple[str, ...], list[OrderTable]] = {}
    for table in tables:
        cases = tuple(case.method.case for case in table.cases)
        if cases:
            groups.setdefault(cases, []).append(table)
    return list(groups.values())


def _grid(
    group: Sequence[OrderTable], names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> Grid:
    """Rows: problems and members of method families; columns: families of methods.

    If methods do not fill a rectangle, rows are methods and columns problems.
    """
    own = [names[case.method.case] for case in group[0].cases]
    families, variants = (
        list(dict.fromkeys(getattr(name, part) for name in own)) for part in ("family", "variant")
    )
    is_full = len(own) == len(families) * len(variants)
    each = [(t, case, names[case.method.case]) for t in group for case in t.cases]
    if is_full:
        each.sort(key=lambda one: (group.index(one[0]), variants.index(one[2].variant)))

    def column(table: OrderTable, name: MethodName) -> str:
        return name.family if is_full else titles[table.experiment]

    def begin(table: OrderTable, name: MethodName) -> tuple[str, ...]:
        if not is_full:
            return (name.label,)
        variant = [name.variant] if any(variants) else []
        return (titles[table.experiment], *variant, orders_in_words(table) or "-", _ladder(table))

    claimed = {column(t, name) for t, case, name in each if not math.isnan(case.claim)}
    full = ("problem", *(["method"] if any(variants) else []), "gamma", "N")
    return pivot(
        (
            (
                begin(t, name),
                at := column(t, name),
                (order_entry(case), *([number(case.claim, "g")] if at in claimed else [])),
            )
            for t, case, name in each
        ),
        corner=full if is_full else ("method",),
        headings={
            at: (at, "stated") if at in claimed else (at,)
            for at in (families if is_full else [titles[t.experiment] for t in group])
        },
    )


def orders_in_words(table: OrderTable) -> str:
    """The distinct orders of the damping."""
    return ", ".join(dict.fromkeys(filter(None, table.gamma.split(";"))))


def _ladder(table: OrderTable) -> str:
    steps = sorted({row.n_steps for case in table.cases for row in case.rows})
    return str(steps[0]) if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"


def order_entry(case: OrderCase) -> str:
    """Slope and finest order; a star where rows failed."""
    failures = [row.status for row in case.rows if row.status in FAILURES]
    star = "*" if failures else ""
    used = [row for row in case.rows if row.used_in_fit]
    if case.has_order and (case.slope <= 0.0 or case.last_order <= 0.0):
        return f"none{star}"
    if case.has_order and len(used) > 2 and not math.isnan(case.last_order):
        return f"{case.slope:.2f}, {case.last_order:.2f}{star}"
    if case.has_order:
        return f"{case.slope:.2f}{star}"
    if failures:
        return f"{failures[0]}*"
    if len(case.rows) == 1 and used:
        return f"error {used[0].error:.1e}"
    return "floor" if any(row.is_near_floor for row in case.rows) else "-"


def _failures(
    table: OrderTable, names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> list[Words]:
    """One sentence on the rows of an experiment that failed."""
    parts = []
    for case in table.cases:
        for status in FAILURES:
            count = sum(row.status == status for row in case.rows)
            if count:
                label = names[case.method.case].label
                parts.append(f"{label} {status} in {count} of {len(case.rows)} rows")
    return [f"* {titles[table.experiment]}: {'; '.join(parts)}."] if parts else []


def _stated(
    table: OrderTable, names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> list[Words]:
    """Sentences on every stated order that is not reached, or whose slope is no order."""
    sentences: list[Words] = []
    for case in table.cases:
        if math.isnan(case.claim):
            continue
        parts = []
        if not case.has_order:
            parts.append(f"stated {case.claim:g}; too few rows can be used for a slope")
        else:
            if abs(case.slope - case.claim) > NOTED_DIFFERENCE:
                parts.append(f"stated {case.claim:g}, measured {case.slope:.2f}")
            if not_asymptotic := _not_asymptotic(case):
                parts.append(not_asymptotic)
        if parts:
            title = f"{titles[table.experiment]}, {names[case.method.case].label}"
            sentences.append(f"{title}: {'; '.join(parts)}.")
    return sentences


def _not_asymptotic(case: OrderCase) -> str:
    """Why the slope is not the order for small steps; empty if it may be."""
    last, expected = case.last_order, case.expected_order
    is_far = abs(case.slope - last) > ASYMPTOTIC_DIFFERENCE
    misses = abs(case.slope - expected) > ASYMPTOTIC_DIFFERENCE
    if not (is_far or misses):
        return ""
    text = f"the slope {case.slope:.2f} is pre-asymptotic: {_finest_order(case)}"
    if not math.isnan(expected):
        text += f", {expected:g} is expected for small steps"
    return text


def unlike_expected(case: OrderCase) -> str:
    """A clause if the finest order is far above or below the expected one; else empty.

    The expected order is that of the slowest part of the error; on longer steps other parts may
    still be larger.
    """
    last, expected = case.last_order, case.expected_order
    is_unstable = last <= 0 or any(row.predicted == "unstable" for row in case.rows)
    if is_unstable or not (case.has_order and abs(last - expected) > UNLIKE_EXPECTED):
        return ""
    return f"{_finest_order(case)}, not yet the {expected:.3g} that is expected for small steps"


def _finest_order(case: OrderCase) -> str:
    if case.last_pair is None:
        return "no two neighbouring rows give an order"
    coarse, fine = (case.rows[case.last_pair + k].n_steps for k in (-1, 0))
    return f"the order between N = {coarse} and {fine} is {case.last_order:.2f}"


def steps_phrase(ladder: Sequence[int], steps: Sequence[int]) -> str:
    """Words for rows of a ladder: ``every N``, or the N."""
    return "every N" if list(ladder) == list(steps) else f"N = {listing(steps)}"
