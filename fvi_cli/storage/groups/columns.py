"""Attributes of many runs, by name, in as little memory as it allows."""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Mapping, MutableSequence, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.storage.records.record import same_value

ABSENT: Final = object()
"""Stands where a run has no such attribute."""

_CODES: Final[Mapping[type, str]] = {float: "d", int: "q"}

Column = MutableSequence[Any]
"""A list, or an array of numbers, which take 8 bytes each; in a list they would take 32."""

Columns = dict[str, Column]
"""Attributes of runs by name."""


class Survey:
    """Attributes of many runs: values that all share are written once, others by run."""

    def __init__(self) -> None:
        self.names: dict[str, None] = {}  # as they come
        self.common: dict[str, Any] = {}
        self.columns: Columns = {}
        self._count = 0

    def __len__(self) -> int:
        """Number of runs."""
        return self._count

    def add(self, attributes: Mapping[str, Any]) -> None:
        """One run more."""
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
        """What each of the runs says."""
        return self.columns.get(name) or [self.common.get(name, ABSENT)] * self._count


def _repeated(value: Any, count: int) -> Column:
    code = _CODES.get(type(value))
    return array(code, itertools.repeat(value, count)) if code else [value] * count


def appended(column: Column, value: Any) -> Column:
    """The column with one value more, as a list where it is none of these numbers."""
    if isinstance(column, array) and _CODES.get(type(value)) != column.typecode:
        column = list(column)
    column.append(value)
    return column


def column_to_write(column: Sequence[Any]) -> tuple[Any, bool]:
    """An array of numbers, or texts; and whether the texts are JSON."""
    kinds: set[type] = {type(column[0])} if isinstance(column, array) else set(map(type, column))
    if kinds in ({int}, {float}):
        return np.array(column, dtype="<i8" if kinds == {int} else "<f8"), False
    if kinds == {str}:
        return column, False
    return ["" if v is ABSENT else json.dumps(v) for v in column], True


def read_column(values: Any, *, is_json: bool) -> Column:
    """A column as it was written: an array of numbers, or texts."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "if":
        return array("q" if values.dtype.kind == "i" else "d", values.tobytes())
    known: dict[str, str] = {}
    texts = [known.setdefault(text, text) for text in values]
    return [json.loads(text) if text else ABSENT for text in texts] if is_json else texts


def attributes_in_row(columns: Mapping[str, Column], row: int) -> dict[str, Any]:
    """What one run says."""
    found = {name: column[row] for name, column in columns.items()}
    return {name: value for name, value in found.items() if value is not ABSENT}
