"""Runs are written into groups of a file, and the summary of a case beside them."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.digests import canonical_json, sha256
from fvi_cli.storage.groups.columns import AttributeColumn, Columns, add_row
from fvi_cli.storage.groups.reading import (
    ARRAYS,
    BLOCK_BYTES,
    IDENTITY,
    MEMBER,
    MOST_ROWS,
    POINTS,
    axes_in_words,
    is_shared,
    scale_of,
)
from fvi_cli.storage.records.fields import TIME, meaning_of
from fvi_cli.storage.records.record import SWEPT, Entry, StoredRecord
from fvi_cli.studies.members import counts_in_words

ALWAYS_BY_MEMBER: Final = (
    IDENTITY, "status", "predicted", "error", "floor", "expected_order", "setup_seconds",
    "stepping_seconds", "history_operations", POINTS,
)  # fmt: skip
"""Datasets along ``member`` even where all members have the same."""

_MEANINGS: Final[Mapping[str, str]] = {
    MEMBER: "member of the sweep",
    POINTS: "number of points that the member has; nan behind them",
    IDENTITY: "SHA-256 of what determines the numbers",
    "seconds": "time for the steps in seconds",
}

_SUMMARIES: Final[Mapping[str, Callable[[Any], str]]] = {
    IDENTITY: lambda values: sha256(";".join(values)),
    "status": counts_in_words,
    "predicted": counts_in_words,
    "gamma": lambda values: "swept",
}
_TEXT: Final = h5py.string_dtype()


@dataclass(frozen=True, kw_only=True)
class WrittenGroup:
    """Attributes of the runs of a group that has just been written."""

    attributes: dict[str, Any]  # what they have in common, and what they differ in
    by_member: Columns
    keys: tuple[str, ...]  # what is swept
    checksums: Sequence[str]  # of each of them

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.checksums)

    def column(self, name: str) -> Sequence[Any]:
        """What each of the runs says."""
        common = AttributeColumn.repeated(self.attributes.get(name, ""), len(self))
        return self.by_member.get(name, common)


def write_group(file: h5py.File, path: str, rows: Sequence[Entry]) -> WrittenGroup:
    """Write a run, or members of a sweep, into one group."""
    group = file.create_group(path, track_order=True)
    keys = tuple(json.loads(rows[0].attributes().get(SWEPT, "[]")))
    if keys:
        return _write_members(group, rows, keys)
    (row,) = rows
    record = row.record()
    attributes = {**record.attributes, IDENTITY: row.identity, ARRAYS: axes_in_words(record.axes)}
    for name, values in record.arrays.items():
        for axis, size in zip(record.axes[name], values.shape, strict=True):
            _label(group, scale_of(axis, of_members=False), size, record.arrays)
        if name not in group:
            _create(group, name, values.dtype, values.shape)[()] = values
    _attach_scales(group, record.axes, of_members=False)
    write_attributes(group, attributes)
    return WrittenGroup(attributes=attributes, by_member={}, keys=(), checksums=[record.checksum])


def _write_members(group: h5py.Group, rows: Sequence[Entry], keys: tuple[str, ...]) -> WrittenGroup:
    """Write members of a sweep into common arrays, some in memory at a time."""
    columns, axes, shapes = _survey(rows)
    count, length = len(rows), max(columns[POINTS])
    attributes, by_member = _attributes_of_members(columns, keys)
    _create(group, MEMBER, np.dtype("<i8"), (count,))[()] = np.arange(count)
    for name, column in by_member.items():
        write_column(group, name, column, coordinates=() if name in keys else keys)
    for name in axes:
        if is_shared(name, axes):
            size = length if name == TIME else shapes[name][0]
            _create(group, name, np.dtype("<f8"), (size,))
    for name, own in axes.items():
        if name in group:
            continue
        shape = (length if own[0] == TIME else shapes[name][0], *shapes[name][1:])
        for axis, size in zip(own, shape, strict=True):
            _label(group, axis, size, {})
        _create(group, name, np.dtype("<f8"), (count, *shape), keys)
    checksums: list[str] = []
    shared: dict[str, NDArray[Any]] = {}
    for block in _blocks(rows):
        for record in block:
            for name in [one for one in record.arrays if is_shared(one, axes)]:
                values, known = record.arrays[name], shared.get(name, np.empty(0))
                common = min(values.size, known.size)
                if not np.array_equal(values[:common], known[:common]):
                    raise ValueError(f"{group.name}: members have other times")
                shared[name] = values if values.size > known.size else known
        start, stop = len(checksums), len(checksums) + len(block)
        for name in axes:
            if name not in shared:
                held = np.full((len(block), *group[name].shape[1:]), np.nan)
                for row, record in enumerate(block):
                    if name in record.arrays:
                        held[row, : record.arrays[name].shape[0]] = record.arrays[name]
                group[name][start:stop] = held
        checksums += [record.checksum for record in block]
    for name, values in shared.items():
        group[name][: values.size] = values
    _attach_scales(group, axes, of_members=True)
    write_attributes(group, attributes)
    return WrittenGroup(attributes=attributes, by_member=by_member, keys=keys, checksums=checksums)


def _survey(
    rows: Sequence[Entry],
) -> tuple[Columns, dict[str, tuple[str, ...]], dict[str, tuple[int, ...]]]:
    """Attributes of members, the axes of their arrays, and the largest shapes of these."""
    columns: Columns = {}
    axes: dict[str, tuple[str, ...]] = {}
    shapes: dict[str, tuple[int, ...]] = {}
    words: dict[str, str] = {}
    for number, row in enumerate(rows):
        found = row.source.shapes(row)
        mine = {name: own for name, _, own in found}
        axes |= {name: own for name, own in mine.items() if name not in axes}
        for name, shape, _ in found:
            shapes[name] = max(shapes.get(name, shape), shape)
        text = axes_in_words(mine)
        points = next(shape[0] for name, shape, _ in found if name == TIME)
        own = {**row.attributes(), IDENTITY: row.identity, POINTS: points,
               ARRAYS: words.setdefault(text, text)}  # fmt: skip
        add_row(columns, own, number)
    return columns, axes, shapes


def _attributes_of_members(
    columns: Columns, keys: tuple[str, ...]
) -> tuple[dict[str, Any], Columns]:
    """What members have in common, and what they differ in."""
    attributes: dict[str, Any] = {}
    by_member: Columns = {key: columns[key] for key in keys}
    for name, column in columns.items():
        if name in by_member:
            continue
        if column.is_common or name in _SUMMARIES:
            attributes[name] = column[0] if column.is_common else _SUMMARIES[name](column)
        if not column.is_common or name in ALWAYS_BY_MEMBER:
            by_member[name] = column
    return attributes, by_member


def _blocks(rows: Sequence[Entry]) -> Iterator[list[StoredRecord]]:
    """The runs, some in memory at a time."""
    waiting: list[StoredRecord] = []
    size = 0
    for row in rows:
        record = row.record()
        waiting.append(record)
        size += record.size
        if size >= BLOCK_BYTES or len(waiting) >= MOST_ROWS:
            yield waiting
            waiting, size = [], 0
    if waiting:
        yield waiting


def attribute(value: Any) -> Any:
    """A value as other readers of HDF5 expect it: text, float64, int64, or an array of these."""
    if isinstance(value, str):
        return value
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return np.int64(value)
    if isinstance(value, float | np.floating):
        return np.float64(value)
    if isinstance(value, np.ndarray | list):
        values = np.asarray(value)
        if values.dtype.kind in "if" and values.size:
            return values
    raise TypeError(f"attribute: {value!r} is not text, a number or an array of numbers")


def write_attributes(node: h5py.Group | h5py.Dataset, attributes: Mapping[str, Any]) -> None:
    """Write attributes that are not there yet.

    The library's own way looks for each of them first and takes three times as long.
    """
    for name, value in attributes.items():
        data = np.asarray(attribute(value), dtype=_TEXT if isinstance(value, str) else None)
        in_file, in_memory = _kinds(data.dtype)
        space = h5py.h5s.create_simple(data.shape)
        held = h5py.h5a.create(node.id, name.encode(), in_file, space)
        held.write(data, mtype=in_memory)


@functools.cache
def _kinds(dtype: np.dtype[Any]) -> tuple[Any, Any]:
    """The library's own names of a type."""
    return h5py.h5t.py_create(dtype, logical=True), h5py.h5t.py_create(dtype)


def write_column(
    group: h5py.Group, name: str, column: AttributeColumn, *, coordinates: Sequence[str] = ()
) -> None:
    """Write one value for every member: numbers, texts, or JSON where it is neither."""
    data, is_json = column.written()
    kind = data.dtype if isinstance(data, np.ndarray) else _TEXT
    dataset = group.create_dataset(name, data=data, dtype=kind)
    attributes = {"long_name": _MEANINGS.get(name) or meaning_of(name)}
    if is_json:
        attributes["encoding"] = "json"
    if coordinates:
        attributes["coordinates"] = " ".join(coordinates)
    write_attributes(dataset, attributes)


def _create(
    group: h5py.Group, name: str, kind: Any, shape: tuple[int, ...], keys: Sequence[str] = ()
) -> h5py.Dataset:
    dataset = group.create_dataset(name, shape=shape, dtype=kind)
    attributes = {"long_name": _MEANINGS.get(name) or meaning_of(name)}
    write_attributes(dataset, attributes | ({"coordinates": " ".join(keys)} if keys else {}))
    return dataset


def _label(group: h5py.Group, axis: str, size: int, known: Mapping[str, Any]) -> None:
    """Number an axis that has no values of its own."""
    if axis not in group and axis not in known:
        _create(group, axis, np.dtype("<i8"), (size,))[()] = np.arange(size)


def _attach_scales(
    group: h5py.Group, axes: Mapping[str, tuple[str, ...]], *, of_members: bool
) -> None:
    """Every axis of every dataset has a dimension scale, those of axes being scales themselves."""
    along = {
        name: tuple(scale_of(a, of_members=of_members) for a in own) for name, own in axes.items()
    }
    scales = {one for own in along.values() for one in own} | ({MEMBER} if of_members else set())
    for name in scales:
        group[name].make_scale(name.rpartition("/")[2])
    if of_members:
        front = {name: () if is_shared(name, axes) else (MEMBER,) for name in axes}
        along = {name: (*front[name], *own) for name, own in along.items()}
        along |= {
            name: (MEMBER,)
            for name in group
            if isinstance(group[name], h5py.Dataset) and name not in along
        }
    for name, own in along.items():
        if name not in scales:
            for axis, scale in enumerate(own):
                h5py.h5ds.attach_scale(group[name].id, group[scale].id, axis)


_SUMMARY: Final[Mapping[str, tuple[str, Any, Any]]] = {
    "error": ("error", np.nan, float),
    "seconds": ("stepping_seconds", np.nan, float),
    "history_operations": ("history_operations", 0, np.int64),
    "status": ("status", "missing", object),
}


def write_convergence(group: h5py.Group, ladder: Mapping[int, Sequence[WrittenGroup]]) -> None:
    """The summary of a case: errors and what they took, by number of steps, and by member."""
    steps = sorted(ladder)
    first = ladder[steps[0]][0]
    keys = first.keys
    numbers: dict[str, int] = {}
    swept = [AttributeColumn() for _ in keys]
    rungs: dict[int, list[int]] = {}
    for n_steps in ladder:
        own = rungs[n_steps] = []
        for one in ladder[n_steps]:
            # without keys there is one run
            columns = [one.column(key) for key in keys]
            for values in zip(*columns, strict=True) if keys else [()]:
                row = numbers.setdefault(canonical_json(values), len(numbers))
                own.append(row)
                for column, value in zip(swept, values, strict=True):
                    if row == len(column):
                        column.append(value)
    write_attributes(group, {"norm": first.column("norm")[0]})
    axes = {"n_steps": np.array(steps, dtype=np.int64)}
    if keys:
        write_attributes(group, {SWEPT: json.dumps(keys)})
        axes = {MEMBER: np.arange(len(numbers)), **axes}
    for name, along in axes.items():
        _create(group, name, np.dtype("<i8"), along.shape)[()] = along
        group[name].make_scale(name)
    for key, column in zip(keys, swept, strict=True):
        write_column(group, key, column)
        group[key].dims[0].attach_scale(group[MEMBER])
    sizes = np.array([float(ladder[n][0].attributes["step_size"]) for n in steps])
    _create(group, "step_size", np.dtype("<f8"), sizes.shape)[()] = sizes
    group["step_size"].dims[0].attach_scale(group["n_steps"])
    for name, (source, empty, kind) in _SUMMARY.items():
        table = np.full((len(numbers), len(steps)), empty, dtype=kind)
        for rung, n_steps in enumerate(steps):
            table[rungs[n_steps], rung] = [v for one in ladder[n_steps] for v in one.column(source)]
        held = table if keys else table[0]
        kind = _TEXT if kind is object else np.dtype("<f8" if kind is float else "<i8")
        _create(group, name, kind, held.shape, keys)[()] = held
        for axis, dimension in enumerate(axes):
            group[name].dims[axis].attach_scale(group[dimension])
