"""Symmetric matrices under a key: from files, and as text that is stored with runs."""

from __future__ import annotations

import base64
import binascii
import functools
import re
import zlib
from collections.abc import Mapping
from typing import Annotated, Any, Final, cast

import numpy as np

from fvi_cli.effects.matrices import (
    Form,
    SparseMatrix,
    as_csr,
    entries,
    is_definite,
    is_sparse,
    sparse_unit,
)
from fvi_cli.errors import ArgumentError
from fvi_cli.keys.cursor import INVALID, PLAIN, Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import PlainSetting, key, record_of
from fvi_cli.scenes.records.data_files import (
    CONTENT_SHA256,
    SHA256,
    Digest,
    file_under,
    filled_in,
)
from fvi_cli.scenes.structures.declared import check_rows, sparse_matrix
from fvi_cli.scenes.structures.matrix_files import read_matrix

LARGEST_TEXT: Final = 20_000_000
"""Most characters of a matrix as text, which is part of every result file and run identity."""
_MOST_ENTRIES: Final = 10_000_000
_HEADER: Final = re.compile(r"(dense|sparse) (\d{1,7}) ")


def matrix_as_text(matrix: Form) -> str:
    """A symmetric matrix without loss as one line.

    ``dense`` or ``sparse`` and the number of rows, then the lower triangle compressed (zlib) and
    encoded in letters (base64): for dense all entries by rows; for sparse ends of rows, columns and
    entries.
    """
    rows = matrix.shape[0]
    if isinstance(matrix, np.ndarray):
        return f"dense {rows} {_packed(matrix[np.tril_indices(rows)].astype('<f8').tobytes())}"
    from scipy.sparse import tril

    lower = as_csr(cast(SparseMatrix, tril(as_csr(matrix), format="csr")))
    lower.sum_duplicates()
    parts = (lower.indptr.astype("<i4"), lower.indices.astype("<i4"), lower.data.astype("<f8"))
    return f"sparse {rows} {_packed(b''.join(part.tobytes() for part in parts))}"


def check_text(text: str) -> tuple[int, bool]:
    """Number of rows that the text of a matrix declares, and whether it is sparse."""
    found = _HEADER.match(text)
    if found is None:
        raise ValueError("not a matrix as fvi writes it")
    rows, is_sparse = int(found.group(2)), found.group(1) == "sparse"
    check_rows((rows, rows), sparse=is_sparse)
    return rows, is_sparse


def rows_of_text(text: str) -> int | None:
    """Number of rows of a matrix as text; None for any other text."""
    found = _HEADER.match(text)
    return int(found.group(2)) if found else None


@functools.lru_cache(maxsize=32)
def matrix_from_text(text: str) -> Form:
    """The matrix of a text from `matrix_as_text`."""
    try:
        rows, is_sparse = check_text(text)
        packed = base64.b64decode(text.split(" ", 2)[2], validate=True)
        matrix = _sparse(packed, rows) if is_sparse else _dense(packed, rows)
        if not np.isfinite(entries(matrix)).all():
            raise ValueError("an entry is not finite")
        return matrix
    except (binascii.Error, zlib.error, ValueError, IndexError) as error:
        raise ValueError(f"not a matrix as text: {error}") from None


def _dense(packed: bytes, rows: int) -> Form:
    content = _unpacked(packed, 4 * rows * (rows + 1))
    matrix = np.zeros((rows, rows))
    matrix[np.tril_indices(rows)] = np.frombuffer(content, dtype="<f8")
    return matrix + np.tril(matrix, -1).T


def _sparse(packed: bytes, rows: int) -> SparseMatrix:
    from scipy.sparse import csr_array, tril

    begin = 4 * (rows + 1)
    ends = np.frombuffer(_unpacked(packed, begin, is_whole=False), dtype="<i4")
    count = int(ends[-1])
    if not 0 <= count <= _MOST_ENTRIES:
        raise ValueError(f"{count} entries; at most {_MOST_ENTRIES} are allowed")
    content = _unpacked(packed, begin + 12 * count)
    columns = np.frombuffer(content, dtype="<i4", count=count, offset=begin)
    data = np.frombuffer(content, dtype="<f8", count=count, offset=begin + 4 * count)
    parts = {"indptr": ends, "indices": columns, "data": data}
    lower = as_csr(sparse_matrix("csr", (rows, rows), parts))
    if np.any(columns > np.repeat(np.arange(rows), np.diff(ends))):
        raise ValueError("an entry above the diagonal")
    return cast(SparseMatrix, csr_array(lower + tril(lower, -1).T))


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _unpacked(packed: bytes, size: int, *, is_whole: bool = True) -> bytes:
    """The first `size` bytes of compressed data; with `is_whole` there must be no more."""
    unpacking = zlib.decompressobj()
    content = unpacking.decompress(packed, size + 1)
    if is_whole and (not unpacking.eof or unpacking.unused_data) and len(content) == size:
        # the checksum of the content is at the end of the compressed data
        raise ValueError("the text is cut off or continues after its end")
    if len(content) < size or (is_whole and len(content) > size):
        raise ValueError(f"{len(content)} bytes where there must be {size}")
    return content[:size]


def _read(values: Mapping[str, Any], at: Cursor, *, positive: bool) -> Any:
    """The keys of a matrix with ``sha256`` and ``content`` filled in from the file."""
    file, name = file_under(values["file"], at)
    variable = values.get("variable")

    def read() -> tuple[str, str, str]:
        found = read_matrix(file, name, variable)
        return found.sha256, matrix_as_text(found.form), "its entries"

    def is_equal(one: str, other: str) -> bool:
        first, second = matrix_from_text(one), matrix_from_text(other)
        difference = first + -1.0 * second if first.shape == second.shape else None
        return difference is not None and not entries(difference).any()

    key = ("matrix", file, variable)
    filled = filled_in(
        values, at, key, read, parse=check_text, is_equal=is_equal, largest=LARGEST_TEXT
    )
    is_read = "content" not in values and filled is not INVALID
    if positive and is_read and not is_definite(matrix_from_text(filled["content"])):
        return at.refuse(
            f"{name}: an eigenvalue is zero or negative; a mass must be positive definite", "file"
        )
    return filled


class MatrixFileShape(PlainSetting, expected="a matrix from a file, such as {file: K.mtx}"):
    """A symmetric matrix from a file that is read together with the configuration."""

    file: Annotated[str, Text(what="the path of a file, from the configuration's folder")] = key(
        "Matrix Market (.mtx), NumPy (.npy, .npz, also of scipy.sparse), MATLAB (.mat) or "
        "rows of numbers (.csv, .txt); a relative path begins at the configuration."
    )
    variable: Annotated[str | None, Text(what="the name of a matrix")] = key(
        "Which matrix of a .mat or .npz file that holds several.", default=None
    )
    sha256: Digest = SHA256
    content: Annotated[str | None, Text(what="a matrix as fvi writes it")] = key(
        "The matrix in short; filled in, and used in place of the file.", default=None
    )
    content_sha256: Digest = CONTENT_SHA256

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with ``sha256`` and ``content`` filled in from the file."""
        return _read(values, at, positive=isinstance(self, MassFile))


class MassFile(MatrixFileShape):
    """A positive definite matrix from a file."""


MATRIX_FILE: Final = record_of(MatrixFileShape)
MASS_FILE: Final = record_of(MassFile)


def file_form(value: object) -> Form | None:
    """The matrix of a mapping that was read by `MATRIX_FILE`; None for anything else."""
    # test plain types first: isinstance with Mapping is slow, and sweeps are large
    if type(value) in PLAIN or not isinstance(value, Mapping) or "file" not in value:
        return None
    if "content" not in value:
        raise ArgumentError("content", f"missing; what {value['file']} holds is needed as well")
    try:
        return matrix_from_text(str(value["content"]))
    except ValueError as error:
        raise ArgumentError("content", str(error)) from None


def matrix_size(value: object) -> int | None:
    """Number of rows of a matrix from a file; None for anything else."""
    if isinstance(value, Mapping) and "file" in value and "column" not in value:
        return rows_of_text(str(value.get("content", "")))
    return None


def matrix_of(value: object, dimension: int, *, sparse: bool = False) -> Form:
    """A number times the unit matrix (sparse if requested), or a matrix unchanged."""
    from_file = file_form(value)
    if from_file is not None:
        return from_file
    if is_sparse(value):
        return cast("SparseMatrix", value)
    matrix = np.asarray(value, dtype=float)
    if matrix.ndim:
        return matrix
    return float(matrix) * sparse_unit(dimension) if sparse else matrix * np.eye(dimension)
