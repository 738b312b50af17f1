"""Tables: columns, the rows of a CSV file, the grids that people read, and the report of both."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from fvi_cli.reports.naming import with_unit

Value = str | int | float | bool | None
"""An entry; None where there is none."""


@dataclass(frozen=True, kw_only=True)
class Within:
    """Tolerance for two numbers a, b: |a - b| <= max(relative max(|a|, |b|), absolute).

    nan agrees with nan, and an infinity with itself.
    """

    relative: float = 0.0
    absolute: float = 0.0

    def holds(self, one: float, other: float) -> bool:
        """Whether the two agree."""
        if math.isnan(one) or math.isnan(other):
            return math.isnan(one) and math.isnan(other)
        return math.isclose(one, other, rel_tol=self.relative, abs_tol=self.absolute)


MOST_LINES = 100
"""Longer grids are in files only."""
SAME_NUMBER = Within(relative=1e-9)
"""Tolerance for numbers that do not depend on round-off: step sizes, expected orders."""


@dataclass(frozen=True)
class Column:
    """A column: how its value is got from the item of a row, written, and compared."""

    name: str  # in CSV and JSON; empty: only people see it
    title: str = ""  # heading for people; empty: they do not see it
    form: str | Callable[[Any], str] = ""  # format specification of a number, or a function
    within: Within | None = SAME_NUMBER  # tolerance of ``--check``; None: not compared
    unit: str = ""  # quality whose unit stands behind the title: ``length``, ``frequency``
    get: str | Callable[[Any], Any] = ""  # function, or path of attributes; default: the name

    def of(self, item: object) -> Any:
        """Its value in the row of an item."""
        return self.get(item) if callable(self.get) else attrgetter(self.get or self.name)(item)

    def show(self, item: object) -> str:
        """The value as people read it."""
        value = self.of(item)
        if callable(self.form):
            return self.form(value)
        if value is None or value == "" or (isinstance(value, float) and math.isnan(value)):
            return "-"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return format(value, self.form)


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A table of numbers: a row for every item."""

    name: str  # in JSON: ``runs``, ``events``
    columns: tuple[Column, ...]
    items: Sequence[Any]
    is_file: bool = True  # whether it has a CSV file
    # from an item and the words of its stored row to columns that are round-off there
    is_round_off: Callable[[Any, Mapping[str, str]], Container[str]] = lambda item, stored: ()

    @functools.cached_property
    def rows(self) -> tuple[Mapping[str, Value], ...]:
        """Entries by the names of their columns."""
        return tuple({one.name: one.of(item) for one in self.written} for item in self.items)

    @property
    def written(self) -> list[Column]:
        """The columns of CSV and JSON."""
        return [column for column in self.columns if column.name]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of words."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]  # each as long as the header
    foot: tuple[tuple[str, ...], ...] = ()  # rows below a line

    @functools.cached_property
    def has_numbers(self) -> list[bool]:
        """Of every column whether it holds numbers, which are aligned at the right."""
        columns = zip(*(*self.rows, *self.foot), strict=True)
        starts = [{one.lstrip("+-(<> ")[:1] for one in column} - {""} for column in columns]
        return [any(one.isdigit() for one in found) for found in starts]


Block = str | Grid
"""A paragraph, a heading with ``#`` before it, a list with ``-`` before every line, or a table."""


def listed(lines: Iterable[str]) -> list[Block]:
    """A list of lines; no block without lines."""
    found = [f"- {' '.join(line.split())}" for line in lines]
    return ["\n".join(found)] if found else []


def grid_of(
    columns: Sequence[Column], items: Sequence[object], units: Mapping[str, str] | None = None
) -> Grid:
    """A grid of the columns with a title that have a value: a line for every item."""
    titled = [one for one in columns if one.title]
    texts = [[one.show(item) for item in items] for one in titled]
    shown = [k for k, column in enumerate(texts) if set(column) - {"-", ""}]
    return Grid(
        header=tuple(with_unit(titled[k].title, units or {}, titled[k].unit) for k in shown),
        rows=tuple(zip(*(texts[k] for k in shown), strict=True)),
    )


def pivot(
    cells: Iterable[tuple[tuple[str, ...], str, Sequence[str]]],
    *,
    corner: Sequence[str],
    headings: Mapping[str, Sequence[str]],
    foot: Iterable[tuple[tuple[str, ...], Mapping[str, Sequence[str]]]] = (),
) -> Grid:
    """A grid of cells (first words of their line, their column, texts); `headings` by column."""
    lines: dict[tuple[str, ...], dict[str, Sequence[str]]] = {}
    for begin, column, texts in cells:
        lines.setdefault(begin, {})[column] = texts

    def line(begin: tuple[str, ...], found: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
        own = (found.get(c, ("-", ""))[: len(titles)] for c, titles in headings.items())
        return (*begin, *(text for texts in own for text in texts))

    return Grid(
        header=(*corner, *(title for titles in headings.values() for title in titles)),
        rows=tuple(line(*one) for one in lines.items()),
        foot=tuple(line(*one) for one in foot),
    )


@dataclass(frozen=True, kw_only=True)
class Report:
    """The report on results of one kind: sheets of numbers, and what people read."""

    name: str  # files begin with it
    # the first is ``<name>.csv``, another one that is a file ``<name>-<sheet>.csv``
    sheets: tuple[Sheet, ...]
    blocks: Sequence[Block]
    has_latex: bool = False  # whether its grids are written as LaTeX, too
    summary: Sequence[Block] = ()  # in place of the blocks on a terminal, where it is shorter

    def shown(self, *, verbose: bool = False) -> list[Block]:
        """The summary, or with `verbose` the blocks, for a terminal: without long grids."""
        return [
            f"{len(one.rows)} rows: see the files."
            if isinstance(one, Grid) and len(one.rows) > MOST_LINES
            else one
            for one in (self.blocks if verbose or not self.summary else self.summary)
        ]
