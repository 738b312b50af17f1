"""Runs are written into groups of a file, and the summary of a case beside them."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.fields.observed import COUNTS, OCCURRENCE, observed_meaning, occurrences
from fvi_cli.storage.groups import (
    COMPLETE,
    MEMBER,
    PACKED,
    Columns,
    Repeated,
    attribute,
    axes_of,
    datasets_below,
)
from fvi_cli.storage.provenance import CHECKSUM, canonical_json, checksum, plain, sha256
from fvi_cli.storage.records import (
    LONG_NAMES,
    POINTS,
    SHARED,
    SWEPT,
    Record,
    digest_of,
    dimensions_of,
    has_points,
    stored_kind,
)
from fvi_cli.studies.sweep_summary import counts_in_words

ALWAYS_BY_MEMBER = (
    "identity",
    "status",
    "predicted",
    "error",
    "floor",
    "expected_order",
    "setup_seconds",
    "stepping_seconds",
    "history_operations",
    "data_sha256",
    POINTS,
)
"""Datasets along ``member`` even where all members have the same."""

MEANINGS: Mapping[str, str] = {
    **LONG_NAMES,
    MEMBER: "member of the sweep",
    POINTS: "number of points that the member has; nan behind them",
    "identity": "SHA-256 of what determines the numbers",
    "floor": "errors below are round-off or the reference's own",
    "predicted": "what the stability analysis said",
    "expected_order": "order that theory expects",
    "setup_seconds": "time for weights and factorisations in seconds",
    "stepping_seconds": "time for the steps in seconds",
}

_SUMMARIES: Mapping[str, Any] = {
    "identity": lambda values: sha256(";".join(values)),
    "status": counts_in_words,
    "predicted": counts_in_words,
    "gamma": lambda values: "swept",
}
_TEXT = h5py.string_dtype()
_OF_MEMBER = "[member]"


@dataclass(frozen=True, kw_only=True)
class WrittenGroup:
    """What is said of the runs of a group that has just been written.

    Parameters
    ----------
    attributes, by_member, keys, count
        As of a :class:`fvi_cli.storage.groups.StoredGroup`.
    """

    attributes: dict[str, Any]
    by_member: Columns
    keys: tuple[str, ...]
    count: int
    is_complete: bool = True

    def __len__(self) -> int:
        """Number of runs."""
        return self.count


def columns_of(attributes: Sequence[Mapping[str, Any]]) -> Columns:
    """The attributes of runs by name; what a run does not have is an empty text."""
    names = dict.fromkeys(name for one in attributes for name in one)
    return {name: [one.get(name, "") for one in attributes] for name in names}


def write_group(
    file: h5py.File,
    path: str,
    columns: Columns,
    blocks: Iterable[Sequence[Record]],
    *,
    is_part: bool = False,
) -> WrittenGroup:
    """Write a run, or members of a sweep, into one group.

    Parameters
    ----------
    file
        Open for writing.
    path
        Of the group.
    columns
        Attributes of all runs; without :data:`SWEPT` there is one run, with it the specification
        is what all have in common.
    blocks
        The runs in order, some at a time. The first block fixes the degrees of freedom.
    is_part
        Nobody but this package reads it, so that all that is said may be one text.
    """
    group = file.create_group(path, track_order=True)
    keys: list[str] = json.loads(columns[SWEPT][0]) if SWEPT in columns else []
    by_member: Columns = {}
    if keys:
        said, by_member = _said_of_members(group, columns, keys)
        shared = _write_members(group, columns, blocks, keys)
    else:
        said = {name: attribute(values[0]) for name, values in columns.items()}
        ((record,),) = blocks
        shared = _write_alone(group, record.datasets, is_part=is_part)
    said["shared_sha256"] = digest_of(shared)
    if is_part:
        packed = json.dumps({name: plain(value) for name, value in said.items()})
        write_attributes(group, {PACKED: packed})
    else:
        write_attributes(group, said)
    of_members = {f"{name}{_OF_MEMBER}": values for name, values in by_member.items()}
    write_attributes(group, {CHECKSUM: checksum(said | of_members), COMPLETE: 1})
    count = len(columns["identity"])
    return WrittenGroup(attributes=said, by_member=by_member, keys=tuple(keys), count=count)


def _write_alone(
    group: h5py.Group, datasets: Mapping[str, NDArray[Any]], *, is_part: bool
) -> dict[str, NDArray[Any]]:
    """Write the arrays of a run that stands alone; gives those that members would share."""
    shared = {name: datasets[name] for name in SHARED if name in datasets}
    nodes = {
        name: _create(group, name, data=data, is_described=not is_part)
        for name, data in {**shared, **datasets}.items()
    }
    if not is_part:
        _attach_scales(nodes)
    return shared


def _write_members(
    group: h5py.Group, columns: Columns, blocks: Iterable[Sequence[Record]], keys: Sequence[str]
) -> dict[str, NDArray[Any]]:
    """Write the arrays of members of a sweep; gives those that they share."""
    count, length = len(columns["identity"]), max(int(points) for points in columns[POINTS])
    shared: dict[str, NDArray[Any]] = {}
    start = 0
    for block in blocks:
        for record in block:
            for name in SHARED:
                values = record.datasets.get(name)
                if values is not None and (name not in shared or values.size > shared[name].size):
                    shared[name] = values
        _write_shared(group, shared, length)
        for name in dict.fromkeys(n for record in block for n in record.datasets):
            if name in SHARED:
                continue
            if name not in group:
                like = next(r.datasets[name] for r in block if name in r.datasets)
                rows = length
                if not has_points(name):
                    rows = _label_occurrences(group, name, columns)
                _create(group, name, shape=(count, rows, *like.shape[1:]), keys=keys)
            values = np.full((len(block), *group[name].shape[1:]), np.nan)
            for row, record in enumerate(block):
                if name in record.datasets:
                    values[row, : record.datasets[name].shape[0]] = record.datasets[name]
            group[name][start : start + len(block)] = values
        start += len(block)
    _attach_scales(dict(datasets_below(group)))
    return shared


def write_attributes(node: h5py.Group | h5py.Dataset, said: Mapping[str, Any]) -> None:
    """Write attributes that are not there yet.

    The library's own way looks for each of them first and takes three times as long.
    """
    for name, value in said.items():
        data = np.asarray(value, dtype=_TEXT if isinstance(value, str) else None)
        in_file, in_memory = _kinds(data.dtype)
        space = h5py.h5s.create_simple(data.shape)
        held = h5py.h5a.create(node.id, name.encode(), in_file, space)
        held.write(data, mtype=in_memory)


@functools.cache
def _kinds(dtype: np.dtype[Any]) -> tuple[Any, Any]:
    """The library's own names of a type."""
    return h5py.h5t.py_create(dtype, logical=True), h5py.h5t.py_create(dtype)


def _label_occurrences(group: h5py.Group, name: str, columns: Columns) -> int:
    """Most occurrences of an event in any member, with a scale for them; returns their number."""
    told = columns.get(COUNTS, [])
    most = max((occurrences(name, {COUNTS: one}) for one in told), default=0)
    label = f"{name.rpartition('/')[0]}/{OCCURRENCE}"
    if label not in group:
        _create(group, label, data=np.arange(most))
    return most


def _said_of_members(
    group: h5py.Group, columns: Columns, keys: Sequence[str]
) -> tuple[dict[str, Any], Columns]:
    """What members have in common, and what they differ in, which is written."""
    said: dict[str, Any] = {"specification": columns["specification"][0]}
    by_member: Columns = {key: columns[key] for key in keys}
    for name, values in columns.items():
        if name in said or name in by_member:
            continue
        differs = not isinstance(values, Repeated) and not all(
            is_same(v, values[0]) for v in values
        )
        if not differs or name in _SUMMARIES:
            summary = _SUMMARIES[name](values) if differs else values[0]
            said[name] = attribute(summary)
        if differs or name in ALWAYS_BY_MEMBER:
            by_member[name] = values
    group.create_dataset(MEMBER, data=np.arange(len(columns["identity"]))).make_scale(MEMBER)
    write_attributes(group[MEMBER], {"long_name": MEANINGS[MEMBER]})
    for name, values in by_member.items():
        write_column(group, name, values, coordinates=() if name in keys else keys)
    return said, by_member


def is_same(one: Any, other: Any) -> bool:
    """Whether two values are of one type and equal; nan is nan."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    return type(one) is type(other) and bool(one == other)


def write_column(
    group: h5py.Group, name: str, values: Sequence[Any], *, coordinates: Sequence[str] = ()
) -> None:
    """Write one value for every member: numbers, texts, or JSON where it is neither."""
    encoding = ""
    data: Any
    kind: Any
    if all(isinstance(v, int | np.integer) and not isinstance(v, bool) for v in values):
        data, kind = np.array(values, dtype=np.int64), np.dtype("<i8")
    elif all(isinstance(v, float | np.floating) for v in values):
        data, kind = np.array(values, dtype=float), np.dtype("<f8")
    else:
        if not all(isinstance(v, str) for v in values):
            encoding = "json"
            values = [json.dumps(plain(v)) for v in values]
        data, kind = list(values), _TEXT
    dataset = group.create_dataset(name, data=data, dtype=kind)
    said = {"long_name": MEANINGS.get(name, name.replace("_", " "))}
    if encoding:
        said["encoding"] = encoding
    if coordinates:
        said["coordinates"] = " ".join(coordinates)
    write_attributes(dataset, said)


def _write_shared(group: h5py.Group, shared: Mapping[str, NDArray[Any]], length: int) -> None:
    for name, values in shared.items():
        if name not in group:
            # members that follow may have more points
            size = length if name == "time" else values.size
            _create(group, name, shape=(size,), kind=stored_kind(values))
            if not group[name].is_scale:
                group[name].make_scale(name)
        group[name][: values.size] = values


def _create(
    group: h5py.Group,
    name: str,
    *,
    data: NDArray[Any] | None = None,
    shape: tuple[int, ...] | None = None,
    kind: str = "<f8",
    keys: Sequence[str] = (),
    is_described: bool = True,
) -> h5py.Dataset:
    if data is not None:
        dataset = group.create_dataset(name, data=data, dtype=stored_kind(data))
    else:
        dataset = group.create_dataset(name, shape=shape, dtype=kind, fillvalue=_FILL[kind])
    if not is_described:
        return dataset
    said = {"long_name": MEANINGS[name] if name in MEANINGS else observed_meaning(name)}
    if keys:
        said["coordinates"] = " ".join(keys)
    write_attributes(dataset, said)
    if dimensions_of(name, of_members=bool(keys)) == (name,):
        dataset.make_scale(name.rpartition("/")[2])
    return dataset


_FILL: Mapping[str, float] = {"<f8": math.nan, "<i8": 0}


def _attach_scales(nodes: Mapping[str, h5py.Dataset]) -> None:
    for name, dataset in nodes.items():
        if dataset.is_scale:
            continue
        for axis, dimension in enumerate(axes_of(name, of_members=MEMBER in nodes)):
            h5py.h5ds.attach_scale(dataset.id, nodes[dimension].id, axis)


_SUMMARY: Mapping[str, tuple[str, Any, Any]] = {
    "error": ("error", np.nan, float),
    "seconds": ("stepping_seconds", np.nan, float),
    "history_operations": ("history_operations", 0, np.int64),
    "status": ("status", "missing", object),
}


def write_convergence(group: h5py.Group, ladder: Mapping[int, Columns]) -> None:
    """The summary of a case: errors and what they took, by number of steps, and by member.

    Parameters
    ----------
    group
        Empty.
    ladder
        The attributes of all runs by number of steps.
    """
    steps = sorted(ladder)
    first = ladder[steps[0]]
    keys: list[str] = json.loads(first[SWEPT][0]) if SWEPT in first else []
    places: dict[str, int] = {}
    values: list[list[Any]] = [[] for _ in keys]
    rows: dict[int, list[int]] = {}
    for n_steps in ladder:
        own = rows[n_steps] = []
        # without keys there is one run
        for one in zip(*(ladder[n_steps][key] for key in keys), strict=True) if keys else [()]:
            row = places.setdefault(canonical_json(one), len(places))
            own.append(row)
            for column, value in zip(values, one, strict=True):
                if row == len(column):
                    column.append(value)
    group.attrs["norm"] = attribute(first["norm"][0])
    axes = {"n_steps": np.array(steps, dtype=np.int64)}
    if keys:
        group.attrs[SWEPT] = json.dumps(keys)
        axes = {MEMBER: np.arange(len(places)), **axes}
    for name, numbers in axes.items():
        group.create_dataset(name, data=numbers, dtype="<i8").make_scale(name)
        group[name].attrs["long_name"] = MEANINGS[name]
    for key, column in zip(keys, values, strict=True):
        write_column(group, key, column)
        group[key].dims[0].attach_scale(group[MEMBER])
    sizes = np.array([float(ladder[n]["step_size"][0]) for n in steps])
    group.create_dataset("step_size", data=sizes).dims[0].attach_scale(group["n_steps"])
    group["step_size"].attrs["long_name"] = MEANINGS["step_size"]
    for name, (source, empty, kind) in _SUMMARY.items():
        table = np.full((len(places), len(steps)), empty, dtype=kind)
        for rung, n_steps in enumerate(steps):
            table[rows[n_steps], rung] = ladder[n_steps][source]
        held = table if keys else table[0]
        own_kind = _TEXT if kind is object else stored_kind(held)
        dataset = group.create_dataset(name, data=held.tolist(), dtype=own_kind)
        dataset.attrs["long_name"] = MEANINGS[name]
        if keys:
            dataset.attrs["coordinates"] = " ".join(keys)
        for axis, dimension in enumerate(axes):
            dataset.dims[axis].attach_scale(group[dimension])
