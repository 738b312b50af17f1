"""Checks of the sizes that a file declares, before memory is allocated or a library is called."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import SparseMatrix
from fvi_cli.errors import ArgumentError

MOST_ROWS: Final = 300_000
"""Most rows of a sparse matrix."""
MOST_DENSE_ROWS: Final = 2000
"""Most rows of a dense matrix; as text larger ones would rarely be short enough to be stored."""
LARGEST_ARRAY: Final = 8 * MOST_DENSE_ROWS**2 + 2**16
"""Most bytes of one array of a compressed file with its head, unless the file itself is large."""


class DeclaredError(ValueError):
    """A file declares a size that is not allowed."""


_NUMBERS: Final = "iufc"
_WHOLE: Final = "iu"


def check_rows(shape: Sequence[int], *, sparse: bool) -> None:
    """Refuse a shape that is not square or too large."""
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] < 1:
        text = " x ".join(map(str, shape))
        raise DeclaredError(f"it is {text or 'a number'}; a square matrix is needed")
    most = MOST_ROWS if sparse else MOST_DENSE_ROWS
    if shape[0] > most:
        kind, hint = ("sparse", "") if sparse else ("dense", "; save it as a sparse matrix")
        raise DeclaredError(f"it has {shape[0]} rows; a {kind} matrix may have {most}{hint}")


def sparse_matrix(
    kind: str, shape: Sequence[int], parts: Mapping[str, NDArray[Any]]
) -> SparseMatrix:
    """A square sparse matrix from untrusted arrays of a file.

    SciPy does not check these arrays: an index outside the matrix crashes the process. `kind` is
    csr, csc, bsr, coo or dia; `parts` are SciPy's arrays: ``data``, and ``indices`` and ``indptr``,
    or ``row`` and ``col``, or ``offsets``.

    Raises
    ------
    ValueError
        If an array is missing or has a wrong length, or an index lies outside the matrix.
    """
    from scipy.sparse import bsr_array, coo_array, csc_array, csr_array, dia_array

    check_rows(shape, sparse=True)
    rows = int(shape[0])
    size = (rows, rows)
    data = _part(parts, "data", _NUMBERS, {"bsr": 3, "dia": 2}.get(kind, 1))
    with np.errstate(all="ignore"):
        data = data.astype(complex if data.dtype.kind == "c" else float)
    if kind == "coo":
        row, column = (_indices(parts, name, 0, rows, len(data)) for name in ("row", "col"))
        return cast(SparseMatrix, coo_array((data, (row, column)), shape=size))
    if kind == "dia":
        offsets = _indices(parts, "offsets", 1 - rows, rows, len(data))
        if len(set(offsets.tolist())) != len(offsets):
            raise ArgumentError("offsets", "one of them stands there twice")
        return cast(SparseMatrix, dia_array((data, offsets), shape=size))
    if kind not in ("csr", "csc", "bsr"):
        raise ValueError(f"format {kind!r} is not known; save it as csr, csc, coo, bsr or dia")
    high, wide = data.shape[1:] if kind == "bsr" else (1, 1)
    if not high or not wide or rows % high or rows % wide:
        raise ArgumentError(
            "data", f"blocks of {high} x {wide} do not fill {rows} rows and columns"
        )
    indices = _indices(parts, "indices", 0, rows // wide, len(data))
    ends = _indices(parts, "indptr", 0, len(data) + 1, rows // high + 1)
    if ends[0] != 0 or ends[-1] != len(data) or np.any(ends[1:] < ends[:-1]):
        raise ArgumentError("indptr", f"must increase from 0 to the number of entries, {len(data)}")
    makers: dict[str, Any] = {"csr": csr_array, "csc": csc_array, "bsr": bsr_array}
    return cast(SparseMatrix, makers[kind]((data, indices, ends), shape=size))


def checked_sparse(found: Any) -> SparseMatrix:
    """A sparse matrix that a library has read, checked and rebuilt from its arrays."""
    names = ("data", "indices", "indptr", "row", "col", "offsets")
    parts = {name: np.asarray(getattr(found, name)) for name in names if hasattr(found, name)}
    return sparse_matrix(str(found.format), found.shape, parts)


def _part(parts: Mapping[str, NDArray[Any]], name: str, kinds: str, dimension: int) -> NDArray[Any]:
    """One of the arrays, checked."""
    if name not in parts:
        raise ArgumentError(name, "missing")
    found = parts[name]
    if found.dtype.kind not in kinds or found.ndim != dimension:
        what = "whole numbers" if kinds == _WHOLE else "numbers"
        raise ArgumentError(
            name, f"{found.ndim} dimensions of {found.dtype}; {dimension} of {what} are needed"
        )
    return found


def _indices(
    parts: Mapping[str, NDArray[Any]], name: str, least: int, end: int, count: int
) -> NDArray[np.int32]:
    """An array of `count` integers i with `least` <= i < `end`."""
    found = _part(parts, name, _WHOLE, 1)
    if len(found) != count:
        raise ArgumentError(name, f"{len(found)} numbers where there must be {count}")
    wrong = np.flatnonzero((found < least) | (found >= end))
    if wrong.size:
        raise ArgumentError(
            name, f"{found[wrong[0]]} is not allowed; it must be {least} to {end - 1}"
        )
    return found.astype(np.int32)
