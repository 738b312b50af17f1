"""Symmetric matrices as a text that travels with the problem, and back."""

from __future__ import annotations

import base64
import binascii
import functools
import re
import zlib
from typing import Final, cast

import numpy as np

from fvi_cli.effects.matrices import Form, SparseMatrix, as_csr

LARGEST_TEXT: Final = 20_000_000
"""Characters of a matrix as text: it stands in every result file, and in every run's identity."""
_LARGEST_UNPACKED: Final = 800_000_000
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
    found = _HEADER.match(text)
    if found is None:
        raise ValueError("not a matrix as text")
    rows = int(found.group(2))
    try:
        content = _unpacked(text[found.end() :])
        if found.group(1) == "dense":
            return _dense(content, rows)
        ends = np.frombuffer(content, dtype="<i4", count=rows + 1)
        count = int(ends[-1])
        columns = np.frombuffer(content, dtype="<i4", count=count, offset=4 * (rows + 1))
        data = np.frombuffer(content, dtype="<f8", count=count, offset=4 * (rows + 1 + count))
        return _sparse(rows, ends, columns, data)
    except (binascii.Error, zlib.error, ValueError, IndexError) as error:
        raise ValueError(f"not a matrix as text: {error}") from None


def _dense(content: bytes, rows: int) -> Form:
    matrix = np.zeros((rows, rows))
    matrix[np.tril_indices(rows)] = np.frombuffer(content, dtype="<f8")
    return matrix + np.tril(matrix, -1).T


def _sparse(rows: int, ends: np.ndarray, columns: np.ndarray, data: np.ndarray) -> SparseMatrix:
    from scipy.sparse import csr_array, tril

    lower = csr_array((data.copy(), columns.copy(), ends.copy()), shape=(rows, rows))
    lower.check_format()
    return cast(SparseMatrix, csr_array(lower + tril(lower, -1).T))


def _packed(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def _unpacked(text: str) -> bytes:
    unpacking = zlib.decompressobj()
    content = unpacking.decompress(base64.b64decode(text, validate=True), _LARGEST_UNPACKED)
    if unpacking.unconsumed_tail:
        raise ValueError(f"more than {_LARGEST_UNPACKED // 10**6} MB")
    return content
