"""Matrices in file formats of NumPy and MATLAB, unpacked within limits.

Numeric and sparse arrays in MATLAB's files of the versions 5 to 7 (MathWorks, *MAT-File Format*,
level 5) are read here, not by SciPy: its compiled reader trusts types and lengths, and a wrong one
crashes the process.
"""

from __future__ import annotations

import io
import itertools
import math
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import ArgumentError
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import DataFileError
from fvi_cli.scenes.structures.declared import (
    LARGEST_ARRAY,
    DeclaredError,
    check_rows,
    checked_sparse,
    sparse_matrix,
)

HEADER: Final = 128
_MATRIX: Final = 14
_COMPRESSED: Final = 15
_CLASSES: Final = (
    *("", "cell", "struct", "object", "char", "sparse", "double", "single"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    *("function", "opaque"),
)
_NUMBERS: Final = _CLASSES[5:16]
_TYPES: Final = MappingProxyType(
    {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
)
_LOGICAL, _COMPLEX = 1 << 9, 1 << 11


@dataclass(frozen=True, kw_only=True, eq=False)
class _MatVariable:
    """A variable of a file; at first only its head is read."""

    name: str
    kind: str  # its class, ``double``, ``sparse``, ``cell``
    shape: tuple[int, ...]
    is_complex: bool
    parts: Iterator[NDArray[Any]]  # its arrays, read on demand

    def value(self) -> Any:
        """The matrix, dense or sparse."""
        if self.kind not in _NUMBERS:
            raise ValueError(
                f"{excerpt(self.name)} is {self.kind}; it must be a matrix of real numbers"
            )
        parts = list(self.parts)
        if self.kind != "sparse":
            values = self._with_imaginary(parts)
            if values.size != math.prod(self.shape) or min(self.shape, default=-1) < 0:
                raise ValueError(f"{values.size} entries for {' x '.join(map(str, self.shape))}")
            return values.reshape(self.shape, order="F")
        check_rows(self.shape, sparse=True)
        if len(parts) < 3:
            raise ValueError("a sparse matrix without its entries")
        rows, ends, data = *parts[:2], self._with_imaginary(parts[2:])
        # ignore space that was reserved for more entries
        count = int(ends[-1]) if ends.size else 0
        if not 0 <= count <= min(rows.size, data.size):
            raise ValueError(f"{count} entries are declared, {data.size} are there")
        held = {"indices": rows[:count], "indptr": ends, "data": data[:count]}
        return sparse_matrix("csc", self.shape, held)

    def _with_imaginary(self, parts: list[NDArray[Any]]) -> NDArray[Any]:
        """The entries, complex where there is an imaginary part."""
        if len(parts) != 1 + self.is_complex:
            raise ValueError(f"{len(parts)} parts where there must be {1 + self.is_complex}")
        if not self.is_complex:
            return parts[0]
        if parts[0].size != parts[1].size:
            raise ValueError("real and imaginary parts of different lengths")
        return parts[0] + 1j * parts[1]


def read_mat(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of a ``.mat`` file up to MATLAB's version 7."""
    if len(content) < HEADER or 0 in content[:4]:
        return _mat_4(content, name, variable)
    order, version = ("<", 125) if content[126:128] == b"IM" else (">", 124)
    if content[version] != 1:
        raise DataFileError(
            f"{name}: not a .mat file, or one of MATLAB 7.3; save it with -v7, or as Matrix Market"
        )
    variables = [_variable(data, order) for data in _matrices(content, order)]
    # the workspace of functions has no name
    named = [one for one in variables if one.name and not one.name.startswith("__")]
    which = chosen([one.name for one in named], name, variable)
    return next(one.value() for one in named if one.name == which)


def _matrices(content: bytes, order: str) -> Iterator[memoryview]:
    """The elements of a file, unpacked within limits; so no element is larger than declared."""
    size = 0
    for kind, data in _elements(memoryview(content)[HEADER:], order, padded=False):
        if kind == _COMPRESSED:
            unpacking = zlib.decompressobj()
            most = max(LARGEST_ARRAY, 4 * len(content)) - size
            body = unpacking.decompress(data, most + 1)
            size += len(body)
            _check_unpacked(size, len(content))
            if not unpacking.eof or len(body) < 8:
                raise ValueError("a compressed element is cut off")
            # the length in its tag is not trusted
            (kind,), data = struct.unpack_from(f"{order}I", body), memoryview(body)[8:]
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind} where a matrix is needed")
        yield data


def _variable(data: memoryview, order: str) -> _MatVariable:
    parts = (_numbers(kind, part, order) for kind, part in _elements(data, order))
    head = list(itertools.islice(parts, 3))
    if len(head) < 3 or head[0].size < 1 or head[1].size > 32:
        raise ValueError("a variable without flags, dimensions and name")
    flags = int(head[0][0])
    number = flags & 0xFF
    name = _CLASSES[number] if 0 < number < len(_CLASSES) else f"of class {number}"
    return _MatVariable(
        name=head[2].tobytes().decode("latin-1"),
        kind="logical" if flags & _LOGICAL else name,
        shape=tuple(head[1].tolist()),
        is_complex=bool(flags & _COMPLEX),
        parts=parts,
    )


def _elements(
    data: memoryview, order: str, *, padded: bool = True
) -> Iterator[tuple[int, memoryview]]:
    """(Type, bytes) of successive elements."""
    place = 0
    while place + 8 <= len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        begin = place + 8
        if kind >> 16:
            # up to four bytes of data are in the tag itself
            kind, length, begin = kind & 0xFFFF, kind >> 16, place + 4
            place += 8
            if length > 4:
                raise ValueError(f"a short element of {length} bytes")
        else:
            place = begin + length + (-length % 8 if padded else 0)
        if begin + length > len(data):
            raise ValueError(f"{length} bytes are declared, {len(data) - begin} are there")
        yield kind, data[begin : begin + length]


def _numbers(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    """The numbers of an element."""
    if kind not in _TYPES:
        raise ValueError(f"an element of type {kind} where numbers are needed")
    dtype = np.dtype(f"{order}{_TYPES[kind]}")
    if len(data) % dtype.itemsize:
        raise ValueError(f"{len(data)} bytes are not a multiple of {dtype.itemsize} bytes")
    return np.frombuffer(data, dtype=dtype)


def _mat_4(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of a file of MATLAB's version 4, read by SciPy, which uses no compiled code here."""
    from scipy.io import loadmat, whosmat

    known = whosmat(io.BytesIO(content))  # type: ignore[arg-type]
    which = chosen([one[0] for one in known], name, variable)
    shape, kind = next((shape, kind) for found, shape, kind in known if found == which)
    if kind == "sparse":
        check_rows(shape, sparse=True)
    value = loadmat(io.BytesIO(content), variable_names=[which], spmatrix=False)[which]  # type: ignore[arg-type]
    return checked_sparse(value) if kind == "sparse" else np.asarray(value)


_ENDING: Final = ".npy"
_HEADERS: Final = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_KINDS: Final = "biufcSU"
_SPARSE_PARTS: Final = ("data", "indices", "indptr", "row", "col", "offsets")


def read_npy(content: bytes) -> NDArray[Any]:
    """The array of an ``.npy`` file, whose length must agree with its header."""
    stream = io.BytesIO(content)
    version = np.lib.format.read_magic(stream)
    if version not in _HEADERS:
        raise ValueError(f"version {version[0]}.{version[1]} of the format is not known")
    shape, is_by_columns, dtype = _HEADERS[version](stream)
    if dtype.kind not in _KINDS:
        raise ValueError(f"its entries are {excerpt(str(dtype))}; they must be real numbers")
    begin = stream.tell()
    count, there = math.prod(shape), len(content) - begin
    if min(shape, default=0) < 0 or count * dtype.itemsize != there:
        raise ValueError(
            f"{excerpt(' x '.join(map(str, shape)))} entries of {dtype.itemsize} bytes are "
            f"declared, {there} bytes are there"
        )
    if not there:
        return np.zeros(shape if math.prod(max(n, 1) for n in shape) < LARGEST_ARRAY else 0, dtype)
    found = np.frombuffer(content, dtype=dtype, offset=begin)
    return found.reshape(shape, order="F" if is_by_columns else "C")


def read_npz(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of an ``.npz`` file of NumPy, or of ``scipy.sparse.save_npz``."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {one.filename.removesuffix(_ENDING): one for one in archive.infolist()}

        def read(which: str) -> NDArray[Any]:
            if which not in members:
                raise ArgumentError(which, "missing")
            return read_npy(_unpacked_member(archive, members[which], len(content)))

        if variable is None and {"format", "shape", "data"} <= set(members):
            kind = read("format").ravel()[:1].astype("U").tolist()
            shape = read("shape").ravel()
            if shape.dtype.kind not in "iu" or len(shape) != 2:
                raise ArgumentError("shape", "two whole numbers are needed")
            check_rows(shape.tolist(), sparse=True)
            parts = {str(part): read(part) for part in _SPARSE_PARTS if part in members}
            return sparse_matrix(excerpt("".join(kind)), shape.tolist(), parts)
        return read(chosen(list(members), name, variable))


def _unpacked_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, packed: int) -> bytes:
    """The bytes of a file in an archive of `packed` bytes."""
    if member.flag_bits & 1:
        raise ValueError(f"{excerpt(member.filename)} is encrypted")
    # other kinds of compression are unpacked without a limit
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(
            f"{excerpt(member.filename)} is compressed in another way than NumPy does; save it "
            "by numpy.savez or numpy.savez_compressed"
        )
    _check_unpacked(member.file_size, packed)
    return archive.read(member)


def _check_unpacked(size: int, packed: int) -> None:
    """Refuse data that unpack to more bytes than those of a genuine file."""
    most = max(LARGEST_ARRAY, 4 * packed)
    if size > most:
        raise DeclaredError(
            f"it unpacks to more than {most / 1e6:.0f} MB; save the matrix as a sparse one, or "
            "without compression"
        )


def chosen(names: list[str], name: str, variable: str | None) -> str:
    """The name of the requested matrix, or of the only one."""
    if variable is None and len(names) == 1:
        return names[0]
    if variable in names:
        if names.count(variable) > 1:
            raise ValueError(f"{excerpt(variable)} stands in it {names.count(variable)} times")
        return variable
    shown = listed(excerpt(one) for one in names[:10])
    if not names:
        raise DataFileError(f"{name}: it contains no matrix")
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; name one of them under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: has no array called {excerpt(variable)!r}{hint} ({shown})")
