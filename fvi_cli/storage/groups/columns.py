"""Attributes of many runs, by name, in little memory."""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Mapping, MutableSequence, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.storage.records.record import same_value

ABSENT: Final = object()
"""Entry of a column for a run that does not have the attribute."""

_CODES: Final[Mapping[type, str]] = {float: "d", int: "q"}

Column = MutableSequence[Any]
"""A list, or for numbers an array: 8 bytes for each number instead of 32 in a list."""

Columns = dict[str, Column]
"""Columns by the name of the attribute."""


class Survey:
    """Attributes of many runs: values that all share are written once, others by run."""

    def __init__(self) -> None:
        self.names: dict[str, None] = {}  # in the order of their first occurrence
        self.common: dict[str, Any] = {}
        self.columns: Columns = {}
        self._count = 0

    def __len__(self) -> int:
        """Number of runs."""
        return self._count

    def add(self, attributes: Mapping[str, Any]) -> None:
        """Add the attributes of one run."""
        if not self._count:
            self.common |= attributes
        self.names |= dict.fromkeys(attributes)
        for name in self.names:
            value = attributes.get(name, ABSENT)
            if name not in self.columns:
                before = self.common.get(name, ABSENT)
                if value is before or same_value(value, before):
                    continue
                self.common.pop(name, None)
                self.columns[name] = _repeated(before, self._count)
            self.columns[name] = appended(self.columns[name], value)
        self._count += 1

    def column(self, name: str) -> Sequence[Any]:
        """The value of an attribute for each run."""
        return self.columns.get(name) or [self.common.get(name, ABSENT)] * self._count


def _repeated(value: Any, count: int) -> Column:
    code = _CODES.get(type(value))
    return array(code, itertools.repeat(value, count)) if code else [value] * count


def appended(column: Column, value: Any) -> Column:
    """The column with a value appended; it becomes a list where types differ."""
    if isinstance(column, array) and _CODES.get(type(value)) != column.typecode:
        column = list(column)
    column.append(value)
    return column


def column_to_write(column: Sequence[Any]) -> tuple[Any, bool]:
    """A column as an array of numbers or as texts; and whether the texts are JSON."""
    kinds: set[type] = {type(column[0])} if isinstance(column, array) else set(map(type, column))
    if kinds in ({int}, {float}):
        return np.array(column, dtype="<i8" if kinds == {int} else "<f8"), False
    if kinds == {str}:
        return column, False
    return ["" if v is ABSENT else json.dumps(v) for v in column], True


def read_column(values: Any, *, is_json: bool) -> Column:
    """The column from an array of numbers or from texts."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "if":
        return array("q" if values.dtype.kind == "i" else "d", values.tobytes())
    known: dict[str, str] = {}
    texts = [known.setdefault(text, text) for text in values]
    return [json.loads(text) if text else ABSENT for text in texts] if is_json else texts


def attributes_in_row(columns: Mapping[str, Column], row: int) -> dict[str, Any]:
    """The attributes of one run."""
    found = {name: column[row] for name, column in columns.items()}
    return {name: value for name, value in found.items() if value is not ABSENT}
