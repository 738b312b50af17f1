"""Members of a sweep in one group: arrays with an axis ``member`` in front, and back.

What all members have in common is an attribute of the group; what differs is a dataset along
``member``. A trajectory that stopped early ends in nan; ``points`` says how much of it counts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.storage.provenance import canonical_json, sha256
from fvi_cli.storage.records import (
    COMPLETE,
    DIMENSIONS,
    LONG_NAMES,
    SWEPT,
    Record,
    attribute,
    checksum,
    group_path,
    kept_points,
    place_in,
    record_of,
    stored_kind,
)
from fvi_cli.studies.experiment import FinishedRun
from fvi_cli.studies.members import value_at, with_values, without_values
from fvi_cli.studies.sweep_summary import counts_in_words

MEMBER = "member"
POINTS = "points"
FIELDS = "fields"
JSON_TEXT = "json"

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

_SHARED = ("time", "dof", "map")
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

Columns = dict[str, list[Any]]
"""The attributes of members by name, a value for each of them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """The trajectories of some members that follow each other.

    Parameters
    ----------
    start
        The first of them in the group.
    shared
        Datasets without an axis of members.
    rows
        Datasets of every member, without the padding.
    """

    start: int
    shared: Mapping[str, NDArray[Any]]
    rows: Sequence[Mapping[str, NDArray[Any]]]


def member_record(finished: FinishedRun) -> Record:
    """What is stored of a member: as of any run, but no point off the grid that all share."""
    record, member = record_of(finished), finished.run.member
    if member is None:
        raise ValueError("run: it is no member of a sweep")
    time = record.datasets["time"]
    run = finished.run
    grid = run.step_size * kept_points(run.n_steps + 1, run.experiment.store_every)
    common = min(time.size, grid.size)
    off = np.flatnonzero(np.abs(time[:common] - grid[:common]) > 1e-6 * run.step_size)
    points = int(off[0]) if off.size else common
    datasets = {
        name: values[:points] if "time" in DIMENSIONS[name] else values
        for name, values in record.datasets.items()
    }
    names = [name for name in datasets if name not in _SHARED]
    attributes = {
        **record.attributes,
        SWEPT: json.dumps(list(member.values)),
        POINTS: points,
        FIELDS: ",".join(names),
        "data_sha256": checksum({name: datasets[name] for name in names}),
    }
    return Record(attributes=attributes, datasets=datasets)


def columns_of(records: Sequence[Record]) -> Columns:
    """The attributes of members by name; what a member does not have is an empty text."""
    names = dict.fromkeys(name for record in records for name in record.attributes)
    return {name: [record.attributes.get(name, "") for record in records] for name in names}


def block_of(records: Sequence[Record], start: int = 0) -> Block:
    """The trajectories of members that are written together."""
    shared: dict[str, NDArray[Any]] = {}
    for record in records:
        for name in _SHARED:
            values = record.datasets.get(name)
            if values is not None and values.size > shared.get(name, values[:0]).size:
                shared[name] = values
    rows = [{k: v for k, v in r.datasets.items() if k not in _SHARED} for r in records]
    return Block(start=start, shared=shared, rows=rows)


def write_batch(file: h5py.File, columns: Columns, blocks: Iterable[Block]) -> None:
    """Write members into one group, their trajectories block by block.

    Parameters
    ----------
    file
        Open for writing.
    columns
        Attributes of all members.
    blocks
        Trajectories of all members, in order. The first block fixes the degrees of freedom.
    """
    first = {name: values[0] for name, values in columns.items()}
    group = file.create_group(group_path(place_in(first)), track_order=True)
    count = len(columns["identity"])
    keys = json.loads(first[SWEPT])
    _write_columns(group, columns, keys)
    length = max(int(points) for points in columns[POINTS])
    for block in blocks:
        _write_shared(group, block, length)
        for name in dict.fromkeys(name for row in block.rows for name in row):
            if name not in group:
                shape = next(row[name].shape[1:] for row in block.rows if name in row)
                _create(group, name, (count, length, *shape), keys)
            held = group[name].shape[1:]
            values = np.full((len(block.rows), *held), np.nan)
            for k, row in enumerate(block.rows):
                if name in row:
                    values[k, : row[name].shape[0]] = row[name]
            group[name][block.start : block.start + len(block.rows)] = values
    _attach_scales(group)
    group.attrs[COMPLETE] = np.int64(1)


def _write_columns(group: h5py.Group, columns: Columns, keys: Sequence[str]) -> None:
    specifications = [json.loads(text) for text in columns["specification"]]
    template = specifications[0]
    shared_problem = without_values(template["problem"], tuple(keys))
    group.attrs["specification"] = canonical_json({**template, "problem": shared_problem})
    varying = set()
    for name, values in columns.items():
        if name == "specification":
            continue
        if all(_same(value, values[0]) for value in values):
            group.attrs[name] = attribute(values[0])
            continue
        varying.add(name)
        if name in _SUMMARIES:
            group.attrs[name] = _SUMMARIES[name](values)
    group.create_dataset(MEMBER, data=np.arange(len(columns["identity"]))).make_scale(MEMBER)
    group[MEMBER].attrs["long_name"] = MEANINGS[MEMBER]
    for key in keys:
        write_column(group, key, [value_at(one["problem"], key) for one in specifications])
    for name, values in columns.items():
        if name in ALWAYS_BY_MEMBER or name in varying:
            write_column(group, name, values)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (math.isnan(one) and math.isnan(other))
    return type(one) is type(other) and bool(one == other)


_SUMMARIES: Mapping[str, Any] = {
    "identity": lambda values: sha256(";".join(values)),
    "status": counts_in_words,
    "predicted": counts_in_words,
    "gamma": lambda values: "swept",
}


def write_column(group: h5py.Group, name: str, values: Sequence[Any]) -> None:
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
            encoding = JSON_TEXT
            values = [json.dumps(_listed(v)) for v in values]
        data, kind = list(values), h5py.string_dtype()
    dataset = group.create_dataset(name, data=data, dtype=kind)
    dataset.attrs["long_name"] = MEANINGS.get(name, name.replace("_", " "))
    if encoding:
        dataset.attrs["encoding"] = encoding
    if name not in json.loads(group.attrs[SWEPT]):
        dataset.attrs["coordinates"] = " ".join(json.loads(group.attrs[SWEPT]))


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _write_shared(group: h5py.Group, block: Block, length: int) -> None:
    for name, values in block.shared.items():
        if name in group:
            if name == "time" and values.size > 1:
                group[name][: values.size] = values
            continue
        size = length if name == "time" else values.size
        data = np.full(size, np.nan) if name == "time" else values
        dataset = group.create_dataset(name, data=data, dtype=stored_kind(values))
        dataset.attrs["long_name"] = MEANINGS[name]
        dataset.make_scale(name)
        if name == "time":
            dataset[: values.size] = values


def _create(group: h5py.Group, name: str, shape: tuple[int, ...], keys: Sequence[str]) -> None:
    dataset = group.create_dataset(name, shape=shape, dtype="<f8", fillvalue=np.nan)
    dataset.attrs["long_name"] = MEANINGS[name]
    dataset.attrs["coordinates"] = " ".join(keys)


def _attach_scales(group: h5py.Group) -> None:
    for name, dataset in group.items():
        if dataset.is_scale:
            continue
        for axis, dimension in enumerate((MEMBER, *DIMENSIONS.get(name, ()))[: dataset.ndim]):
            dataset.dims[axis].attach_scale(group[dimension])


def is_batch(group: h5py.Group) -> bool:
    """Whether a group holds members of a sweep."""
    return MEMBER in group


def read_columns(group: h5py.Group, names: Sequence[str] | None = None) -> Columns:
    """The attributes of all members, as they were given to :func:`write_batch`."""
    count = group[MEMBER].shape[0]
    keys = json.loads(group.attrs[SWEPT])
    wanted = [*group.attrs, *group] if names is None else [n for n in names if n != "specification"]
    columns: Columns = {}
    for name in wanted:
        if name in (COMPLETE, MEMBER, *_SHARED, *keys) or name in columns:
            continue
        if name in group and not _is_trajectory(name):
            columns[name] = _read_column(group[name])
        elif name in group.attrs:
            columns[name] = [group.attrs[name]] * count
    if names is None or "specification" in names:
        columns["specification"] = _specifications(group, keys)
    return columns


def _is_trajectory(name: str) -> bool:
    return name in DIMENSIONS and name not in _SHARED


def values_in(group: h5py.Group) -> list[dict[str, Any]]:
    """The swept values of every member."""
    keys = json.loads(group.attrs[SWEPT])
    found = [_read_column(group[key]) for key in keys]
    return [dict(zip(keys, values, strict=True)) for values in zip(*found, strict=True)]


def _specifications(group: h5py.Group, keys: Sequence[str]) -> list[str]:
    template = json.loads(group.attrs["specification"])
    return [
        canonical_json({**template, "problem": with_values(template["problem"], values)})
        for values in values_in(group)
    ]


def _read_column(dataset: h5py.Dataset) -> list[Any]:
    if h5py.check_string_dtype(dataset.dtype) is None:
        return list(dataset[()].tolist())
    texts = list(dataset.asstr()[()])
    return [json.loads(t) for t in texts] if "encoding" in dataset.attrs else texts


def read_rows(group: h5py.Group, columns: Columns, start: int, stop: int) -> list[Record]:
    """Members as they were written.

    Parameters
    ----------
    group
        Their group.
    columns
        All of its columns.
    start, stop
        The first of them and the one behind the last.

    Raises
    ------
    KeyError
        If a dataset is missing.
    ValueError
        If the numbers are not those that were written.
    """
    shared = {name: np.asarray(group[name][()]) for name in _SHARED if name in group}
    names = [name for name in group if _is_trajectory(name)]
    data = {name: np.asarray(group[name][start:stop]) for name in names}
    records = []
    for row in range(start, stop):
        attributes = {name: values[row] for name, values in columns.items()}
        points = int(attributes[POINTS])
        fields = attributes[FIELDS].split(",")
        own = {name: data[name][row - start, :points] for name in fields}
        if checksum(own) != attributes["data_sha256"]:
            raise ValueError(f"the numbers in {group.name} are not those that were written")
        datasets = {**shared, "time": shared["time"][:points], **own}
        residuals = attributes.pop("newton_worst_residuals", "")
        if len(residuals):
            attributes["newton_worst_residuals"] = np.asarray(residuals, dtype=float)
        records.append(Record(attributes=attributes, datasets=datasets))
    return records
