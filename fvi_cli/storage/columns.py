"""Values of many runs as columns, and the runs that have them, in memory."""

from __future__ import annotations

import functools
import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.fields import TIME, axes_of, counts_in

BY_MEMBER: Final = ("identity", "number", "points", "error", "status", "predicted", "floor",
                    "order_smooth", "seconds", "history_operations")  # fmt: skip
"""Columns even where all members have the same value."""
FILL: Final[Mapping[str, Any]] = {"f": 9.969209968386869e36, "i": -9223372036854775806}
"""The netCDF library's own fill values, for members that lack a value that others have."""

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class Column:
    """One value of many runs: float64, int64 or bytes, the latter text or JSON."""

    data: NDArray[Any]
    is_json: bool = False  # so that runs may lack the value
    has_fill: bool = False  # the same for numbers

    def values(self) -> list[Any]:
        """The values as Python objects."""
        found = self.data.tolist()
        if self.data.dtype.kind == "S":
            texts = [one.decode() for one in found]
            return [json.loads(one) if one else None for one in texts] if self.is_json else texts
        if not self.has_fill:
            return list(found)
        fill = FILL[self.data.dtype.kind]
        return [None if one == fill else one for one in found]


def column_of(values: Sequence[Any]) -> Column:
    """The column of some values; mixed kinds are JSON."""
    kinds = set(map(type, values))
    has_fill = type(None) in kinds
    kinds.discard(type(None))
    if kinds in ({int}, {float}):
        kind = "i" if kinds == {int} else "f"
        held = [FILL[kind] if one is None else one for one in values] if has_fill else values
        return Column(np.array(held, dtype=f"<{kind}8"), has_fill=has_fill)
    is_text = kinds == {str} and not has_fill
    texts = values if is_text else ["" if one is None else json.dumps(one) for one in values]
    return Column(np.array([one.encode() for one in texts], dtype="S"), is_json=not is_text)


def joined(columns: Sequence[Column]) -> Column:
    """Columns one after another."""
    if len({(one.data.dtype.kind, one.is_json) for one in columns}) > 1:
        return column_of([value for one in columns for value in one.values()])
    has_fill = any(one.has_fill for one in columns)
    return Column(np.concatenate([one.data for one in columns]), columns[0].is_json, has_fill)


def are_equal(values: Sequence[Any]) -> bool:
    """Whether values are of one type and equal; nan is nan."""
    first = values[0]
    return all(
        type(one) is type(first) and (one == first or (one != one and first != first))
        for one in values
    )


@dataclass
class Rows(ABC):
    """Runs of one group: a single run, or members of a sweep."""

    common: dict[str, Any] = field(default_factory=dict)  # values that all of them share
    columns: dict[str, Column] = field(default_factory=dict)  # values in which they differ
    keys: tuple[str, ...] = ()  # swept keys; empty: a single run
    count: int = 1
    # shape of every array of a run, the longest
    shapes: dict[str, tuple[int, ...]] = field(default_factory=dict)

    @functools.cached_property
    def identities(self) -> list[str]:
        """The identity of every run."""
        return self.column("identity")

    def column(self, name: str) -> list[Any]:
        """One value of every run; None where it is missing."""
        if name in self.columns:
            return self.columns[name].values()
        return [self.common.get(name)] * self.count

    def piece(self, name: str, first: int, last: int) -> Column:
        """The column of some runs."""
        held = self.columns.get(name)
        if held is None:
            return column_of([self.common.get(name)] * (last - first))
        return Column(held.data[first:last], held.is_json, held.has_fill)

    def values(self) -> Iterator[dict[str, Any]]:
        """The values of every run."""
        columns = [self.columns[name].values() for name in self.columns]
        for row in range(self.count):
            own = (column[row] for column in columns)
            yield {**self.common, **dict(zip(self.columns, own, strict=True))}

    @abstractmethod
    def arrays(self, first: int, last: int) -> dict[str, NDArray[Any]]:
        """Arrays of some runs, with a first axis for the runs unless :func:`is_shared`."""

    def is_shared(self, name: str) -> bool:
        """Whether an array has no axis for the runs: all have it in common, or there is one run."""
        return not self.keys or axes_of(name) == (name,)

    def copy_to(self, file: h5py.File, path: str) -> bool:
        """Copy all runs as they are; False where that is not possible."""
        return False


class NewRows(Rows):
    """Runs that were just computed, each with its values and arrays."""

    def __init__(
        self, values: Sequence[Mapping[str, Any]], arrays: Sequence[Arrays], keys: tuple[str, ...]
    ) -> None:
        super().__init__(keys=keys, count=len(arrays))
        self._arrays = arrays
        for name in dict.fromkeys(name for own in values for name in own):
            column = [own.get(name) for own in values]
            if keys and (name in BY_MEMBER or name in keys or not are_equal(column)):
                self.columns[name] = column_of(column)
            else:
                self.common[name] = column[0]
        for own in arrays:
            for name, one in own.items():
                before = self.shapes.get(name, (0,) * one.ndim)
                self.shapes[name] = tuple(map(max, before, one.shape))

    def arrays(self, first: int, last: int) -> dict[str, NDArray[Any]]:
        """As :meth:`Rows.arrays`."""
        chosen = self._arrays[first:last]
        if not self.keys:
            return dict(chosen[0])
        found = {}
        for name, shape in self.shapes.items():
            if self.is_shared(name):
                found[name] = max((own[name] for own in chosen), key=len)
                continue
            found[name] = np.full((len(chosen), *shape), np.nan)
            for row, own in enumerate(chosen):
                if name in own:
                    found[name][row, : len(own[name])] = own[name]
        return found


def arrays_of_row(
    rows: Rows, block: Arrays, row: int, values: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """The arrays of one run of a block, without the fill at their ends."""
    if not rows.keys:
        return dict(block)
    lengths = {f"events/{name}/occurrence": count for name, count in counts_in(values).items()}
    lengths[TIME] = values["points"]
    found = {}
    for name, held in block.items():
        axis = axes_of(name)[0]
        if axis in lengths:
            own = held if rows.is_shared(name) else held[row]
            found[name] = own[: lengths[axis]]
    return found
