"""Reading and writing one result file."""

from __future__ import annotations

import contextlib
import functools
import json
import re
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import StorageError
from fvi_cli.storage.digests import FORMAT, INPUT, canonical_json
from fvi_cli.storage.files import CREATOR, explain_damage, open_stored, replacing
from fvi_cli.storage.groups.reading import (
    INDEX,
    INPUTS,
    Block,
    StoredGroup,
    json_value,
)
from fvi_cli.storage.groups.writing import (
    guarded,
    write_attributes,
    write_group,
)
from fvi_cli.storage.provenance import origin, package_versions, platform_name
from fvi_cli.storage.records.record import Entry, GroupKind, Shapes, StoredRecord, kind_of

HELD_BYTES: Final = 2**26
"""Most bytes of arrays that are cached of an open file, for members that are not read in order."""
GROUPS_KEPT: Final = 8

IDENTITIES: Final = "identity"
"""Dataset of the index with 32 bytes per run."""

NUMBERS: Final = ("group", "row")
"""Datasets of the index with one number per run."""

_NAMED: Final = re.compile(rf'"(?:{INPUT}|digest)": ?"([0-9a-f]{{64}})"')


class ResultFile:
    """A result file; reads give its contents at the time of opening."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._stack = contextlib.ExitStack()
        self._groups: OrderedDict[str, StoredGroup] = OrderedDict()
        self._blocks: OrderedDict[tuple[str, int], tuple[int, Block]] = OrderedDict()
        self._held = 0
        self._file: h5py.File | None = self._stack.enter_context(open_stored(path))
        self._stamp = _stamp_of(path)
        try:
            with explain_damage(path):
                file = self._file
                self.root = {name: json_value(value) for name, value in file.attrs.items()}
                names = ("groups", IDENTITIES, *NUMBERS)
                self._index = {name: file[f"{INDEX}/{name}"][()] for name in names}
        except BaseException:
            self.close()
            raise

    def _opened(self) -> h5py.File:
        """The HDF5 file, opened again if :meth:`close` was called."""
        if self._file is None:
            self._file = self._stack.enter_context(open_stored(self.path))
            if _stamp_of(self.path) != self._stamp:
                raise StorageError(
                    f"{self.path}: was replaced while it was read; run the command again"
                )
            _REOPENED.append(self)
            while len(_REOPENED) > MOST_REOPENED:
                _REOPENED.pop(0).close()
        return self._file

    @property
    def groups(self) -> list[dict[str, Any]]:
        """Path and kind of every group of runs."""
        return [json.loads(text) for text in self._index["groups"]]

    @functools.cached_property
    def entries(self) -> list[Entry]:
        """The entry (place) of every run, in the order of the file."""
        with explain_damage(self.path):
            return list(self._entries())

    def _entries(self) -> Iterator[Entry]:
        groups = [
            (str(one["path"]), GroupKind(**one["kind"] | {"swept": tuple(one["kind"]["swept"])}))
            for one in self.groups
        ]
        # the index is not needed any more: the entries hold its values
        identities = [bytes(row).hex() for row in self._index.pop(IDENTITIES)]
        numbers = (self._index.pop(name).tolist() for name in NUMBERS)
        for identity, group, number in zip(identities, *numbers, strict=True):
            path, kind = groups[group]
            yield Entry(identity, self, path, number, kind)

    def group(self, path: str) -> StoredGroup:
        """A group of runs."""
        if path not in self._groups:
            self._groups[path] = StoredGroup(self._opened()[path])
            while len(self._groups) > GROUPS_KEPT:
                self._groups.popitem(last=False)
        return self._groups[path]

    def attributes(self, entry: Entry) -> dict[str, Any]:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.attributes`."""
        with explain_damage(self.path):
            return self.group(entry.path).attributes_of(entry.row)

    def shapes(self, entry: Entry) -> Shapes:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.shapes`."""
        with explain_damage(self.path):
            return self.group(entry.path).shapes(entry.row)

    def read(self, entry: Entry) -> StoredRecord:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.read`."""
        with explain_damage(self.path):
            group = self.group(entry.path)
            key = entry.path, entry.row // group.rows_at_a_time
            if key not in self._blocks:
                self._blocks[key] = group.block(entry.row)
                self._held += _size(self._blocks[key])
                while len(self._blocks) > 1 and self._held > HELD_BYTES:
                    self._held -= _size(self._blocks.popitem(last=False)[1])
            self._blocks.move_to_end(key)
            arrays, axes = group.arrays_of(entry.row, *self._blocks[key])
            return StoredRecord(
                identity=entry.identity,
                attributes=group.attributes_of(entry.row),
                arrays=arrays,
                axes=axes,
            )

    def read_input(self, digest: str) -> NDArray[Any] | None:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.read_input`."""
        with explain_damage(self.path):
            if f"{INPUTS}/{digest}" not in self._opened():
                return None
            return np.asarray(self._opened()[f"{INPUTS}/{digest}"][()])

    def close(self) -> None:
        """Close the file; reading from it opens it again."""
        self._file = None
        self._groups.clear()
        self._blocks.clear()
        self._held = 0
        self._stack.close()


def _size(held: tuple[int, Block]) -> int:
    return sum(values.nbytes for values in held[1].values())


MOST_REOPENED: Final = 16
_REOPENED: Final[list[ResultFile]] = []
"""Files that were opened again: a merge reads many files, and a process can open only some."""


def _stamp_of(path: Path) -> tuple[int, ...]:
    """What changes when a file is replaced."""
    found = path.stat()
    return found.st_ino, found.st_size, found.st_mtime_ns


def write_file(
    path: Path,
    layout: Mapping[str, Sequence[Entry]],
    attributes: Mapping[str, Any],
    *,
    lookup: Callable[[str], NDArray[Any]],
    done: Callable[[], None],
) -> None:
    """Write all runs (few in memory at a time) and the index.

    `attributes` are the root attributes of the configuration; `lookup` returns a long list of
    numbers by its digest; `done` is called when all is read, before the file is replaced.
    """
    root = {
        "creator": CREATOR,
        "format": FORMAT,
        **attributes,
        **origin(),
        "packages": canonical_json(package_versions()),
        "hdf5_version": h5py.version.hdf5_version,
        "platform": platform_name(),
    }
    named = _named_in(attributes.values())
    index: dict[str, list[Any]] = {name: [] for name in (IDENTITIES, *NUMBERS)}
    with replacing(path) as (file, check):
        groups = []
        for number, (place, rows) in enumerate(layout.items()):
            survey = write_group(file, place, rows)
            check()
            for row, one in enumerate(rows):
                for column, value in zip(index.values(), (one.identity, number, row), strict=True):
                    column.append(value)
            kind = kind_of(rows[0].attributes())
            groups.append(json.dumps({"path": place, "kind": kind._asdict()}))
            for name in ("specification", *kind.swept):
                named |= _named_in(survey.column(name))
        for digest in sorted(named):
            _write_numbered(file, f"{INPUTS}/{digest}", lookup(digest), digest)
        _write_index(file, index, groups)
        write_attributes(file, root)
        check()
        done()


def _named_in(values: Iterable[Any]) -> set[str]:
    """Digests of the long lists of numbers, and of numbers of files, that attributes name."""
    known: set[str] = set()
    for value in values:
        text = value if isinstance(value, str) else json.dumps(value)
        if INPUT in text or '"digest"' in text:
            known.update(_NAMED.findall(text))
    return known


def _write_index(file: h5py.File, index: Mapping[str, list[Any]], groups: Sequence[str]) -> None:
    """Write the index."""
    group = file.create_group(INDEX, track_order=True)
    digests = bytes.fromhex("".join(index[IDENTITIES]))
    arrays = {IDENTITIES: np.frombuffer(digests, "u1").reshape(-1, 32)}
    arrays |= {name: np.array(index[name], dtype="<i8") for name in NUMBERS}
    scales = {"run": len(index["row"]), "byte": 32, "number": len(groups)}
    for name, size in scales.items():
        group.create_dataset(name, data=np.arange(size)).make_scale(name)
    group.create_dataset("groups", data=list(groups), dtype=h5py.string_dtype())
    group["groups"].dims[0].attach_scale(group["number"])
    for name, values in arrays.items():
        group.create_dataset(name, data=values, **guarded(values.shape))
        for axis, scale in enumerate(("run", "byte")[: values.ndim]):
            group[name].dims[axis].attach_scale(group[scale])


def _write_numbered(file: h5py.File, name: str, values: NDArray[Any], digest: str) -> None:
    """Write a long list of numbers with numbered axes."""
    dataset = file.create_dataset(name, data=values, **guarded(values.shape))
    for axis, size in enumerate(values.shape):
        scale = f"{INPUTS}/size_{size}"
        if scale not in file:
            file.create_dataset(scale, data=np.arange(size)).make_scale(f"size_{size}")
        dataset.dims[axis].attach_scale(file[scale])
    write_attributes(dataset, {"long_name": f"numbers of a configuration, SHA-256 {digest[:16]}"})
