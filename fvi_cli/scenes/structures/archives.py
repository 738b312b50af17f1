"""Matrices in the containers of NumPy and MATLAB, unpacked within limits.

MATLAB's files of the versions 5 to 7 (MathWorks, *MAT-File Format*, level 5) are read here, the
numbers and the sparse ones of them: SciPy's reader is compiled and believes types and lengths, of
which a wrong one ends the process.
"""

from __future__ import annotations

import io
import itertools
import math
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
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
_SPARSE: Final = 5
_CLASSES: Final = (
    *("", "cell", "struct", "object", "char", "sparse", "double", "single"),
    *("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"),
    *("function", "opaque"),
)
_NUMBERS: Final = range(_SPARSE, 16)
_TYPES: Final = MappingProxyType(
    {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
)
_LOGICAL, _COMPLEX = 1 << 9, 1 << 11


@dataclass(frozen=True, kw_only=True, eq=False)
class MatVariable:
    """A variable of a file, of which only the head was read."""

    name: str
    kind: str  # its class, ``double``, ``sparse``, ``cell``
    shape: tuple[int, ...]
    is_complex: bool
    order: str  # ``<`` or ``>``: which byte comes first
    rest: memoryview  # bytes behind the head

    @property
    def is_matrix_of_numbers(self) -> bool:
        """Whether it holds real or complex numbers."""
        return self.kind in [_CLASSES[number] for number in _NUMBERS]

    def value(self) -> Any:
        """The matrix, dense or sparse."""
        places = _places(self.rest, self.order)
        parts = [_numbers(kind, part, self.order) for kind, part, _ in places]
        if self.kind != "sparse":
            values = _with_imaginary(parts, 0, self)
            if values.size != math.prod(self.shape) or min(self.shape, default=-1) < 0:
                raise ValueError(f"{values.size} entries for {' x '.join(map(str, self.shape))}")
            return values.reshape(self.shape, order="F")
        check_rows(self.shape, sparse=True)
        if len(parts) < 3:
            raise ValueError("a sparse matrix without its entries")
        rows, ends, data = parts[0], parts[1], _with_imaginary(parts, 2, self)
        # room that was set aside for more entries is not taken
        count = int(ends[-1]) if ends.size else 0
        if not 0 <= count <= min(rows.size, data.size):
            raise ValueError(f"{count} entries are declared, {data.size} are there")
        held: Mapping[str, NDArray[Any]] = {
            "indices": rows[:count],
            "indptr": ends,
            "data": data[:count],
        }
        return sparse_matrix("csc", self.shape, held)


def mat_variables(plain: bytes) -> list[MatVariable]:
    """The variables of a file whose elements are not compressed."""
    order = "<" if plain[126:128] == b"IM" else ">"
    found = []
    for kind, data, _ in _places(memoryview(plain)[HEADER:], order, padded=False):
        if kind != _MATRIX:
            raise ValueError(f"an element of type {kind} where a matrix is needed")
        variable = _variable(data, order)
        # a workspace of functions has no name
        if variable.name and not variable.name.startswith("__"):
            found.append(variable)
    return found


def _variable(data: memoryview, order: str) -> MatVariable:
    places = list(itertools.islice(_places(data, order), 3))
    head = [_numbers(kind, part, order) for kind, part, _ in places]
    if len(head) < 3 or head[0].size < 1 or head[1].size > 32:
        raise ValueError("a variable without flags, dimensions and name")
    flags = int(head[0][0])
    number = flags & 0xFF
    name = _CLASSES[number] if 0 < number < len(_CLASSES) else f"of class {number}"
    return MatVariable(
        name=head[2].tobytes().decode("latin-1"),
        kind="logical" if flags & _LOGICAL else name,
        shape=tuple(head[1].tolist()),
        is_complex=bool(flags & _COMPLEX),
        order=order,
        rest=data[places[-1][2] :],
    )


def _places(
    data: memoryview, order: str, *, padded: bool = True
) -> Iterator[tuple[int, memoryview, int]]:
    """Types and bytes of elements, one after the other, and where each ends."""
    place = 0
    while place + 8 <= len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        begin = place + 8
        if kind >> 16:
            # up to four bytes stand in the tag itself
            kind, length, begin = kind & 0xFFFF, kind >> 16, place + 4
            place += 8
            if length > 4:
                raise ValueError(f"a short element of {length} bytes")
        else:
            place = begin + length + (-length % 8 if padded else 0)
        if begin + length > len(data):
            raise ValueError(f"{length} bytes are declared, {len(data) - begin} are there")
        yield kind, data[begin : begin + length], place


def _numbers(kind: int, data: memoryview, order: str) -> NDArray[Any]:
    """The numbers of an element."""
    if kind not in _TYPES:
        raise ValueError(f"an element of type {kind} where numbers are needed")
    dtype = np.dtype(f"{order}{_TYPES[kind]}")
    if len(data) % dtype.itemsize:
        raise ValueError(f"{len(data)} bytes are not a multiple of {dtype.itemsize} bytes")
    return np.frombuffer(data, dtype=dtype)


def _with_imaginary(parts: list[NDArray[Any]], index: int, of: MatVariable) -> NDArray[Any]:
    """The entries, complex where there is an imaginary part."""
    wanted = index + 1 + of.is_complex
    if len(parts) != wanted:
        raise ValueError(f"{len(parts)} parts where there must be {wanted}")
    if not of.is_complex:
        return parts[index]
    if parts[index].size != parts[index + 1].size:
        raise ValueError("real and imaginary parts of different lengths")
    return parts[index] + 1j * parts[index + 1]


_ENDING: Final = ".npy"
_HEADERS: Final = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_KINDS: Final = "biufcSU"
_SPARSE_PARTS: Final = ("data", "indices", "indptr", "row", "col", "offsets")
_COMPRESSED: Final = 15


def read_npy(content: bytes) -> NDArray[Any]:
    """The array of an ``.npy`` file, which must hold as many bytes as its header says."""
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
    """The bytes of a file in an archive of so many bytes."""
    if member.flag_bits & 1:
        raise ValueError(f"{excerpt(member.filename)} is encrypted")
    # the library unpacks other kinds without a limit
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(
            f"{excerpt(member.filename)} is compressed in another way than NumPy does; save it "
            "by numpy.savez or numpy.savez_compressed"
        )
    _check_unpacked(member.file_size, packed)
    return archive.read(member)


def _check_unpacked(size: int, packed: int) -> None:
    """Refuse what unpacks to more bytes than an honest file does."""
    most = max(LARGEST_ARRAY, 4 * packed)
    if size > most:
        raise DeclaredError(
            f"it unpacks to more than {most / 1e6:.0f} MB; save the matrix as a sparse one, or "
            "without compression"
        )


def read_mat(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of a ``.mat`` file up to MATLAB's version 7."""
    if len(content) < HEADER or 0 in content[:4]:
        return _mat_4(content, name, variable)
    if content[125 if content[126:127] == b"I" else 124] != 1:
        raise DataFileError(
            f"{name}: not a .mat file, or one of MATLAB 7.3; save it with -v7, or as Matrix Market"
        )
    variables = mat_variables(_plain_mat(content))
    which = chosen([one.name for one in variables], name, variable)
    found = [one for one in variables if one.name == which]
    if len(found) > 1:
        raise ValueError(f"{excerpt(which)} stands in it {len(found)} times")
    if not found[0].is_matrix_of_numbers:
        raise ValueError(
            f"{excerpt(which)} is {found[0].kind}; it must be a matrix of real numbers"
        )
    return found[0].value()


def _mat_4(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of a file of MATLAB's version 4, which SciPy reads without compiled code."""
    from scipy.io import loadmat, whosmat

    known = whosmat(io.BytesIO(content))  # type: ignore[arg-type]
    which = chosen([one[0] for one in known], name, variable)
    shapes = [(shape, kind) for found, shape, kind in known if found == which]
    if len(shapes) > 1:
        raise ValueError(f"{excerpt(which)} stands in it {len(shapes)} times")
    shape, kind = shapes[0]
    if kind == "sparse":
        check_rows(shape, sparse=True)
    value = loadmat(io.BytesIO(content), variable_names=[which], spmatrix=False)[which]  # type: ignore[arg-type]
    return checked_sparse(value) if kind == "sparse" else np.asarray(value)


def _plain_mat(content: bytes) -> bytes:
    """The file with every compressed element unpacked: then nothing in it is larger than it is."""
    order = "<" if content[126:128] == b"IM" else ">"
    plain, place = [content[:HEADER]], HEADER
    size = 0
    while place + 8 <= len(content):
        kind, length = struct.unpack(f"{order}II", content[place : place + 8])
        body = content[place + 8 : place + 8 + length]
        if kind == _COMPRESSED:
            unpacking = zlib.decompressobj()
            most = max(LARGEST_ARRAY, 4 * len(content)) - size
            body = unpacking.decompress(body, most + 1)
            size += len(body)
            _check_unpacked(size, len(content))
            if not unpacking.eof or len(body) < 8:
                raise ValueError("a compressed element is cut off")
            # its own length may say anything
            plain.append(body[:4] + struct.pack(f"{order}I", len(body) - 8) + body[8:])
        else:
            plain.append(content[place : place + 8 + length])
        place += 8 + length
    return b"".join(plain)


def chosen(names: list[str], name: str, variable: str | None) -> str:
    """The name of the matrix that is meant."""
    if variable in names:
        return str(variable)
    if variable is None and len(names) == 1:
        return names[0]
    shown = listed(excerpt(one) for one in names[:10])
    if not names:
        raise DataFileError(f"{name}: it contains no matrix")
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; name one of them under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: has no array called {excerpt(variable)!r}{hint} ({shown})")
