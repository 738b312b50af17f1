"""Symmetric matrices from files of finite-element programs."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, is_sparse, symmetric_form
from fvi_cli.effects.matrices import form as shortest
from fvi_cli.keys.complaints import excerpt, listed
from fvi_cli.scenes.records.data_files import (
    DataFileError,
    check_lines,
    parse_number,
    read_content,
)
from fvi_cli.scenes.structures.archives import read_mat, read_npy, read_npz
from fvi_cli.scenes.structures.declared import (
    MOST_DENSE_ROWS,
    DeclaredError,
    check_rows,
    checked_sparse,
)

LARGEST_FILE: Final = 400_000_000
"""Most bytes of a file of a matrix."""
_COMMENTS: Final = re.compile(rb"(?:%[^\n]*\n|[ \t\r]*\n)*+")
_DIGITS: Final = b"0123456789+-.eE \t\r\n"
_BETWEEN: Final = re.compile(r"[,;\s]+")


def read_matrix(path: Path, name: str, variable: str | None = None) -> Form:
    """Read a symmetric matrix.

    Matrix Market (``.mtx``; coordinates are sparse), NumPy (``.npy``; ``.npz`` of NumPy or of
    ``scipy.sparse.save_npz``), MATLAB (``.mat``, up to version 7) and text (``.csv``, ``.txt``:
    a row of numbers in each line).

    Raises
    ------
    DataFileError
        If it cannot be read, or the matrix is not real, square, finite and symmetric.
    """
    suffix = path.suffix.lower()
    if suffix not in _SUFFIXES:
        raise DataFileError(
            f"{name}: the ending must be one of {listed(_SUFFIXES)}, so that its format is known"
        )
    content = read_content(path, name, LARGEST_FILE)
    try:
        if suffix in _ARCHIVES:
            value = _ARCHIVES[suffix](content, name, variable)
        elif variable is not None:
            message = "it holds one matrix without a name; leave out variable"
            raise DataFileError(f"{name}: {message}")
        else:
            value = _READERS[suffix](content, name)
    except DataFileError:
        raise
    except DeclaredError as error:
        raise DataFileError(f"{name}: {error}") from None
    except Exception as error:
        # libraries raise nearly any exception for bytes of another format
        reason = excerpt(str(error) or type(error).__name__, 160)
        raise DataFileError(f"{name}: not a readable {suffix} file: {reason}") from None
    if value.dtype.kind not in "iuf":
        raise DataFileError(f"{name}: its entries are {value.dtype}; they must be real numbers")
    try:
        check_rows(value.shape, sparse=True)
        return _symmetric(value, name)
    except DeclaredError as error:
        raise DataFileError(f"{name}: {error}") from None
    except ValueError as error:
        raise DataFileError(str(error)) from None


def _symmetric(value: Any, name: str) -> Form:
    """A matrix, sparse where it is large and has few entries; refuses unsymmetric ones."""
    # entries that are not finite, or too large for a double, are refused below
    with np.errstate(all="ignore"):
        if not is_sparse(value):
            value = np.asarray(value, dtype=float)
            if len(value) > MOST_DENSE_ROWS:
                value = shortest(value)
        if not is_sparse(value):
            check_rows(value.shape, sparse=False)
        return symmetric_form(value, name)


def _market(content: bytes, name: str) -> Any:
    from scipy.io import mminfo, mmread

    rows, columns, entries, layout, *_ = mminfo(io.BytesIO(content))
    is_sparse = layout == "coordinate"
    if is_sparse:
        check_rows((rows, columns), sparse=True)
    # an entry takes a digit and a line break, at least
    if 2 * entries > len(content) + 2:
        raise ValueError(f"{entries} entries are declared, {len(content)} bytes are there")
    _check_digits(content, name)
    found = mmread(io.BytesIO(content), spmatrix=False)
    return checked_sparse(found) if is_sparse else found


def _check_digits(content: bytes, name: str) -> None:
    """Refuse numbers that SciPy would read in part: it reads 1,5 and 1_0 and 1D5 as 1."""
    begin = _COMMENTS.match(content)
    place = begin.end() if begin else 0
    odd = content[place:].translate(None, _DIGITS)
    if odd:
        line = content.count(b"\n", 0, content.index(odd[:1], place)) + 1
        sign = excerpt(odd[:1].decode("latin-1"))
        raise DataFileError(
            f"{name}:{line}: {sign!r} is not allowed; numbers are written like 1.5e-3"
        )


def _text(content: bytes, name: str) -> NDArray[np.float64]:
    check_lines(content, name)
    rows: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8-sig").splitlines(), start=1):
        bare = line.split("#")[0].strip()
        if not bare:
            continue
        row = []
        for cell in _BETWEEN.split(bare):
            try:
                row.append(parse_number(cell))
            except ValueError:
                raise DataFileError(
                    f"{name}:{number}: {excerpt(cell)!r} is not a number; every line must be a "
                    "row of numbers"
                ) from None
            if not math.isfinite(row[-1]):
                raise DataFileError(
                    f"{name}:{number}: the entry in row {len(rows) + 1}, column {len(row)} is "
                    f"{cell}; every entry must be finite"
                )
        if rows and len(row) != len(rows[0]):
            raise DataFileError(
                f"{name}:{number}: {len(row)} entries where the first row has {len(rows[0])}"
            )
        rows.append(row)
    return np.array(rows, dtype=float)


_READERS: Final[Mapping[str, Callable[[bytes, str], Any]]] = MappingProxyType(
    {
        ".mtx": _market,
        ".npy": lambda content, name: read_npy(content),
        ".csv": _text,
        ".txt": _text,
    }
)
_ARCHIVES: Final = MappingProxyType({".npz": read_npz, ".mat": read_mat})
_SUFFIXES: Final = (".mtx", ".npy", *_ARCHIVES, ".csv", ".txt")
