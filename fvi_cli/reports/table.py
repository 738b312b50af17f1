"""Tables of any contents: columns, sheets, and the report that holds them."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter, itemgetter
from types import SimpleNamespace
from typing import Any

from fvi_cli.reports.document import Block, Grid

Value = str | int | float | bool | None
"""An entry; None where there is none."""

Row = Mapping[str, Value]
"""Entries by the names of their columns."""


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


SAME_NUMBER = Within(relative=1e-9)
"""Tolerance for numbers that do not depend on round-off: step sizes, expected orders."""


@dataclass(frozen=True)
class Column:
    """One column of a sheet, or of a grid for people."""

    name: str  # name in CSV and JSON
    meaning: str = ""  # description of its values, with their unit
    # heading for readers, and format of its numbers (as in :func:`format`, or a function of the
    # value); without a title the column is not shown
    title: str = ""
    form: str | Callable[[Any], str] = ""
    # tolerance of a stored float against a new one; other values must be equal. None: the column
    # is not compared
    compared: Within | None = SAME_NUMBER
    missing: str = ""  # text for None in the CSV form
    is_extra: bool = False  # whether only the JSON form has it
    # how to get its value from the item of a row: a function, or a path of attributes; default: the
    # attribute with the name of the column
    get: str | Callable[[Any], Any] = ""

    def of(self, item: object) -> Any:
        """Its value in the row of an item."""
        return self.get(item) if callable(self.get) else attrgetter(self.get or self.name)(item)

    def show(self, value: Any) -> str:
        """A value as text for readers."""
        if callable(self.form):
            return self.form(value)
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return self.missing or "-"
        if isinstance(value, bool):
            return "yes" if value else "no"
        return format(value, self.form)


def number_of(value: Value) -> float:
    """An entry of a column of numbers; nan where there is none."""
    return value if isinstance(value, float) else math.nan


def within(path: str, *columns: Column) -> tuple[Column, ...]:
    """The columns of an item's part at a path of attributes."""
    return tuple(
        one if callable(one.get) else replace(one, get=f"{path}.{one.get or one.name}")
        for one in columns
    )


class About(SimpleNamespace):
    """The item of a row: attributes for the getters of its columns."""


def rows_of(columns: Iterable[Column], items: Iterable[object]) -> tuple[Row, ...]:
    """A row for every item, with an entry for every column."""
    return tuple({one.name: one.of(item) for one in columns} for item in items)


def grid_of(columns: Sequence[Column], items: Iterable[object], **layout: Any) -> Grid:
    """A grid for readers, with the columns that have a title, and a line for every item."""
    shown = [one for one in columns if one.title]
    return Grid(
        header=tuple(one.title for one in shown),
        rows=tuple(tuple(one.show(one.of(item)) for one in shown) for item in items),
        **layout,
    )


Cell = tuple[tuple[str, ...], str, Sequence[str]]
"""(First words of its line, its column, its texts)."""


def pivot(
    cells: Iterable[Cell],
    *,
    corner: Sequence[str],
    headings: Mapping[str, Sequence[str]],
    absent: str = "-",
    foot: Iterable[tuple[tuple[str, ...], Mapping[str, Sequence[str]]]] = (),
    text_columns: int | None = None,
) -> Grid:
    """A grid of cells: a line for all cells with the same first words; `headings` by column."""
    lines: dict[tuple[str, ...], dict[str, Sequence[str]]] = {}
    for begin, column, texts in cells:
        lines.setdefault(begin, {})[column] = texts

    def line(begin: tuple[str, ...], found: Mapping[str, Sequence[str]]) -> tuple[str, ...]:
        own = (found.get(c, (absent, *[""] * (len(t) - 1))) for c, t in headings.items())
        return (*begin, *(text for texts in own for text in texts))

    return Grid(
        header=(*corner, *(title for titles in headings.values() for title in titles)),
        rows=tuple(line(*one) for one in lines.items()),
        foot=tuple(line(*one) for one in foot),
        text_columns=len(corner) if text_columns is None else text_columns,
    )


def _no_value(stored: Row, fresh: Row) -> Container[str]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """A table: columns and rows."""

    name: str  # name for its rows: ``runs``, ``summary``
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]  # each with an entry for every column
    keys: tuple[str, ...]  # the columns that identify a row
    # from a stored and a new row to columns that are round-off there, and are not compared
    below_floor: Callable[[Row, Row], Container[str]] = _no_value
    is_file: bool = True  # whether it has a CSV file

    @property
    def written(self) -> list[Column]:
        """The columns that the CSV form has."""
        return [column for column in self.columns if not column.is_extra]

    @classmethod
    def of(
        cls,
        name: str,
        columns: tuple[Column, ...],
        items: Iterable[object],
        keys: Sequence[str],
        **more: Any,
    ) -> Sheet:
        """A sheet with a row for every item."""
        rows = rows_of(columns, items)
        return cls(name=name, columns=columns, rows=rows, keys=tuple(keys), **more)

    def grid(self, *, text_columns: int = 1) -> Grid:
        """The grid of the columns with a title that have a value, for readers."""
        shown = [replace(c, get=itemgetter(c.name)) for c in self.columns if c.title]
        filled = [
            c for c in shown if not self.rows or any(not _is_empty(r[c.name]) for r in self.rows)
        ]
        left_out = sum(c not in filled for c in shown[:text_columns])
        return grid_of(filled, self.rows, text_columns=text_columns - left_out)


def _is_empty(value: Value) -> bool:
    return value is None or value == "" or (isinstance(value, float) and math.isnan(value))


@dataclass(frozen=True, kw_only=True)
class Report:
    """The report on results of one kind: sheets of numbers, and words on them."""

    name: str  # files begin with it
    # the first is ``<name>.csv``, another one that is a file ``<name>-<sheet>.csv``
    sheets: tuple[Sheet, ...]
    blocks: Sequence[Block]  # for Markdown and LaTeX
    shown: Sequence[Block] = ()  # for a terminal; empty: all blocks
    has_latex: bool = False  # whether it is written as LaTeX, too

    @property
    def summary(self) -> Sequence[Block]:
        """The blocks for a terminal."""
        return self.shown or self.blocks
