"""Symmetric matrices from the files that finite-element programs write."""

from __future__ import annotations

import hashlib
import io
import math
import re
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, symmetric_form
from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import DataFileError, read_content

if TYPE_CHECKING:
    from collections.abc import Mapping

LARGEST_FILE: Final = 400_000_000
"""Bytes of a file of a matrix, at most."""
_BETWEEN: Final = re.compile(r"[,;\s]+")


@dataclass(frozen=True, kw_only=True, eq=False)
class MatrixFile:
    """A matrix with the file's fingerprint.

    Parameters
    ----------
    form
        The matrix, sparse where the file holds entries only.
    sha256
        Of the bytes of the file.
    """

    form: Form
    sha256: str


def read_matrix(path: Path, name: str, variable: str | None = None) -> MatrixFile:
    """Read a symmetric matrix.

    Matrix Market (``.mtx``; coordinates are sparse), NumPy (``.npy``; ``.npz`` of NumPy or of
    ``scipy.sparse.save_npz``), MATLAB (``.mat``, up to version 7) and text (``.csv``, ``.txt``:
    a row of numbers in each line).

    Parameters
    ----------
    path
        The file.
    name
        What messages call it.
    variable
        Which matrix of a file that may hold several.

    Raises
    ------
    DataFileError
        If it cannot be read, or the matrix is not real, square, finite and symmetric.
    """
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        raise DataFileError(
            f"{name}: the ending must be one of {listed(_READERS)}, so that its format is known"
        )
    content = read_content(path, name, LARGEST_FILE)
    try:
        value = _READERS[suffix](content, name, variable)
    except DataFileError:
        raise
    except (ValueError, TypeError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise DataFileError(
            f"{name}: not a readable {suffix} file: {excerpt(str(error), 160)}"
        ) from None
    if np.iscomplexobj(value) or not np.issubdtype(value.dtype, np.number):
        raise DataFileError(f"{name}: its entries are {value.dtype}; they must be real numbers")
    if value.ndim != 2 or value.shape[0] != value.shape[1] or value.shape[0] == 0:
        shape = " x ".join(map(str, value.shape))
        raise DataFileError(f"{name}: it is {shape or 'a number'}; a square matrix is needed")
    try:
        form = symmetric_form(value, name)
    except ValueError as error:
        raise DataFileError(str(error)) from None
    return MatrixFile(form=form, sha256=hashlib.sha256(content).hexdigest())


def _market(content: bytes, name: str, variable: str | None) -> Any:
    from scipy.io import mmread

    _no_variable(name, variable)
    return mmread(io.BytesIO(content), spmatrix=False)


def _npy(content: bytes, name: str, variable: str | None) -> Any:
    _no_variable(name, variable)
    return np.load(io.BytesIO(content), allow_pickle=False)


def _npz(content: bytes, name: str, variable: str | None) -> Any:
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        names = list(arrays.files)
        if variable is None and {"format", "shape", "data"} <= set(names):
            from scipy.sparse import load_npz

            return load_npz(io.BytesIO(content))
        return arrays[_chosen(names, name, variable)]


def _mat(content: bytes, name: str, variable: str | None) -> Any:
    from scipy.io import loadmat

    try:
        found: Mapping[str, Any] = loadmat(
            io.BytesIO(content),  # type: ignore[arg-type]
            spmatrix=False,
        )
    except NotImplementedError:
        # what SciPy says of files that are HDF5
        raise DataFileError(
            f"{name}: of MATLAB's version 7.3; save it with -v7, or as Matrix Market"
        ) from None
    names = [key for key in found if not key.startswith("__")]
    return found[_chosen(names, name, variable)]


def _text(content: bytes, name: str, variable: str | None) -> NDArray[np.float64]:
    _no_variable(name, variable)
    rows: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8-sig").splitlines(), start=1):
        bare = line.split("#")[0].strip()
        if not bare:
            continue
        row = []
        for cell in _BETWEEN.split(bare):
            try:
                row.append(float(cell))
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


_READERS: Final = MappingProxyType[str, Callable[[bytes, str, str | None], Any]](
    {".mtx": _market, ".npy": _npy, ".npz": _npz, ".mat": _mat, ".csv": _text, ".txt": _text}
)


def _no_variable(name: str, variable: str | None) -> None:
    if variable is not None:
        raise DataFileError(f"{name}: it holds one matrix without a name; leave out variable")


def _chosen(names: list[str], name: str, variable: str | None) -> str:
    """The name of the matrix that is meant."""
    if variable in names:
        return str(variable)
    if variable is None and len(names) == 1:
        return names[0]
    shown = listed(excerpt(one) for one in names[:10]) or "nothing"
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; say which one under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: nothing in it is called {excerpt(variable)!r}{hint} ({shown})")
