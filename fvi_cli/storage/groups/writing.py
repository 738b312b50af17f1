"""Writing runs into groups of a file."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.digests import sha256
from fvi_cli.storage.groups.columns import Survey, column_to_write
from fvi_cli.storage.groups.reading import (
    ARRAYS,
    BLOCK_BYTES,
    IDENTITY,
    MEMBER,
    MESH_POINTS,
    MOST_ROWS,
    POINTS,
    Axes,
    axes_in_words,
    scale_of,
)
from fvi_cli.storage.records.fields import MESH, TIME, meaning_of
from fvi_cli.storage.records.record import SWEPT, Entry, StoredRecord
from fvi_cli.studies.members import counts_in_words

ALWAYS_BY_MEMBER: Final = (
    IDENTITY, "status", "predicted", "error", "floor", "expected_order", "setup_seconds",
    "stepping_seconds", "history_operations", POINTS,
)  # fmt: skip
"""Datasets along ``member`` even where all members have the same value."""

_MEANINGS: Final[Mapping[str, str]] = {
    MEMBER: "member of the sweep",
    POINTS: "number of points that the member has; nan behind them",
    MESH_POINTS: "number of points of its steps",
    IDENTITY: "SHA-256 of what determines the numbers",
}

_SUMMARIES: Final[Mapping[str, Callable[[Any], str]]] = {
    IDENTITY: lambda values: sha256(";".join(values)),
    "status": counts_in_words,
    "predicted": counts_in_words,
    "gamma": lambda values: "swept",
}
_TEXT: Final = h5py.string_dtype()


CHUNK_BYTES: Final = 2**19
"""Most bytes of a chunk, which HDF5 reads whole: it has one checksum."""


def guarded(shape: tuple[int, ...]) -> dict[str, Any]:
    """Arguments of a dataset of numbers whose chunks HDF5 checks; none if it is empty."""
    if not shape or 0 in shape:
        return {}
    chunk, room = [1] * len(shape), CHUNK_BYTES // 8
    for axis in reversed(range(len(shape))):
        chunk[axis] = min(shape[axis], room)
        room //= chunk[axis]
        if not room:
            break
    return {"chunks": tuple(chunk), "fletcher32": True}


class NewGroup:
    """A group that is being written; every axis of its datasets gets a dimension scale.

    The name of an axis is that of the dataset with its values; without values it is numbered.
    """

    def __init__(self, file: h5py.File, path: str, keys: Sequence[str] = ()) -> None:
        self.group = file.create_group(path, track_order=True)
        self.datasets: dict[str, h5py.Dataset] = {}
        self._keys = keys
        self._axes: dict[str, tuple[str, ...]] = {}

    def add(self, name: str, axes: tuple[str, ...], values: Any, *, is_json: bool = False) -> None:
        """Write an array of numbers, or texts."""
        is_text = not isinstance(values, np.ndarray) or values.dtype.kind == "O"
        kind = _TEXT if is_text else values.dtype
        self._add(name, axes, np.shape(values), data=values, dtype=kind)
        if is_json:
            write_attributes(self.datasets[name], {"encoding": "json"})

    def add_column(self, name: str, column: Sequence[Any]) -> None:
        """Write one value for every member: numbers, texts, or else JSON."""
        values, is_json = column_to_write(column)
        self.add(name, (MEMBER,), values, is_json=is_json)

    def reserve(self, name: str, axes: tuple[str, ...], shape: tuple[int, ...]) -> None:
        """Create a dataset for numbers that are written later."""
        self._add(name, axes, shape, shape=shape, dtype="<f8")

    def _add(
        self, name: str, axes: tuple[str, ...], sizes: tuple[int, ...], **content: object
    ) -> None:
        for axis, size in zip(axes, sizes, strict=True):
            if axis != name and axis not in self.datasets:
                self.add(axis, (axis,), np.arange(size, dtype="<i8"))
        if content["dtype"] != _TEXT:
            content |= guarded(sizes)
        dataset = self.group.create_dataset(name, **content)
        attributes = {"long_name": _MEANINGS.get(name) or meaning_of(name)}
        if self._keys and axes[0] == MEMBER and name not in (MEMBER, *self._keys):
            attributes["coordinates"] = " ".join(self._keys)
        write_attributes(dataset, attributes)
        self.datasets[name], self._axes[name] = dataset, axes

    def finish(self, attributes: Mapping[str, Any]) -> None:
        """Write the attributes of the group, and attach the scales."""
        write_attributes(self.group, attributes)
        handles = {name: dataset.id for name, dataset in self.datasets.items()}
        for name in dict.fromkeys(axis for own in self._axes.values() for axis in own):
            h5py.h5ds.set_scale(handles[name], name.rpartition("/")[2].encode())
        for name, own in self._axes.items():
            if own != (name,):
                for number, axis in enumerate(own):
                    h5py.h5ds.attach_scale(handles[name], handles[axis], number)


def write_group(file: h5py.File, path: str, rows: Sequence[Entry]) -> Survey:
    """Write a run, or members of a sweep in common arrays with few of them in memory at a time.

    Returns the attributes of all runs.
    """
    survey, axes, sizes = _survey(rows)
    keys = tuple(json.loads(survey.common.get(SWEPT, "[]")))
    new = NewGroup(file, path, keys)
    if keys:
        new.add(MEMBER, (MEMBER,), np.arange(len(rows), dtype="<i8"))
        for name in _by_member(survey, keys):
            new.add_column(name, survey.column(name))
    along = {n: tuple(scale_of(a, of_members=bool(keys)) for a in own) for n, own in axes.items()}
    is_scale = {name: own == (name,) for name, own in along.items()}
    for name in sorted(axes, key=lambda one: not is_scale[one]):
        shape = tuple(sizes[axis] for axis in axes[name])
        if keys and not is_scale[name]:
            new.reserve(name, (MEMBER, *along[name]), (len(rows), *shape))
        else:
            new.reserve(name, along[name], shape)
    written = 0
    shared: dict[str, NDArray[Any]] = {}
    for block in _blocks(rows):
        _write_block(new, block, written, [n for n in axes if not is_scale[n]])
        for record in block:
            _compare(shared, {n: v for n, v in record.arrays.items() if is_scale[n]}, path)
        written += len(block)
    for name, values in shared.items():
        new.datasets[name][: values.size] = values
    new.finish(_attributes_of(survey, keys))
    return survey


def _survey(rows: Sequence[Entry]) -> tuple[Survey, Axes, Mapping[str, int]]:
    """Attributes of runs, the axes of their arrays, and the largest length of every axis."""
    survey = Survey()
    axes: dict[str, tuple[str, ...]] = {}
    sizes: dict[str, int] = {}
    words: dict[str, str] = {}
    for row in rows:
        mine: dict[str, tuple[str, ...]] = {}
        for name, shape, own in row.source.shapes(row):
            mine[name] = axes.setdefault(name, own)
            for axis, size in zip(own, shape, strict=True):
                sizes[axis] = max(sizes.get(axis, 0), size)
            if name == TIME:
                points = shape[0]
            elif name == MESH:
                mesh_points = shape[0]
        text, attributes = axes_in_words(mine), row.attributes()
        layout = {IDENTITY: row.identity, POINTS: points, ARRAYS: words.setdefault(text, text)}
        if MESH in mine and SWEPT in attributes:
            layout[MESH_POINTS] = mesh_points
        survey.add({**attributes, **layout})
    return survey, axes, sizes


def _by_member(survey: Survey, keys: tuple[str, ...]) -> list[str]:
    """Names of the values that are written for every member: swept keys and differing values."""
    names = {*survey.columns, *ALWAYS_BY_MEMBER}.difference(keys)
    return [*keys, *(name for name in survey.names if name in names)]


def _attributes_of(survey: Survey, keys: tuple[str, ...]) -> dict[str, Any]:
    """Attributes that all runs of a group share, and summaries of others."""
    left_out = keys or (POINTS,)
    common = {name: value for name, value in survey.common.items() if name not in left_out}
    for name, summary in _SUMMARIES.items():
        if name in survey.columns:
            common[name] = summary(survey.columns[name])
    return common


def _blocks(rows: Sequence[Entry]) -> Iterator[list[StoredRecord]]:
    """The records of the runs, in blocks of limited size."""
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


def _write_block(
    new: NewGroup, block: Sequence[StoredRecord], start: int, names: Sequence[str]
) -> None:
    """Write the arrays of a run, or of members from number `start` on, nan after their ends."""
    for name in names:
        dataset = new.datasets[name]
        if SWEPT not in block[0].attributes:
            values = np.ascontiguousarray(block[0].arrays[name])
            dataset.id.write(h5py.h5s.ALL, h5py.h5s.ALL, values)
            continue
        held = np.full((len(block), *dataset.shape[1:]), np.nan)
        for row, record in enumerate(block):
            if name in record.arrays:
                held[row, : record.arrays[name].shape[0]] = record.arrays[name]
        dataset[start : start + len(block)] = held


def _compare(shared: dict[str, NDArray[Any]], own: Mapping[str, NDArray[Any]], path: str) -> None:
    """Extend the values of shared axes by a run's; ValueError where both differ."""
    for name, values in own.items():
        known = shared.get(name, values)
        common = min(values.size, known.size)
        if not np.array_equal(values[:common], known[:common]):
            raise ValueError(f"{path}: members have other times")
        shared[name] = values if values.size > known.size else known


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
    """Write attributes that do not exist yet.

    The usual interface of h5py looks up each attribute first and takes three times as long.
    """
    for name, value in attributes.items():
        data = np.asarray(attribute(value), dtype=_TEXT if isinstance(value, str) else None)
        in_file, in_memory, space = _described(data.dtype, data.shape)
        held = h5py.h5a.create(node.id, name.encode(), in_file, space)
        held.write(data, mtype=in_memory)


@functools.lru_cache(maxsize=64)
def _described(dtype: np.dtype[Any], shape: tuple[int, ...]) -> tuple[Any, Any, Any]:
    """HDF5 objects for a type in a file, a type in memory, and a shape."""
    kinds = h5py.h5t.py_create(dtype, logical=True), h5py.h5t.py_create(dtype)
    return *kinds, h5py.h5s.create_simple(shape)
