"""Matrices in the containers of NumPy and MATLAB, unpacked within limits."""

from __future__ import annotations

import io
import math
import struct
import zipfile
import zlib
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
from fvi_cli.scenes.structures.mat_file import HEADER, mat_variables

_ENDING: Final = ".npy"
_HEADERS: Final = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
_KINDS: Final = "biufcSU"
_SPARSE_PARTS: Final = ("data", "indices", "indptr", "row", "col", "offsets")
_COMPRESSED: Final = 15


def read_npy(content: bytes) -> NDArray[Any]:
    """The array of an ``.npy`` file, which must hold as many bytes as its header says.

    Raises
    ------
    ValueError
        If it does not, or its entries are neither numbers nor text.
    """
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
    """A matrix of an ``.npz`` file of NumPy, or of ``scipy.sparse.save_npz``.

    Raises
    ------
    DataFileError, ValueError
        If there is none of that name, or it is compressed otherwise than NumPy does, or too large.
    """
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
    """A matrix of a ``.mat`` file up to MATLAB's version 7.

    Raises
    ------
    DataFileError, ValueError
        If there is none of that name, or it is no matrix of numbers, or too large.
    """
    if len(content) < HEADER or 0 in content[:4]:
        return _mat_4(content, name, variable)
    if content[125 if content[126:127] == b"I" else 124] != 1:
        raise DataFileError(
            f"{name}: of MATLAB's version 7.3, or no .mat file; save it with -v7, or as Matrix "
            "Market"
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
    """The name of the matrix that is meant.

    Raises
    ------
    DataFileError
        If there is none, or more than one.
    """
    if variable in names:
        return str(variable)
    if variable is None and len(names) == 1:
        return names[0]
    shown = listed(excerpt(one) for one in names[:10])
    if not names:
        raise DataFileError(f"{name}: there is no matrix in it")
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; say which one under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: has no array called {excerpt(variable)!r}{hint} ({shown})")
