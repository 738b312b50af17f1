"""Groups and attributes of HDF5 in which every byte has a checksum.

Datasets have fletcher32, headers of objects the checksums of the file format 1.10. Text is of fixed
length, since texts of variable length lie in HDF5's global heap, which has no checksum. The
low-level interface of h5py is three times as fast as the usual one.
"""

from __future__ import annotations

import contextlib
import functools
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5g, h5p, h5s, h5t
from numpy.typing import NDArray

from fvi_cli.errors import StorageError
from fvi_cli.storage.files import reason

CREATOR: Final = "fvi-cli"
FORMAT: Final = 5
"""Number of the file format; a program reads files of its own number."""
LIBVER: Final = ("v110", "v110")
"""From this format on every index of chunks has a checksum."""
CHUNK_BYTES: Final = 2**19

LINKS: Final = h5p.create(h5p.LINK_CREATE)
LINKS.set_create_intermediate_group(True)
_GROUP = h5p.create(h5p.GROUP_CREATE)
# all attributes in the header of the object, which has a checksum
_GROUP.set_attr_phase_change(65535, 0)
# quantities keep the order of the configuration
_GROUP.set_link_creation_order(h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED)

SCALE_ATTRIBUTES: Final = (b"DIMENSION_LIST", b"REFERENCE_LIST", b"CLASS", b"NAME")
"""Attributes by which HDF5 attaches dimension scales."""

_FLOAT: Final = np.dtype("<f8")
_READ_ERRORS = (OSError, LookupError, ValueError, TypeError, RuntimeError)
"""What h5py raises for damaged bytes."""

OTHER_VERSION: Final = (
    "{path}: is of fvi {version}; keep it for that version, or choose another folder with --output "
    "and run again"
)


Source = Path | bytes
"""A file, or the content of one in memory."""


class DamagedFileError(StorageError):
    """HDF5 cannot read a part of a file, or finds a wrong checksum in it."""

    def __init__(self, path: Source, part: str, error: BaseException) -> None:
        if isinstance(path, Path) and not h5py.is_hdf5(path):
            message = (
                "is no result file of fvi (not HDF5, or cut off); move it away, or choose another "
                "name or --output"
            )
        else:
            message = (
                f"HDF5 cannot read {part}: {' '.join(str(error).split())}; runs in other parts are "
                "whole; move the file away, and its runs are computed again"
            )
        super().__init__(f"{_name_of(path)}: {message}")
        self.path = path


@contextlib.contextmanager
def opened(source: Source, part: str = "it") -> Iterator[h5py.File]:
    """Open a result file, or the content of one, for reading.

    Raises
    ------
    DamagedFileError
        Where HDF5 cannot read it; `part` names what is read.
    StorageError
        For files that this version has not written.
    """
    if isinstance(source, Path) and source.is_dir():
        raise StorageError(f"{source}: is a folder, not a result file")
    try:
        with h5py.File(io.BytesIO(source) if isinstance(source, bytes) else source) as file:
            _refuse_strangers(file, source)
            yield file
    except _READ_ERRORS as error:
        if isinstance(error, PermissionError):
            raise StorageError(f"{_name_of(source)}: cannot be read: {reason(error)}") from None
        raise DamagedFileError(source, part, error) from error


def _refuse_strangers(file: h5py.File, source: Source) -> None:
    root = {name: file.attrs[name] for name in file.attrs if name in ("creator", "format")}
    if root.get("creator") not in (CREATOR, CREATOR.encode()) or "format" not in root:
        raise StorageError(
            f"{_name_of(source)}: was not written by fvi; it is left as it is: move it away, or "
            "choose another name or --output"
        )
    if root["format"] != FORMAT:
        version = file.attrs.get("fvi_version", "another version")
        raise StorageError(OTHER_VERSION.format(path=_name_of(source), version=version))


def _name_of(source: Source) -> str:
    return "results in memory" if isinstance(source, bytes) else str(source)


class NewGroup:
    """A group that is being written; each dataset has its axes, and each axis numbers."""

    def __init__(self, file: h5py.File, path: str) -> None:
        self.id = h5g.create(file.id, path.encode(), LINKS, _GROUP)
        self._sets: dict[str, h5d.DatasetID] = {}
        self._axes: dict[str, tuple[str, ...]] = {}

    def add(
        self, name: str, axes: tuple[str, ...], values: NDArray[Any], **attributes: Any
    ) -> None:
        """Write an array of numbers or bytes, and attributes of it."""
        self.create(name, axes, values.shape, values.dtype, **attributes)
        self.write(name, values)

    def create(
        self,
        name: str,
        axes: tuple[str, ...],
        shape: tuple[int, ...],
        dtype: Any = _FLOAT,
        **attributes: Any,
    ) -> None:
        """Create a dataset that is written later; and numbers for an axis that has no values."""
        for axis, size in zip(axes, shape, strict=True):
            if axis != name and axis not in self._sets:
                self.add(axis, (axis,), np.arange(size, dtype="<i8"))
        space = h5s.create_simple(shape)
        layout = _layout(shape, dtype.itemsize, is_text=dtype.kind == "S")
        self._sets[name] = h5d.create(self.id, name.encode(), _type(dtype), space, layout, LINKS)
        self._axes[name] = axes
        write_attributes(self._sets[name], attributes)

    def write(self, name: str, values: NDArray[Any], start: int | None = None) -> None:
        """Write a dataset, or from `start` on some rows of it."""
        if not values.size:
            return
        values, node, kind = np.ascontiguousarray(values), self._sets[name], _type(values.dtype)
        if start is None:
            node.write(h5s.ALL, h5s.ALL, values, mtype=kind)
            return
        space = node.get_space()
        space.select_hyperslab((start, *(0,) * (values.ndim - 1)), values.shape)
        node.write(h5s.create_simple(values.shape), space, values, mtype=kind)

    def attach_scales(self) -> None:
        """Attach the dimension scales, by which netCDF knows the axes."""
        attach_scales(self.id, self._axes)


def attach_scales(group: h5g.GroupID, axes: Mapping[str, tuple[str, ...]]) -> None:
    """Attach dimension scales to datasets, anew if they are copies: HDF5 copies no references."""
    sets = {name: h5d.open(group, name.encode()) for name in axes}
    for node in sets.values():
        for attribute in SCALE_ATTRIBUTES:
            if h5a.exists(node, attribute):
                h5a.delete(node, attribute)
    for axis in dict.fromkeys(axis for own in axes.values() for axis in own):
        h5ds.set_scale(sets[axis], axis.rpartition("/")[2].encode())
    for name, own in axes.items():
        if own != (name,):
            for number, axis in enumerate(own):
                h5ds.attach_scale(sets[name], sets[axis], number)


@functools.lru_cache(maxsize=1024)
def _layout(shape: tuple[int, ...], item: int, *, is_text: bool) -> h5p.PropDCID:
    """Chunks with a checksum; small data is one chunk."""
    found = h5p.create(h5p.DATASET_CREATE)
    found.set_attr_phase_change(65535, 0)
    found.set_obj_track_times(False)
    if not all(shape):
        return found
    chunk = list(shape)
    for axis in range(len(chunk)):
        inner = item * int(np.prod(chunk[axis + 1 :]))
        chunk[axis] = max(1, min(chunk[axis], CHUNK_BYTES // inner))
    found.set_chunk(tuple(chunk))
    if is_text and item * shape[0] > 256:
        found.set_deflate(1)
    found.set_fletcher32()
    return found


@functools.lru_cache(maxsize=1024)
def _type(dtype: Any) -> Any:
    """The type in the file; text is UTF-8 of fixed length."""
    if dtype.kind != "S":
        return h5t.py_create(dtype, logical=True)
    kind = h5t.C_S1.copy()
    kind.set_size(max(dtype.itemsize, 1))
    kind.set_cset(h5t.CSET_UTF8)
    kind.set_strpad(h5t.STR_NULLPAD)
    return kind


def write_attributes(node: Any, attributes: Mapping[str, Any]) -> None:
    """Write new attributes: text of fixed length, numbers and lists of numbers."""
    for name, value in attributes.items():
        if isinstance(value, str):
            data = np.array(value.encode(), dtype="S")
        else:
            data = np.asarray(value)
            data = data.astype("<i8" if data.dtype.kind in "iub" else "<f8")
        kind = _type(data.dtype)
        space = h5s.create_simple(data.shape) if data.ndim else h5s.create(h5s.SCALAR)
        h5a.create(node, name.encode(), kind, space).write(data, mtype=kind)


def read_attributes(node: Any, names: Sequence[str] = ()) -> dict[str, Any]:
    """Some attributes of an object, or all that are of the types which this program writes."""
    found: dict[str, Any] = {}
    wanted = [name.encode() for name in names]
    if not wanted:
        h5a.iterate(node, lambda name: wanted.append(name))
    for name in wanted:
        one = h5a.open(node, name)
        kind = one.get_type()
        form = kind.get_class()
        if form == h5t.STRING and not kind.is_variable_str():
            held = np.empty(one.shape, dtype=f"S{kind.get_size()}")
        elif form in (h5t.FLOAT, h5t.INTEGER):
            held = np.empty(one.shape, dtype=one.dtype)
        else:
            continue
        one.read(held, mtype=kind)
        value = held.tolist()
        found[name.decode()] = value.decode() if isinstance(value, bytes) else value
    return found


def copy_attributes(source: Any, target: Any) -> None:
    """Copy the attributes that the target does not have, such as those of other programs."""
    for name in source.attrs:
        if name not in target.attrs and name.encode() not in SCALE_ATTRIBUTES:
            target.attrs[name] = source.attrs[name]


def children(group: h5py.Group) -> Iterator[tuple[str, Any]]:
    """Names and members of a group; a damaged one raises (for ``items()`` it would be None)."""
    return ((name, group[name]) for name in group)


def datasets(group: h5py.Group, above: str = "") -> Iterator[tuple[str, h5py.Dataset]]:
    """All datasets below a group with their paths."""
    for name, node in children(group):
        if isinstance(node, h5py.Group):
            yield from datasets(node, f"{above}{name}/")
        else:
            yield f"{above}{name}", node
