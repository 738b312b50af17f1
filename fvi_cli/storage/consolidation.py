"""All runs of a result file are put into their groups, and written."""

from __future__ import annotations

import functools
import itertools
import json
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py

from fvi_cli.errors import StorageError
from fvi_cli.storage.contents import LISTING, listing_of
from fvi_cli.storage.files import SUFFIX, replacing, say_also
from fvi_cli.storage.groups import CONVERGENCE, MOST_ROWS, Columns, Repeated
from fvi_cli.storage.provenance import (
    canonical_json,
    origin,
    package_versions,
    platform_name,
    sha256,
)
from fvi_cli.storage.records import SWEPT, Record, group_path, place_of, record_of
from fvi_cli.storage.snapshot import (
    BLOCK_BYTES,
    VARIANT_MARK,
    Key,
    Location,
    NewPart,
    Source,
    location_of,
)
from fvi_cli.storage.writing import (
    WrittenGroup,
    columns_of,
    is_same,
    write_convergence,
    write_group,
)
from fvi_cli.studies.experiment import FinishedRun

Layout = dict[str, Sequence[tuple[Key, Location]]]
"""Runs by the path of the group that they belong to, with the key that they have there."""


def layout_of(
    stored: Mapping[Key, Location], asked: Mapping[Key, Location], numbers: Mapping[Key, int]
) -> Layout:
    """Where runs belong: what is asked for under the name of its experiment, the rest beside it.

    Parameters
    ----------
    stored
        Every run.
    asked
        Those that the file's configuration asks for, in the order of asking.
    numbers
        Place of members in their sweep.
    """
    placed: dict[str, dict[str, tuple[Key, Location]]] = {}
    variants = {key[0][0]: key[1] for key in asked}

    def put(key: Key, location: Location, *, is_own: bool) -> None:
        (experiment, case, n_steps, values), *kind = key
        others = itertools.chain([key[1]], map(canonical_json, [kind]))
        names = (f"{experiment}{VARIANT_MARK}{sha256(what)[:8]}" for what in others)
        for name in itertools.chain([experiment] if is_own else [], names):
            path = group_path((name, case, n_steps, values))
            if values and _has_own_times(key[1]):
                path = _unused(path, placed)
            held = placed.setdefault(path, {})
            first, _ = next(iter(held.values()), (key, location))
            if values not in held and first[1:3] == key[1:3]:
                held[values] = (key, location)
                return
        raise ValueError(f"{experiment}: two runs in one place")  # pragma: no cover - kinds differ

    # members in the order of the sweep, whenever they were computed
    for key in sorted(asked, key=lambda key: numbers.get(key, -1)):
        put(key, stored.get(key, asked[key]), is_own=True)
    for key, location in stored.items():
        if key not in asked:
            variant = variants.get(key[0][0])
            is_own = location.is_of_configuration if variant is None else variant == key[1]
            put(key, location, is_own=is_own)
    return {path: list(placed.pop(path).values()) for path in list(placed)}


@functools.lru_cache(maxsize=64)
def _has_own_times(variant: str) -> bool:
    """Whether each member of a sweep has a mesh of its own, which a tolerance gives it."""
    return "accuracy" in json.loads(variant)


def _unused(path: str, placed: Mapping[str, object]) -> str:
    """A path beside this one where nothing is: every member has times of its own."""
    numbered = (f"{path}-{number}" for number in itertools.count(2))
    return next(one for one in itertools.chain([path], numbered) if not placed.get(one))


def write_part(
    folder: Path, batch: Sequence[FinishedRun]
) -> tuple[Sequence[Location], NewPart | None]:
    """Write finished runs into a part of their own.

    Returns
    -------
    tuple of sequence of Location and NewPart or None
        Where they lie, in their order; and the part, if all of them stand alone.

    Raises
    ------
    StorageError
        If it cannot be written.
    """
    records = [record_of(finished) for finished in batch]
    # experiments may share a run, and a refusal has the identity of what it refuses
    said = ("identity", "experiment", "status")
    names = [str(record.attributes[name]) for name in said for record in records]
    path = folder / f"{sha256(';'.join(names))}{SUFFIX}"
    groups: dict[str, list[Record]] = {}
    locations = []
    for finished, record in zip(batch, records, strict=True):
        group = groups.setdefault(group_path(place_of(finished.run)), [])
        locations.append(location_of(path, len(group), finished, record))
        group.append(record)
    with replacing(path) as new:
        for place, own in groups.items():
            columns = columns_of([record.attributes for record in own])
            write_group(new.file, place, columns, [own], is_part=True)
    if any(finished.run.member is not None for finished in batch):
        return locations, None
    return locations, NewPart(records={place: own[0] for place, own in groups.items()})


def write_file(
    path: Path,
    layout: Layout,
    said: Mapping[str, str],
    *,
    opened: Callable[[Path], Source],
    done: Callable[[], None],
) -> None:
    """Write all runs, some in memory at a time, and the summary of every case.

    Parameters
    ----------
    path
        Of the file.
    layout
        What belongs where; it is empty in the end.
    said
        What the root says of the configuration.
    opened
        Gives what may be read of a file.
    done
        Is called when everything is read, before the file is replaced.

    Raises
    ------
    StorageError
        If it cannot be written; then it is as it was.
    """
    root = {
        **said,
        **origin(),
        "packages": canonical_json(package_versions()),
        "hdf5_version": h5py.version.hdf5_version,
        "platform": platform_name(),
    }
    with replacing(path, root) as new:
        ladders: dict[str, dict[int, Columns]] = {}
        written: list[tuple[str, WrittenGroup]] = []
        for group in list(layout):
            runs = layout.pop(group)
            columns = _columns(runs, opened)
            blocks = _blocks([one for _, one in runs], opened)
            written.append((group.split("/")[1], write_group(new.file, group, columns, blocks)))
            new.check()
            ladder = ladders.setdefault(group.rpartition("/")[0], {})
            held = ladder.setdefault(int(columns["n_steps"][0]), {})
            for name, values in columns.items():
                held[name] = _joined(held.get(name, ()), values)
        for case, ladder in ladders.items():
            group = new.file.create_group(f"{case}/{CONVERGENCE}", track_order=True)
            write_convergence(group, ladder)
        say_also(new.file, LISTING, listing_of(written))
        new.check()
        done()


def _columns(runs: Sequence[tuple[Key, Location]], opened: Callable[[Path], Source]) -> Columns:
    """The attributes of runs that share a group, under the name that they are asked for."""
    columns = _columns_of([one for _, one in runs], opened)
    experiment, case, n_steps, _ = runs[0][0][0]
    named: dict[str, Any] = {"experiment": experiment, "case": case, "n_steps": n_steps}
    if SWEPT in columns:
        # another sweep may name the same keys in another order
        named[SWEPT] = columns[SWEPT][0]
    return columns | {name: Repeated(value, len(runs)) for name, value in named.items()}


def _columns_of(locations: Sequence[Location], opened: Callable[[Path], Source]) -> Columns:
    """The attributes of runs by name; what a run does not have is an empty text."""
    found: Columns = {}
    done = 0
    for (path, group), own in itertools.groupby(locations, key=lambda one: (one.file, one.group)):
        stretch = list(own)
        columns = opened(path).columns(group)
        if any(columns["identity"][one.row] != one.identity for one in stretch):
            raise StorageError(f"{path}: was replaced while it was read; begin again")
        rows = [one.row for one in stretch]
        for name in dict.fromkeys([*found, *columns]):
            before = found.get(name, Repeated("", done))
            found[name] = _joined(before, _picked(columns.get(name, Repeated("", 0)), rows))
        done += len(stretch)
    return found


def _picked(column: Sequence[Any], rows: Sequence[int]) -> Sequence[Any]:
    """Some rows of a column."""
    if isinstance(column, Repeated):
        return Repeated(column.value, len(rows))
    found = (column[row] for row in rows)
    return array(column.typecode, found) if isinstance(column, array) else list(found)


def _joined(first: Sequence[Any], second: Sequence[Any]) -> Sequence[Any]:
    """Two columns, one below the other, in as little memory as they allow."""
    if not first:
        return second
    if isinstance(first, Repeated) and isinstance(second, Repeated):
        is_one = is_same(first.value, second.value)
        return Repeated(first.value, len(first) + len(second)) if is_one else [*first, *second]
    if isinstance(first, array) and isinstance(second, array):
        return first + second if first.typecode == second.typecode else [*first, *second]
    return [*first, *second]


def _blocks(
    locations: Sequence[Location], opened: Callable[[Path], Source]
) -> Iterator[list[Record]]:
    """The runs, some in memory at a time."""
    waiting: list[Record] = []
    size = 0
    for location in locations:
        record = opened(location.file).record(location)
        waiting.append(record)
        size += sum(values.nbytes for values in record.datasets.values())
        if size >= BLOCK_BYTES or len(waiting) >= MOST_ROWS:
            yield waiting
            waiting, size = [], 0
    if waiting:
        yield waiting
