"""Groups and attributes of HDF5 in which every byte has a checksum.

Datasets have fletcher32, headers of objects the checksums of the file format 1.10. Text is of fixed
length, since texts of variable length lie in HDF5's global heap, which has no checksum.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from h5py import h5a, h5ds, h5g, h5p, h5t
from numpy.typing import NDArray

from fvi_cli.errors import StorageError

CREATOR: Final = "fvi-cli"
FORMAT: Final = 6
"""Number of the file format; a program reads files of its own number."""
LIBVER: Final = ("v110", "v110")
"""From this format on every index of chunks has a checksum."""
CHUNK_BYTES: Final = 2**19
LEAST_ROWS, LEAST_BYTES = 64, 4096
"""Datasets that grow have chunks of so many rows or more, up to so many bytes."""
FILL: Final[Mapping[str, Any]] = {"f": math.nan, "i": -1}
"""Values of members that lack what others have, by the kind of the numbers."""

PLAIN_AXES: Final = ("row", "column", "layer")
"""Axes of arrays that belong to no run."""

LINKS: Final = h5p.create(h5p.LINK_CREATE)
LINKS.set_create_intermediate_group(True)
_GROUP = h5p.create(h5p.GROUP_CREATE)
# all attributes in the header of the object, which has a checksum
_GROUP.set_attr_phase_change(65535, 0)
# quantities keep the order of the configuration
_GROUP.set_link_creation_order(h5p.CRT_ORDER_TRACKED | h5p.CRT_ORDER_INDEXED)

SCALE_ATTRIBUTES: Final = (b"DIMENSION_LIST", b"REFERENCE_LIST", b"CLASS", b"NAME")
"""Attributes by which HDF5 attaches dimension scales."""

_READ_ERRORS = (OSError, LookupError, ValueError, TypeError, RuntimeError)
"""What h5py raises for damaged bytes."""

OTHER_VERSION: Final = (
    "{path}: is of fvi {version}; keep it for that version, or choose another folder with --output "
    "and run again"
)

STRANGER: Final = (
    "{path}: is no result file of fvi; it is left as it is: move it away, or choose another name "
    "or --output"
)

Source = Path | io.BytesIO
"""A file, or one in memory."""


@contextlib.contextmanager
def opened(source: Source) -> Iterator[h5py.File]:
    """Open a result file for reading.

    Raises
    ------
    StorageError
        Where HDF5 cannot read it, and for files that this version has not written.
    """
    with damage_named(source, "it"), h5py.File(source) as file:
        _refuse_strangers(file, source)
        yield file


@contextlib.contextmanager
def damage_named(source: Source, part: str) -> Iterator[None]:
    """Name the part of a file that HDF5 cannot read."""
    try:
        yield
    except FileNotFoundError:
        raise
    except _READ_ERRORS as error:
        if isinstance(source, Path) and not h5py.is_hdf5(source):
            raise StorageError(STRANGER.format(path=source)) from error
        raise StorageError(
            f"{source}: HDF5 cannot read {part}: {' '.join(str(error).split())}; runs in "
            "other parts are whole; move the file away, and its runs are computed again"
        ) from error


def _refuse_strangers(file: h5py.File, source: Source) -> None:
    creator, number = file.attrs.get("creator"), file.attrs.get("format")
    if creator not in (CREATOR, CREATOR.encode()) or number is None:
        raise StorageError(STRANGER.format(path=source))
    if number != FORMAT:
        version = file.attrs.get("fvi_version", "another version")
        version = version.decode() if isinstance(version, bytes) else version
        raise StorageError(OTHER_VERSION.format(path=source, version=version))


def make_group(file: h5py.File, path: str) -> h5py.Group:
    """A group of a file, which is made where it is missing."""
    if path in file:
        return file[path]
    return h5py.Group(h5g.create(file.id, path.encode(), LINKS, _GROUP))


def put(
    group: h5py.Group,
    name: str,
    values: NDArray[Any],
    rows: Sequence[int] | None = None,
    *,
    grows: bool = False,
) -> None:
    """Write a dataset, or some `rows` of one that grows; it is made where it is missing.

    Rows that nobody has written hold nan, -1 or an empty text.
    """
    shape = values.shape if rows is None else (max(rows) + 1, *values.shape[1:])
    if name not in group:
        _create(group, name, shape, values.dtype, grows=grows)
    node = _fitting(group, name, shape, values.dtype)
    if values.dtype.kind == "S":
        # HDF5 converts no text without the name of its encoding
        values = values.astype(f"S{node.dtype.itemsize}").view(node.dtype)
    if rows is None:
        node[...] = values
        return
    ends = [k for k in range(1, len(rows)) if rows[k] != rows[k - 1] + 1]
    for first, last in zip([0, *ends], [*ends, len(rows)], strict=True):
        node[rows[first] : rows[last - 1] + 1] = values[first:last]


def _create(
    group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, *, grows: bool
) -> h5py.Dataset:
    """A dataset in chunks with a checksum; small data is one chunk."""
    options: dict[str, Any] = {"maxshape": (None,) * len(shape)} if grows else {}
    if grows or all(shape):
        chunk = [max(1, size) for size in shape]
        for axis in reversed(range(len(chunk))):
            inner = dtype.itemsize * math.prod(chunk[axis + 1 :])
            least = min(LEAST_ROWS, LEAST_BYTES // inner) if grows and axis == 0 else 1
            chunk[axis] = max(1, least, min(chunk[axis], CHUNK_BYTES // inner))
        options |= {"chunks": tuple(chunk), "fletcher32": True}
    if dtype.kind == "S":
        options |= {"compression": "gzip"} if dtype.itemsize * shape[0] > 256 else {}
        dtype = h5py.string_dtype("utf-8", dtype.itemsize)
    fill = FILL.get(dtype.kind)
    return group.create_dataset(name, shape, dtype, fillvalue=fill, track_times=False, **options)


def _fitting(group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any) -> h5py.Dataset:
    """A dataset that holds such values; one of other numbers or longer texts is made anew."""
    node = group[name]
    size = tuple(map(max, node.shape, shape))
    needed = np.result_type(node.dtype, dtype)
    if needed == node.dtype:
        if size != node.shape:
            node.resize(size)
        return node
    values = node[()]
    del group[name]
    new = _create(group, name, size, needed, grows=True)
    # also those of other programs
    for attribute in node.attrs:
        if attribute.encode() not in SCALE_ATTRIBUTES:
            new.attrs[attribute] = node.attrs[attribute]
    put(group, name, values.astype(needed), range(len(values)))
    return new


def attach_scales(
    group: h5py.Group, axes: Mapping[str, tuple[str, ...]], *, grows: bool = False
) -> None:
    """Attach dimension scales to datasets, by which netCDF knows their axes.

    An axis that has no values gets numbers.
    """
    for name, own in axes.items():
        for axis, size in zip(own, group[name].shape, strict=True):
            if axis not in axes:
                put(group, axis, np.arange(size, dtype="<i8"), grows=grows)
    scales = dict.fromkeys(axis for own in axes.values() for axis in own)
    nodes = {name: group[name].id for name in (*axes, *scales)}
    for node in nodes.values():
        for attribute in SCALE_ATTRIBUTES:
            if h5a.exists(node, attribute):
                h5a.delete(node, attribute)
    for axis in scales:
        h5ds.set_scale(nodes[axis], axis.rpartition("/")[2].encode())
    for name, own in axes.items():
        if own != (name,):
            for number, axis in enumerate(own):
                h5ds.attach_scale(nodes[name], nodes[axis], number)


def as_text(value: Any) -> str:
    """A text as it is, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def write_attributes(node: h5py.HLObject, attributes: Mapping[str, Any]) -> None:
    """Write attributes: text of fixed length, and numbers."""
    for name, value in attributes.items():
        if isinstance(value, str | list | tuple | Mapping):
            text = as_text(value).encode()
            kind = h5py.string_dtype("utf-8", max(1, len(text)))
            node.attrs.create(name, np.bytes_(text), dtype=kind)
        else:
            node.attrs[name] = value


def read_attributes(node: h5py.HLObject, *names: str) -> dict[str, Any]:
    """Some attributes of an object, or all that are of the types which this program writes."""
    found: dict[str, Any] = {}
    wanted = [name.encode() for name in names]
    if not wanted:
        h5a.iterate(node.id, lambda name: wanted.append(name))
    for name in wanted:
        # h5py's own interface takes twice the time
        one = h5a.open(node.id, name)
        kind = one.get_type()
        form, size = kind.get_class(), one.get_storage_size()
        is_text = form == h5t.STRING and not kind.is_variable_str()
        if not (is_text or form in (h5t.FLOAT, h5t.INTEGER)) or kind.get_size() != size:
            continue
        held = np.empty((), dtype=f"S{size}" if is_text else kind.dtype)
        one.read(held, mtype=kind)
        value = held.item()
        found[name.decode()] = value.decode() if isinstance(value, bytes) else value
    return found


def children(group: h5py.Group) -> Iterator[tuple[str, Any]]:
    """Names and members of a group; a damaged one raises (for ``items()`` it would be None)."""
    return ((name, group[name]) for name in group)


def datasets(group: h5py.Group) -> Iterator[tuple[str, h5py.Dataset]]:
    """All datasets below a group with their paths."""
    for name, node in children(group):
        if isinstance(node, h5py.Group):
            yield from ((f"{name}/{path}", one) for path, one in datasets(node))
        else:
            yield name, node


# --- groups without runs --------------------------------------------------------------------------


def write_root(file: h5py.File, origin: Mapping[str, str]) -> None:
    """Write the attributes of the root by which a result file is known."""
    write_attributes(file, {"creator": CREATOR, "format": FORMAT, **origin})


def write_plain(file: h5py.File, path: str, arrays: Mapping[str, str | NDArray[Any]]) -> None:
    """Write arrays and texts of any length into a group."""
    group, axes = make_group(file, path), {}
    for name, one in arrays.items():
        values = np.array([one.encode()], dtype="S") if isinstance(one, str) else one
        put(group, name, values)
        axes[name] = PLAIN_AXES[: values.ndim]
    attach_scales(group, axes)


def read_plain(file: h5py.File, above: str) -> dict[str, dict[str, Any]]:
    """The arrays and texts of the groups below a path, by the paths of the groups."""
    found: dict[str, dict[str, Any]] = defaultdict(dict)
    for path, node in datasets(file[above]) if above in file else ():
        group, _, name = f"{above}/{path}".rpartition("/")
        if name not in PLAIN_AXES:
            values = node[()]
            found[group][name] = values[0].decode() if values.dtype.kind == "S" else values
    return found
