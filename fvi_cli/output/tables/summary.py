"""The paper's layout: one row for a problem, one column for a method, an order in every cell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from fvi_cli.experiments.order import OrderCase, OrderTable
from fvi_cli.output.tables.document import (
    Block,
    Bullets,
    Code,
    Grid,
    Paragraph,
    Words,
)
from fvi_cli.output.tables.naming import (
    MethodName,
    describe_method,
    listing,
    method_names,
    number,
)

NOTED_DIFFERENCE = 0.06
"""A measured slope that is further from the published order than this is pointed out."""

ASYMPTOTIC_DIFFERENCE = 0.1
"""A slope that is further than this from the finest pairwise order is not asymptotic."""

MOST_COLUMNS = 9
"""Columns of numbers that a page or a screen holds."""


def names_of(tables: Sequence[OrderTable]) -> dict[str, MethodName]:
    """Names of all methods in `tables`, by case."""
    return method_names([case.method for table in tables for case in table.cases])


def short_titles(name: str, tables: Sequence[OrderTable]) -> dict[str, str]:
    """Titles of the experiments, without the name of the configuration where all begin with it."""
    titles = [table.experiment for table in tables]
    prefix = f"{name}-"
    if all(title.startswith(prefix) for title in titles):
        return {title: title.removeprefix(prefix) for title in titles}
    return {title: title for title in titles}


def summary(name: str, tables: Sequence[OrderTable]) -> list[Block]:
    """Orders of all experiments side by side, with what a reader should know of them."""
    names = names_of(tables)
    titles = short_titles(name, tables)
    blocks: list[Block] = [Paragraph(words=_explanation(tables))]
    for group in _groups(tables):
        blocks += _grids(group, names, titles)
    remarks = [sentence for table in tables for sentence in _published(table, names, titles)]
    if remarks:
        blocks.append(Bullets(items=tuple(remarks)))
    blocks += _legend(tables, names)
    return blocks


def _explanation(tables: Sequence[OrderTable]) -> str:
    text = (
        "Every entry is the least-squares slope of log(error) against log(h), then the order "
        "between the two finest step sizes of the fit. Where they disagree, the slope is not "
        "asymptotic."
    )
    norms = {table.norm for table in tables}
    if len(norms) == 1:
        text += f" Errors are measured in the {NORMS[norms.pop()]}."
    if any(not math.isnan(case.claim) for table in tables for case in table.cases):
        text += ' "published" is what the source of the experiment prints.'
    return text


NORMS: Mapping[str, str] = {
    "max": "maximum norm over components and grid points",
    "final": "maximum norm over components at the final time",
    "l2": "l2 norm over the grid, weighted by h",
}


def _groups(tables: Sequence[OrderTable]) -> list[list[OrderTable]]:
    """Experiments with the same methods together, in the order of the configuration."""
    groups: dict[tuple[str, ...], list[OrderTable]] = {}
    for table in tables:
        cases = tuple(case.method.case for case in table.cases)
        if cases:
            groups.setdefault(cases, []).append(table)
    return list(groups.values())


def _grids(
    group: Sequence[OrderTable], names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> list[Block]:
    cases = [case.method.case for case in group[0].cases]
    families = list(dict.fromkeys(names[case].family for case in cases))
    variants = list(dict.fromkeys(names[case].variant for case in cases))
    if len(cases) == len(families) * len(variants):
        return _paper_layout(group, names, titles, families, variants)
    return _method_layout(group, names, titles)


def _paper_layout(
    group: Sequence[OrderTable],
    names: Mapping[str, MethodName],
    titles: Mapping[str, str],
    families: Sequence[str],
    variants: Sequence[str],
) -> list[Block]:
    """Rows: problems (and what varies beside the family); columns: families of methods."""
    has_variants = any(variants)
    claimed = {
        names[case.method.case].family
        for table in group
        for case in table.cases
        if not math.isnan(case.claim)
    }
    blocks: list[Block] = []
    per_grid = MOST_COLUMNS // 2 if claimed else MOST_COLUMNS
    for start in range(0, len(families), per_grid):
        chosen = families[start : start + per_grid]
        header = ["problem", *(["method"] if has_variants else []), "gamma", "N"]
        for family in chosen:
            header += [family, "published"] if family in claimed else [family]
        rows = []
        for table in group:
            by_name = {
                (names[case.method.case].family, names[case.method.case].variant): case
                for case in table.cases
            }
            for variant in variants:
                row = [titles[table.experiment], *([variant] if has_variants else [])]
                row += [table.gamma or "-", _ladder(table)]
                for family in chosen:
                    case = by_name[family, variant]
                    row.append(order_entry(case))
                    if family in claimed:
                        row.append(number(case.claim, "g"))
                rows.append(tuple(row))
        blocks.append(Grid(header=tuple(header), rows=tuple(rows), text_columns=3 + has_variants))
    return blocks


def _method_layout(
    group: Sequence[OrderTable], names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> list[Block]:
    """Rows: methods; columns: problems. For methods that do not fill a rectangle."""
    blocks: list[Block] = []
    per_grid = 4
    for start in range(0, len(group), per_grid):
        chosen = group[start : start + per_grid]
        header = ["method"]
        for table in chosen:
            header.append(titles[table.experiment])
            if _has_claims(table):
                header.append("published")
        rows = []
        for k, first in enumerate(group[0].cases):
            row = [names[first.method.case].label]
            for table in chosen:
                row.append(order_entry(table.cases[k]))
                if _has_claims(table):
                    row.append(number(table.cases[k].claim, "g"))
            rows.append(tuple(row))
        blocks.append(Grid(header=tuple(header), rows=tuple(rows)))
    return blocks


def _has_claims(table: OrderTable) -> bool:
    return any(not math.isnan(case.claim) for case in table.cases)


def _ladder(table: OrderTable) -> str:
    steps = sorted({row.n_steps for case in table.cases for row in case.rows})
    return str(steps[0]) if len(steps) == 1 else f"{steps[0]} to {steps[-1]}"


def order_entry(case: OrderCase) -> str:
    """Slope and finest order, and how many rows came to nothing."""
    failed = [row for row in case.rows if row.status not in ("ok", "floor")]
    at_floor = [row for row in case.rows if row.status == "floor"]
    total = len(case.rows)
    if not math.isnan(case.slope):
        entry = f"{case.slope:.2f}, {case.last_order:.2f}"
    elif total == 1 and not failed:
        return f"error {case.rows[0].error:.1e}"
    elif at_floor:
        entry = f"- ({len(at_floor)} of {total} floor)"
    else:
        entry = "-"
    if failed:
        words = "/".join(dict.fromkeys(row.status for row in failed))
        entry += f" ({len(failed)} of {total} {words})"
    return entry


def _published(
    table: OrderTable, names: Mapping[str, MethodName], titles: Mapping[str, str]
) -> list[Words]:
    """Sentences on every published order that is not met or is not an order."""
    sentences: list[Words] = []
    for case in table.cases:
        if math.isnan(case.claim) or math.isnan(case.slope):
            if not math.isnan(case.claim):
                sentences.append(
                    f"{titles[table.experiment]}, {names[case.method.case].label}: published "
                    f"{case.claim:g}; too few rows can be used for a slope."
                )
            continue
        parts = []
        difference = case.slope - case.claim
        if abs(difference) > NOTED_DIFFERENCE:
            parts.append(f"published {case.claim:g}, measured {case.slope:.2f}")
        slope = _not_asymptotic(case)
        if slope:
            parts.append(slope)
        if parts:
            title = f"{titles[table.experiment]}, {names[case.method.case].label}"
            sentences.append(f"{title}: {'; '.join(parts)}.")
    return sentences


def _not_asymptotic(case: OrderCase) -> str:
    """Why the slope is not the order for small steps; empty when it may be."""
    last, expected = case.last_order, case.expected_order
    is_far = abs(case.slope - last) > ASYMPTOTIC_DIFFERENCE
    misses = abs(case.slope - expected) > ASYMPTOTIC_DIFFERENCE
    if not (is_far or misses):
        return ""
    used = [row.n_steps for row in case.rows if row.used_in_fit]
    text = (
        f"the slope {case.slope:.2f} is pre-asymptotic: the order between N = {used[-2]} and "
        f"{used[-1]} is {last:.2f}"
    )
    if not math.isnan(expected):
        text += f", {expected:g} is expected for small steps"
    return text


def _legend(tables: Sequence[OrderTable], names: Mapping[str, MethodName]) -> list[Block]:
    """What every method is, and its name in the other files."""
    methods = {case.method.case: case.method for table in tables for case in table.cases}
    items: list[Words] = [
        (f"{names[case].label}: {describe_method(method)} (", Code(case), ")")
        for case, method in methods.items()
    ]
    if not items:
        return []
    return [Paragraph(words="Methods:"), Bullets(items=tuple(items))]


def steps_phrase(table_steps: Sequence[int], steps: Sequence[int]) -> str:
    """Which rows of a ladder: ``every N`` or the N."""
    return "every N" if list(table_steps) == list(steps) else f"N = {listing(steps)}"
