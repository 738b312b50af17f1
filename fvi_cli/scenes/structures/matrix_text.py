"""Symmetric matrices as a text that travels with the problem, and back."""

from __future__ import annotations

import base64
import binascii
import functools
import re
import zlib
from typing import Final, cast

import numpy as np

from fvi_cli.effects.matrices import Form, SparseMatrix, as_csr, entries
from fvi_cli.scenes.structures.declared import check_rows, sparse_matrix

LARGEST_TEXT: Final = 20_000_000
"""Characters of a matrix as text: it stands in every result file, and in every run's identity."""
_MOST_ENTRIES: Final = 10_000_000
_HEADER: Final = re.compile(r"(dense|sparse) (\d{1,7}) ")


def matrix_as_text(matrix: Form) -> str:
    """A symmetric matrix without loss as one line.

    ``dense`` or ``sparse`` and the number of rows, then the lower triangle compressed (zlib) and
    in letters (base64): all entries by rows, or ends of rows, columns and entries.
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
    """Number of rows that a matrix as text declares, and whether it is sparse.

    Raises
    ------
    ValueError
        If the text is of another kind, or declares more than is allowed.
    """
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
    """The matrix of a text from `matrix_as_text`.

    Raises
    ------
    ValueError
        If the text is not of that kind.
    """
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
    """The first bytes of what was compressed; `is_whole` says that there are no more."""
    unpacking = zlib.decompressobj()
    content = unpacking.decompress(packed, size + 1)
    if is_whole and (not unpacking.eof or unpacking.unused_data) and len(content) == size:
        # only at its end is the checksum of what was compressed
        raise ValueError("the text is cut off, or has something behind its end")
    if len(content) < size or (is_whole and len(content) > size):
        raise ValueError(f"{len(content)} bytes where there must be {size}")
    return content[:size]
