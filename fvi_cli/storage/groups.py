"""A run, or the members of a sweep in common arrays, as a group that netCDF readers understand.

The values of a single run are attributes. Values of members are datasets along ``member``, which is
also the first axis of their arrays; nan fills the ends of shorter motions, ``points`` has their
lengths.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.fields import COUNTS, OCCURRENCE, TIME, axes_of, field_named
from fvi_cli.storage.hdf5 import (
    FILL,
    as_text,
    attach_scales,
    children,
    datasets,
    make_group,
    put,
    read_attributes,
    write_attributes,
)

IDENTITY: Final = "identity"
MEMBER: Final = "member"
SWEPT: Final = "swept"
OF_GROUP: Final = ("method", "case", "n_steps", "step_size", "coordinates", "store_every")
"""Values that all members of a group share; they are its attributes."""
NUMBER, DESIGN = "number", "design"
"""Place in the sweep, and name, of a member."""
POINTS: Final = "points"
"""How many times a member has."""
BLOCK_BYTES: Final = 2**23
"""Members are read in blocks of so many bytes."""


@dataclass(frozen=True)
class Record:
    """A stored run, or a stored reference."""

    path: str  # of its group
    values: Mapping[str, Any]  # by the names of the table of fields, and identity, swept keys, ...
    arrays: Mapping[str, NDArray[Any]]
    # swept keys of members, which share a group; empty: a single run
    keys: tuple[str, ...] = ()

    @property
    def identity(self) -> str:
        """The key of the run or of the reference."""
        return str(self.values[IDENTITY])


def run_groups(file: h5py.File | h5py.Group) -> Iterator[h5py.Group]:
    """All groups of runs and references."""
    for _, node in children(file):
        if isinstance(node, h5py.Group):
            if IDENTITY in node or IDENTITY in node.attrs:
                yield node
            else:
                yield from run_groups(node)


def identities_in(group: h5py.Group) -> list[str]:
    """The identities of the runs of a group, row by row."""
    if IDENTITY in group:
        return [one.decode() for one in group[IDENTITY][()].tolist()]
    return [str(read_attributes(group, IDENTITY)[IDENTITY])]


def keys_in(group: h5py.Group) -> tuple[str, ...]:
    """The swept keys of a group of members; empty: it has a single run."""
    return tuple(json.loads(group.attrs.get(SWEPT, "[]")))


# --- writing --------------------------------------------------------------------------------------


@dataclass
class GroupWriter:
    """Writes runs to a file; runs that it has already are written over."""

    file: h5py.File
    # rows of the members in every group, by their identities
    _rows: dict[str, dict[str, int]] = field(default_factory=dict)

    def write(self, records: Sequence[Record]) -> None:
        """Write some runs."""
        groups: dict[str, list[Record]] = defaultdict(list)
        for one in records:
            groups[one.path].append(one)
        for path, own in groups.items():
            if own[0].keys:
                self._write_members(path, own)
            else:
                self._write_single(path, own[-1])

    def attach_scales(self) -> None:
        """Complete the groups that were written: fill of members, and dimension scales."""
        for path, rows in self._rows.items():
            group, axes = self.file[path], {}
            keys = keys_in(group)
            for name, node in _own_datasets(group, keys).items():
                axes[name] = axes_of(name)
                if keys and not _is_shared(name):
                    axes[name] = (MEMBER, *axes[name])
                    node.resize(len(rows), axis=0)
            attach_scales(group, axes, grows=bool(keys))

    def _write_single(self, path: str, record: Record) -> None:
        if path in self.file:
            del self.file[path]
        group = make_group(self.file, path)
        self._rows[path] = {}
        for name, values in record.arrays.items():
            put(group, name, values)
        write_attributes(group, record.values)

    def _write_members(self, path: str, records: Sequence[Record]) -> None:
        if path not in self._rows:
            known = identities_in(self.file[path]) if path in self.file else []
            self._rows[path] = {one: row for row, one in enumerate(known)}
        held, first = self._rows[path], records[0]
        is_new, group = not held, make_group(self.file, path)
        rows = [held.setdefault(one.identity, len(held)) for one in records]
        for name in dict.fromkeys(name for one in records for name in one.values):
            if name not in OF_GROUP:
                column = _column([one.values.get(name) for one in records])
                put(group, name, column, rows, grows=True)
        for name in dict.fromkeys(name for one in records for name in one.arrays):
            own = [one.arrays.get(name) for one in records]
            if not _is_shared(name):
                put(group, name, _padded(own), rows, grows=True)
                continue
            # all members have the longest coordinate in common
            longest = max((one for one in own if one is not None), key=len)
            if name not in group or len(group[name]) < len(longest):
                put(group, name, longest, grows=True)
        if is_new:
            common = {name: first.values[name] for name in OF_GROUP if name in first.values}
            write_attributes(group, {SWEPT: list(first.keys), **common})


def _column(values: Sequence[Any]) -> NDArray[Any]:
    """Values of members as numbers, or as texts where not all of them are numbers."""
    kinds = {type(one) for one in values if one is not None}
    if kinds <= {int}:
        return np.array([-1 if one is None else one for one in values], dtype="<i8")
    if kinds <= {int, float}:
        return np.array([np.nan if one is None else one for one in values], dtype="<f8")
    texts = ("" if one is None else as_text(one) for one in values)
    return np.array([one.encode() for one in texts], dtype="S")


def _padded(arrays: Sequence[NDArray[Any] | None]) -> NDArray[Any]:
    """Arrays of several lengths as one, with nan at their ends."""
    shapes = [one.shape for one in arrays if one is not None]
    found = np.full((len(arrays), *map(max, zip(*shapes, strict=True))), np.nan)
    for row, one in enumerate(arrays):
        if one is not None:
            found[row][tuple(map(slice, one.shape))] = one
    return found


# --- reading --------------------------------------------------------------------------------------


def read_records(
    group: h5py.Group, rows: Sequence[int] | None = None, *, motions: bool = True
) -> Iterator[list[Record]]:
    """The runs in some rows of a group, or in all, in blocks of limited size.

    Without `motions` they have only the arrays of events.
    """
    keys, path = keys_in(group), str(group.name)
    nodes = _own_datasets(group, keys, "" if motions or keys else "events/")
    common = {name: _value(name, one) for name, one in read_attributes(group).items()}
    if not keys:
        yield [Record(path, common, {name: node[()] for name, node in nodes.items()})]
        return
    del common[SWEPT]
    columns = {name: node for name, node in nodes.items() if not axes_of(name)}
    arrays = {
        name: node
        for name, node in nodes.items()
        if axes_of(name) and (motions or name.startswith("events/"))
    }
    wanted = range(len(nodes[IDENTITY])) if rows is None else sorted(rows)
    each = sum(node.nbytes for node in (columns | arrays).values()) // len(nodes[IDENTITY])
    most = max(1, BLOCK_BYTES // each)
    for start in range(0, len(wanted), most):
        own = wanted[start : start + most]
        span = slice(own[0], own[-1] + 1)
        values = {name: _values(name, node[span]) for name, node in columns.items()}
        blocks = {n: node[() if _is_shared(n) else span] for n, node in arrays.items()}
        records = []
        for place in (row - span.start for row in own):
            found = {name: one[place] for name, one in values.items() if one[place] is not None}
            held = {n: one if _is_shared(n) else one[place] for n, one in blocks.items()}
            records.append(Record(path, common | found, _cut(held, found), keys))
        yield records


def _value(name: str, value: Any) -> Any:
    """A value of a file; lists and mappings are written as JSON."""
    known = field_named(name)
    return json.loads(value) if known is not None and known.is_json else value


def _values(name: str, column: NDArray[Any]) -> list[Any]:
    """The values of a column; None where a member has none."""
    if column.dtype.kind == "S":
        return [_value(name, one.decode()) if one else None for one in column.tolist()]
    if column.dtype.kind == "i":
        return [None if one == FILL["i"] else one for one in column.tolist()]
    return list(column.tolist())


def _cut(arrays: Mapping[str, NDArray[Any]], values: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """The arrays of a member without the fill at their ends; those that it lacks are left out."""
    counts = values.get(COUNTS, {})
    lengths = {f"events/{name}/{OCCURRENCE}": one for name, one in counts.items()}
    lengths[TIME] = values[POINTS]
    return {
        name: one[: lengths[axis]]
        for name, one in arrays.items()
        if (axis := axes_of(name)[0]) in lengths
    }


def _is_shared(name: str) -> bool:
    """Whether members have an array in common, for it is a coordinate."""
    return axes_of(name) == (name,)


def _own_datasets(
    group: h5py.Group, keys: Sequence[str], above: str = ""
) -> dict[str, h5py.Dataset]:
    """The arrays and columns of this program in a group, or below a path in it."""
    found = datasets(group[above or "."]) if not above or above in group else ()
    labels = {IDENTITY, NUMBER, DESIGN, POINTS, *keys} if keys else ()
    return {
        name: node
        for name, node in ((above + path, node) for path, node in found)
        if name in labels or ((one := field_named(name)) is not None and (one.axes or keys))
    }
