"""A run, or the members of a sweep in common arrays, as a group that netCDF readers understand.

Values that all runs of a group share are attributes. Values in which members differ are datasets
along ``member``, which is also the first axis of their arrays; nan fills the ends of shorter
motions, ``points`` has their lengths.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5a, h5g, h5o
from numpy.typing import NDArray

from fvi_cli.storage.columns import FILL, Column, Rows, are_equal, joined
from fvi_cli.storage.fields import AXES, OCCURRENCE, axes_of, meaning_of
from fvi_cli.storage.hdf5 import (
    LINKS,
    NewGroup,
    Source,
    attach_scales,
    copy_attributes,
    datasets,
    opened,
    read_attributes,
    write_attributes,
)

MEMBER: Final = "member"
SWEPT: Final = "swept"
BLOCK_BYTES: Final = 2**24
"""Arrays of members are read and written in blocks of so many bytes."""

Piece = tuple[Rows, int, int]
"""Runs, and the first and the last (exclusive) that are meant."""


class GroupRows(Rows):
    """Runs in a group of a file, which is opened only while arrays are read."""

    def __init__(self, group: h5py.Group, source: Source, *, is_whole: bool = True) -> None:
        # for a single run that is copied as a whole these two suffice
        is_brief = not is_whole and h5a.exists(group.id, b"identity")
        common = read_attributes(group.id, ("identity", "variant") if is_brief else ())
        super().__init__(common=common, keys=tuple(json.loads(common.pop(SWEPT, "[]"))))
        self.source, self.path = source, str(group.name)
        for name, node in datasets(group):
            if axes_of(name):
                self.shapes[name] = node.shape
            elif self.keys and name not in (MEMBER, *AXES) and OCCURRENCE not in name:
                is_json, has_fill = "encoding" in node.attrs, "_FillValue" in node.attrs
                self.columns[name] = Column(node[()], is_json, has_fill)
        if self.keys:
            self.count = len(self.columns["identity"].data)
            for name, shape in self.shapes.items():
                self.shapes[name] = shape if self.is_shared(name) else shape[1:]

    def arrays(self, first: int, last: int) -> dict[str, NDArray[Any]]:
        """As :meth:`Rows.arrays`."""
        with opened(self.source, self.path) as file:
            return self.arrays_in(file, first, last)

    def arrays_in(
        self, file: h5py.File, first: int, last: int, *, motions: bool = True
    ) -> dict[str, NDArray[Any]]:
        """The same of an open file; without motions the arrays of events alone."""
        group = file[self.path]
        return {
            name: group[name][()] if self.is_shared(name) else _rows(group[name], first, last)
            for name in self.shapes
            if motions or name.startswith("events/")
        }

    def copy_to(self, file: h5py.File, path: str) -> bool:
        """As :meth:`Rows.copy_to`, with attributes of other programs and dimension scales."""
        with opened(self.source, self.path) as own:
            group, axes = own[self.path], {}
            for name, node in datasets(group):
                # HDF5 copies chunks as they are: damage in them must be seen here
                step = max(1, BLOCK_BYTES // max(node.nbytes // max(len(node), 1), 1))
                for start in range(0, len(node), step):
                    node[start : start + step]
                axes[name] = (MEMBER,) if name in self.columns else axes_of(name) or (name,)
                if name in self.shapes and not self.is_shared(name):
                    axes[name] = (MEMBER, *axes[name])
            h5o.copy(group.id, b".", file.id, path.encode(), lcpl=LINKS)
        attach_scales(h5g.open(file.id, path.encode()), axes)
        return True


def _rows(node: h5py.Dataset, first: int, last: int) -> NDArray[Any]:
    return np.asarray(node[()] if (first, last) == (0, len(node)) else node[first:last])


def rows_in_block(rows: Rows, shapes: Mapping[str, tuple[int, ...]]) -> int:
    """How many runs with arrays of these shapes are read or written at once."""
    own = sum(8 * int(np.prod(one)) for name, one in shapes.items() if not rows.is_shared(name))
    return max(1, BLOCK_BYTES // max(own, 1))


def write_group(
    file: h5py.File, path: str, pieces: Sequence[Piece], *, has_scales: bool = True
) -> None:
    """Write runs to a new group, few of them in memory at a time."""
    rows, begin, last = pieces[0]
    if len(pieces) == 1 and (begin, last) == (0, rows.count) and rows.copy_to(file, path):
        return
    new, count = NewGroup(file, path), sum(last - begin for _, begin, last in pieces)
    common, columns = _merged(pieces)
    shapes: dict[str, tuple[int, ...]] = {}
    for one, _, _ in pieces:
        for name, shape in one.shapes.items():
            shapes[name] = tuple(map(max, shapes.get(name, (0,) * len(shape)), shape))
    if rows.keys:
        new.add(MEMBER, (MEMBER,), np.arange(count, dtype="<i8"))
        common[SWEPT] = json.dumps(rows.keys)
    for name, column in columns.items():
        attributes: dict[str, Any] = {"long_name": meaning_of(name)}
        attributes |= {"encoding": "json"} if column.is_json else {}
        attributes |= {"_FillValue": FILL[column.data.dtype.kind]} if column.has_fill else {}
        new.add(name, (MEMBER,), column.data, **attributes)
    # axes with values before the arrays along them
    for name in sorted(shapes, key=lambda one: axes_of(one) != (one,)):
        axes, shape = axes_of(name), shapes[name]
        if not rows.is_shared(name):
            axes, shape = (MEMBER, *axes), (count, *shape)
        new.create(name, axes, shape, long_name=meaning_of(name))
    for start, block in _blocks(pieces, shapes):
        for name, values in block.items():
            new.write(name, values, None if rows.is_shared(name) else start)
    write_attributes(new.id, common)
    if isinstance(rows, GroupRows):
        with opened(rows.source, rows.path) as own:
            copy_attributes(own[rows.path], file[path])
    if has_scales:
        new.attach_scales()


def _merged(pieces: Sequence[Piece]) -> tuple[dict[str, Any], dict[str, Column]]:
    """Values that all runs share, and columns of the others."""
    common: dict[str, Any] = {}
    columns: dict[str, Column] = {}
    for name in dict.fromkeys(n for rows, _, _ in pieces for n in (*rows.common, *rows.columns)):
        values = [rows.common.get(name) for rows, _, _ in pieces]
        if not any(name in rows.columns for rows, _, _ in pieces) and are_equal(values):
            common[name] = values[0]
        else:
            columns[name] = joined([rows.piece(name, *span) for rows, *span in pieces])
    return common, columns


def _blocks(
    pieces: Sequence[Piece], shapes: Mapping[str, tuple[int, ...]]
) -> Iterator[tuple[int, dict[str, NDArray[Any]]]]:
    """Number of the first run, and the arrays, of blocks of limited size; then shared arrays."""
    rows = pieces[0][0]
    if not rows.keys:
        yield 0, rows.arrays(0, 1)
        return
    own = {name: shape for name, shape in shapes.items() if not rows.is_shared(name)}
    most = rows_in_block(rows, shapes)
    total = sum(last - begin for _, begin, last in pieces)
    shared: dict[str, NDArray[Any]] = {}
    start = filled = size = 0
    held: dict[str, NDArray[Any]] = {}
    for rows, begin, last in pieces:
        while begin < last:
            if filled == size:
                start, filled, size = start + filled, 0, min(most, total - start - filled)
                held = {name: np.full((size, *shape), np.nan) for name, shape in own.items()}
            count = min(last - begin, size - filled)
            for name, values in rows.arrays(begin, begin + count).items():
                if rows.is_shared(name):
                    shared[name] = max(shared.get(name, values), values, key=len)
                else:
                    inner = tuple(slice(n) for n in values.shape[1:])
                    held[name][(slice(filled, filled + count), *inner)] = values
            filled, begin = filled + count, begin + count
            if filled == size:
                yield start, held
    yield 0, shared
