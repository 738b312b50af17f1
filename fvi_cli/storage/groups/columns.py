"""Attributes of many runs, by name, in as little memory as it allows."""

from __future__ import annotations

import itertools
import json
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from fvi_cli.storage.records.record import same_value

ABSENT: Final = object()
"""Stands where a run has no such attribute."""

_CODES: Final[Mapping[type, str]] = {float: "d", int: "q"}


class AttributeColumn(Sequence[Any]):
    """One attribute of many runs: said once as long as all have the same.

    Numbers take 8 bytes each, in a list they would take 32.
    """

    def __init__(self, values: Sequence[Any] = ()) -> None:
        self._count = 0
        self._value: Any = ABSENT
        self._values: Any = None
        if isinstance(values, array | list):
            self._values, self._count = values, len(values)
        else:
            for value in values:
                self.append(value)

    @classmethod
    def repeated(cls, value: Any, count: int) -> AttributeColumn:
        """The column of what all have in common."""
        found = cls()
        found._value, found._count = value, count
        return found

    @property
    def is_common(self) -> bool:
        """Whether all have the same."""
        return self._values is None

    def append(self, value: Any) -> None:
        """One run more."""
        if self._values is None:
            if not self._count or value is self._value or same_value(value, self._value):
                self._value, self._count = value, self._count + 1
                return
            before = itertools.repeat(self._value, self._count)
            code = _CODES.get(type(value)) if type(value) is type(self._value) else None
            self._values = array(code, before) if code else list(before)
        if isinstance(self._values, array) and _CODES.get(type(value)) != self._values.typecode:
            self._values = list(self._values)
        self._values.append(value)
        self._count += 1

    def extend(self, other: AttributeColumn) -> None:
        """The runs of another column behind these."""
        for value in other:
            self.append(value)

    def __len__(self) -> int:
        """Number of runs."""
        return self._count

    def __getitem__(self, at: Any) -> Any:
        """What one run says, or several do."""
        if self._values is not None:
            return self._values[at]
        if isinstance(at, slice):
            return [self._value] * len(range(self._count)[at])
        range(self._count)[at]
        return self._value

    def __iter__(self) -> Iterator[Any]:
        """What each of the runs says."""
        if self._values is None:
            return itertools.repeat(self._value, self._count)
        return iter(self._values)

    def written(self) -> tuple[Any, bool]:
        """An array of numbers, or texts; and whether the texts are JSON."""
        kinds = set(map(type, self)) if not isinstance(self._values, array) else {type(self[0])}
        if kinds in ({int}, {float}):
            return np.array(self[:], dtype="<i8" if kinds == {int} else "<f8"), False
        if kinds == {str}:
            return list(self), False
        return ["" if v is ABSENT else json.dumps(v) for v in self], True

    @classmethod
    def read(cls, values: Any, *, is_json: bool) -> AttributeColumn:
        """A column as it was written: an array of numbers, or texts."""
        if isinstance(values, np.ndarray) and values.dtype.kind in "if":
            return cls(array("q" if values.dtype.kind == "i" else "d", values.tobytes()))
        known: dict[str, str] = {}
        texts = [known.setdefault(text, text) for text in values]
        if is_json:
            return cls([json.loads(text) if text else ABSENT for text in texts])
        return cls(texts)


Columns = dict[str, AttributeColumn]
"""Attributes of runs by name."""


def add_row(columns: Columns, attributes: Mapping[str, Any], row: int) -> None:
    """What the run number `row` says, counted from 0."""
    for name, value in attributes.items():
        if name not in columns:
            columns[name] = AttributeColumn.repeated(ABSENT, row)
        columns[name].append(value)
    for name, column in columns.items():
        if name not in attributes:
            column.append(ABSENT)


def attributes_in_row(columns: Columns, row: int) -> dict[str, Any]:
    """What one run says."""
    found = {name: column[row] for name, column in columns.items()}
    return {name: value for name, value in found.items() if value is not ABSENT}
