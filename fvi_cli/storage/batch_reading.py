"""Members of stored sweeps one by one, read in blocks."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from fvi_cli.storage.batch_records import (
    MEMBER,
    Block,
    Columns,
    block_of,
    read_columns,
    read_rows,
)
from fvi_cli.storage.files import reading
from fvi_cli.storage.records import Record

BLOCK_BYTES = 2**25
"""Trajectories that are read at a time."""

BLOCKS_KEPT = 2

Row = tuple[Path, str, int]
"""File, path of the group, and number of a member in it."""


def rows_at_a_time(group: h5py.Group) -> int:
    """How many members of a group are read at a time."""
    count = max(1, int(group[MEMBER].shape[0]))
    size = sum(dataset.nbytes for dataset in group.values())
    return max(1, min(count, BLOCK_BYTES * count // max(int(size), 1)))


@dataclass(kw_only=True, eq=False)
class MemberReader:
    """Reads members of sweeps; remembers the last blocks, for they are asked for in order."""

    _columns: dict[tuple[Path, str], Columns] = field(default_factory=dict)
    _blocks: OrderedDict[Row, list[Record]] = field(default_factory=OrderedDict)
    _sizes: dict[tuple[Path, str], int] = field(default_factory=dict)

    def record(self, row: Row) -> Record:
        """A member as it was written.

        Raises
        ------
        StorageError
            If the file cannot be read or is damaged.
        """
        file, path, number = row
        size = self._sizes.get((file, path), 0)
        if size:
            block = self._blocks.get((file, path, number // size))
            if block is not None:
                return block[number % size]
        with reading(file) as opened:
            group = opened[path]
            columns = self._columns_of(file, group)
            size = self._sizes.setdefault((file, path), rows_at_a_time(group))
            start = number // size * size
            stop = min(start + size, group[MEMBER].shape[0])
            records = read_rows(group, columns, start, stop)
        self._blocks[file, path, number // size] = records
        while len(self._blocks) > BLOCKS_KEPT:
            self._blocks.popitem(last=False)
        return records[number - start]

    def attributes(self, row: Row) -> dict[str, Any]:
        """What is said of a member.

        Raises
        ------
        StorageError
            As :meth:`record`.
        """
        file, path, number = row
        if (file, path) not in self._columns:
            with reading(file) as opened:
                self._columns_of(file, opened[path])
        return {name: values[number] for name, values in self._columns[file, path].items()}

    def columns(self, rows: Sequence[Row]) -> Columns:
        """The attributes of some members, which may lie in several groups."""
        found = [self.attributes(row) for row in rows]
        names = dict.fromkeys(name for one in found for name in one)
        return {name: [one.get(name, "") for one in found] for name in names}

    def blocks(self, rows: Sequence[Row]) -> Iterator[Block]:
        """The trajectories of some members, a block in memory at a time."""
        waiting: list[Record] = []
        start = size = 0
        for row in rows:
            record = self.record(row)
            waiting.append(record)
            size += sum(values.nbytes for values in record.datasets.values())
            if size >= BLOCK_BYTES:
                yield block_of(waiting, start)
                start, size, waiting = start + len(waiting), 0, []
        if waiting:
            yield block_of(waiting, start)

    def forget(self) -> None:
        """Let go of everything: files have been replaced."""
        self._columns.clear()
        self._blocks.clear()
        self._sizes.clear()

    def _columns_of(self, file: Path, group: h5py.Group) -> Columns:
        if (file, group.name) not in self._columns:
            self._columns[file, group.name] = read_columns(group)
        return self._columns[file, group.name]
