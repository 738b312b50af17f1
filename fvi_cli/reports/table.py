"""What a table is, whatever stands in it: columns, sheets, and the report that holds them."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass

from fvi_cli.reports.document import Block, Grid

Value = str | int | float | bool | None
"""An entry; None where there is none."""

Row = Mapping[str, Value]
"""Entries by the names of their columns."""


@dataclass(frozen=True, kw_only=True)
class Within:
    """How far two numbers a, b may be apart: |a - b| <= max(relative max(|a|, |b|), absolute).

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
"""For numbers that do not depend on round-off: step sizes, expected orders."""


@dataclass(frozen=True)
class Column:
    """One column of a sheet.

    Parameters
    ----------
    name
        In the CSV and JSON forms.
    meaning
        What stands in it, with its unit.
    title, form
        Its heading where people read, and the format of its numbers (as in :func:`format`); no
        title: it is not shown.
    compared
        How far a stored number may be from a fresh one; texts, whole numbers, yes and no must be
        the same. None: not compared.
    missing
        What stands for None in the CSV form.
    is_extra
        Whether it stands in the JSON form only.
    """

    name: str
    meaning: str
    title: str = ""
    form: str = ""
    compared: Within | None = SAME_NUMBER
    missing: str = ""
    is_extra: bool = False


def row_of(columns: Iterable[Column], /, *sources: object, **given: Value) -> Row:
    """The entries of a row: those that are given, the others by their names.

    Parameters
    ----------
    columns
        Every one gets an entry.
    sources
        The first that has an attribute of the name of a column says what stands there.
    given
        What has another name, or is to be worked out.
    """
    return {
        one.name: given[one.name]
        if one.name in given
        else getattr(next(source for source in sources if hasattr(source, one.name)), one.name)
        for one in columns
    }


def _nothing(stored: Row, fresh: Row) -> Container[str]:
    return ()


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """Rows under columns.

    Parameters
    ----------
    name
        What its rows are: ``runs``, ``summary``.
    columns
        From left to right.
    rows
        Each with an entry for every column.
    keys
        The columns that tell a row from all others.
    left_to_round_off
        The columns in which this stored and this fresh row may differ at will.
    is_file
        Whether it has a CSV file; others stand in the JSON form only.
    """

    name: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    keys: tuple[str, ...]
    left_to_round_off: Callable[[Row, Row], Container[str]] = _nothing
    is_file: bool = True

    def grid(self, *, text_columns: int = 1, key_columns: int = 1) -> Grid:
        """The columns with a title, for people."""
        shown = [column for column in self.columns if column.title]
        return Grid(
            header=tuple(column.title for column in shown),
            rows=tuple(tuple(_shown(row[c.name], c) for c in shown) for row in self.rows),
            text_columns=text_columns,
            key_columns=key_columns,
        )


def _shown(value: Value, column: Column) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return column.missing or "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, column.form)


@dataclass(frozen=True, kw_only=True)
class Report:
    """Everything that is told of results of one kind: sheets of numbers, and words.

    Parameters
    ----------
    name
        Files begin with it.
    sheets
        The first is ``<name>.csv``, another one ``<name>-<sheet>.csv``.
    summary
        What a terminal shows.
    blocks
        The whole, for Markdown and LaTeX.
    with_rows
        The report on the same results with other rows in the first sheet: what was measured is
        taken from them, what follows from it is computed anew. None: the words cannot be compared
        with stored ones but for their numbers.
    is_timed
        Whether its numbers are times of this machine, which are never the same twice.
    is_part
        Whether stored tables may have more rows, and so other words.
    """

    name: str
    sheets: tuple[Sheet, ...]
    summary: tuple[Block, ...]
    blocks: tuple[Block, ...]
    with_rows: Callable[[Sequence[Row]], Report] | None = None
    is_timed: bool = False
    is_part: bool = False
