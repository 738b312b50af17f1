"""The journal: finished runs are appended to it at once; consolidating the file removes it.

A journal is a file of frames. A frame is a head, which is verified when the journal is opened, and
the numbers of its runs. An incomplete last frame, as a
killed process leaves it, is dropped; an invalid frame before a valid one is an error.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import struct
import time
from collections import OrderedDict
from collections.abc import Sequence
from io import FileIO
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import StorageError
from fvi_cli.storage.atomic import explain_os_error, followed
from fvi_cli.storage.records.record import Entry, Shapes, StoredRecord, kind_of, same_value

_logger = logging.getLogger(__name__)

SUFFIX: Final = ".journal"

SECONDS_UNSYNCED: Final = 1.0
"""A loss of power may lose runs of so many seconds; a killed process loses no appended run."""

_MAGIC: Final = b"fvi4"
_OLD: Final = b"fvi1"
_LENGTHS: Final = struct.Struct("<4sQQ32s")
_FRAMES_KEPT: Final = 4

Layout = Sequence[tuple[str, str, Sequence[int], Sequence[str]]]
"""(Name, type, shape, axes) of every array of a run."""

Head = dict[str, Any]
"""Attributes that all runs of a frame share, attributes of each run, layouts of their arrays."""


def journal_path(path: Path) -> Path:
    """The path of the journal of a result file."""
    return followed(path).with_suffix(SUFFIX)


class Journal:
    """The journal of the result file `path`; a caller that `writes` must hold its lock."""

    def __init__(self, path: Path, *, writes: bool) -> None:
        self.path = journal_path(path)
        self.entries: list[Entry] = []
        self.inputs: dict[str, tuple[int, str, tuple[int, ...]]] = {}
        self._writes = writes
        self._heads: OrderedDict[int, tuple[Head, list[int]]] = OrderedDict()
        self._file: FileIO | None = None
        self._end = 0
        self._synced = time.monotonic()
        if self.path.exists() and not self.path.is_file():  # a pipe would be read for ever
            raise StorageError(f"{self.path}: is not an ordinary file; move it away")
        try:
            if self.path.exists():
                self._open("r+b" if writes else "rb")
        except FileNotFoundError:  # it has just been consolidated
            return
        except PermissionError as error:
            raise StorageError(f"{self.path}: cannot be read: {error.strerror}") from None
        except BaseException:
            self.close()
            raise

    def _open(self, mode: Literal["rb", "r+b"]) -> FileIO:
        self._file = file = self.path.open(mode, buffering=0)
        size = os.fstat(file.fileno()).st_size
        if self._bytes(0, len(_OLD)) == _OLD:
            raise StorageError(
                f"{self.path}: was written by fvi 0.3; it is left as it is: run its configuration "
                "once more with that version, or move it away"
            )
        while (found := self._frame(self._end, size)) is not None:
            self._learn(self._end, *found)
        if self._end < size:
            self._refuse_damage(size)
            if self._writes:
                _logger.warning("%s: its last entry is incomplete and is dropped", self.path)
                file.truncate(self._end)
        return file

    def _refuse_damage(self, size: int) -> None:
        """Raise if a whole frame follows later: otherwise the rest is an incomplete frame."""
        rest = self._bytes(self._end, size - self._end)
        at = rest.find(_MAGIC, 1)
        while at >= 0:
            if self._frame(self._end + at, size) is not None:
                raise StorageError(
                    f"{self.path}: is damaged at byte {self._end}; it is left as it is: move it "
                    "away, and what is only in it is computed again"
                )
            at = rest.find(_MAGIC, at + 1)

    def _frame(self, place: int, size: int) -> tuple[Head, int, int] | None:
        """Head of a frame, and begin and end of its numbers (bytes); None if it is not whole."""
        if place + _LENGTHS.size > size:
            return None
        magic, head, body, own = _LENGTHS.unpack(self._bytes(place, _LENGTHS.size))
        begin = place + _LENGTHS.size + head
        if magic != _MAGIC or begin + body > size:
            return None
        text = self._bytes(place + _LENGTHS.size, head)
        if hashlib.sha256(struct.pack("<QQ", head, body) + text).digest() != own:
            return None
        return json.loads(text), begin, begin + body

    def _learn(self, place: int, head: Head, begin: int, end: int) -> None:
        """Add the runs of a frame to the entries."""
        for row, (identity, own, _) in enumerate(head["runs"]):
            attributes = {**head["common"], **own}
            kind = kind_of(attributes)
            self.entries.append(Entry(identity, self, kind.path, row, kind, place))
        at = end - sum(8 * math.prod(shape) for _, _, shape in head["inputs"])
        for digest, dtype, shape in head["inputs"]:
            self.inputs[digest] = (at, dtype, tuple(shape))
            at += 8 * math.prod(shape)
        self._end = end

    def append(self, records: Sequence[StoredRecord]) -> list[Entry]:
        """Write records as one frame, or leave the journal as it was."""
        content = self._encoded(records)
        with explain_os_error(self.path):
            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self.path.touch()
                self._open("r+b")
            file, remaining = self._opened(), memoryview(content)
            file.seek(self._end)
            try:
                while remaining:
                    remaining = remaining[file.write(remaining) or 0 :]
                if time.monotonic() - self._synced > SECONDS_UNSYNCED:
                    self.sync()
            except BaseException:
                file.truncate(self._end)
                raise
        known = len(self.entries)
        found = self._frame(self._end, self._end + len(content))
        if found is None:
            raise StorageError(f"{self.path}: another program is writing it")
        self._learn(self._end, *found)
        return self.entries[known:]

    def _encoded(self, records: Sequence[StoredRecord]) -> bytes:
        """The bytes of a frame; attributes that all records share are stored once."""
        first = records[0].attributes
        common = {
            name: value
            for name, value in first.items()
            if all(name in one.attributes and same_value(one.attributes[name], value)
                   for one in records)
        }  # fmt: skip
        inputs = {k: v for one in records for k, v in one.inputs.items() if k not in self.inputs}
        layouts: dict[str, int] = {}
        runs, body = [], []
        for one in records:
            own = {k: v for k, v in one.attributes.items() if k not in common}
            layout = json.dumps(
                [[n, a.dtype.str, a.shape, one.axes[n]] for n, a in one.arrays.items()]
            )
            number = layouts.setdefault(layout, len(layouts))
            runs.append([one.identity, own, number])
            body += [np.ascontiguousarray(a).tobytes() for a in one.arrays.values()]
        body += [np.ascontiguousarray(a).tobytes() for a in inputs.values()]
        head = {
            "common": common,
            "runs": runs,
            "layouts": [json.loads(layout) for layout in layouts],
            "inputs": [[name, a.dtype.str, a.shape] for name, a in inputs.items()],
        }
        text, numbers = json.dumps(head).encode(), b"".join(body)
        lengths = struct.pack("<QQ", len(text), len(numbers))
        digest = hashlib.sha256(lengths + text).digest()
        return _LENGTHS.pack(_MAGIC, len(text), len(numbers), digest) + text + numbers

    def _known(self, place: int) -> tuple[Head, list[int]]:
        """Head of a whole frame, and the place at which the numbers of each of its runs begin."""
        if place not in self._heads:
            found = self._frame(place, self._end)
            if found is None:
                raise StorageError(f"{self.path}: is damaged at byte {place}; move it away")
            head, at, _ = found
            sizes = list(map(_size_of, head["layouts"]))
            begins = []
            for *_, layout in head["runs"]:
                begins.append(at)
                at += sizes[layout]
            self._heads[place] = head, begins
            while len(self._heads) > _FRAMES_KEPT:
                self._heads.popitem(last=False)
        self._heads.move_to_end(place)
        return self._heads[place]

    def attributes(self, entry: Entry) -> dict[str, Any]:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.attributes`."""
        head, _ = self._known(entry.place)
        return {**head["common"], **head["runs"][entry.row][1]}

    def shapes(self, entry: Entry) -> Shapes:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.shapes`."""
        head, _ = self._known(entry.place)
        layout = head["layouts"][head["runs"][entry.row][2]]
        return [(name, tuple(shape), tuple(axes)) for name, _, shape, axes in layout]

    def read(self, entry: Entry) -> StoredRecord:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.read`."""
        head, begins = self._known(entry.place)
        layout = head["layouts"][head["runs"][entry.row][2]]
        raw, at = self._bytes(begins[entry.row], _size_of(layout)), 0
        arrays = {}
        for name, dtype, shape, _ in layout:
            size = math.prod(shape)
            arrays[name] = np.frombuffer(raw, dtype, size, at).reshape(shape)
            at += 8 * size
        return StoredRecord(
            identity=entry.identity,
            attributes=self.attributes(entry),
            arrays=arrays,
            axes={name: tuple(axes) for name, _, _, axes in layout},
        )

    def read_input(self, digest: str) -> NDArray[Any] | None:
        """As :meth:`fvi_cli.storage.records.record.RecordSource.read_input`."""
        if digest not in self.inputs:
            return None
        at, dtype, shape = self.inputs[digest]
        return np.frombuffer(self._bytes(at, 8 * math.prod(shape)), dtype).reshape(shape)

    def _opened(self) -> FileIO:
        if self._file is None:
            raise StorageError(
                f"{self.path}: was removed while it was in use; run the command again"
            )
        return self._file

    def _bytes(self, at: int, count: int) -> bytearray:
        file = self._opened()
        file.seek(at)
        found = bytearray()
        while len(found) < count and (more := file.read(count - len(found))):
            found += more
        return found

    def sync(self) -> None:
        """Flush to the disk, so that appended runs survive a loss of power."""
        if self._file is not None:
            os.fsync(self._file.fileno())
            self._synced = time.monotonic()

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
        self._file = None

    def remove(self) -> None:
        """Remove the journal, whose runs are in the result file."""
        self.close()
        with explain_os_error(self.path):
            self.path.unlink(missing_ok=True)
        self.entries, self.inputs, self._end = [], {}, 0
        self._heads.clear()


def _size_of(layout: Layout) -> int:
    """Bytes of the arrays of a run."""
    return sum(8 * math.prod(shape) for _, _, shape, _ in layout)
