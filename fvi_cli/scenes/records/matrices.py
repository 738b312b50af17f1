"""Symmetric matrices as values of keys, also from files of finite-element programs."""

from __future__ import annotations

import functools
import io
import re
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import (
    Form,
    SparseMatrix,
    as_csr,
    is_sparse,
    sparse_unit,
    symmetric_form,
)
from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.keys.values import BY_FORM, Matrix, Positive, key
from fvi_cli.scenes.records.csv_samples import DECIMAL, Decimal, read_csv_columns
from fvi_cli.scenes.records.inputs import (
    DataFileError,
    FromFile,
    kept_numbers,
    read_content,
    read_text,
)

LARGEST_FILE: Final = 400_000_000
"""Most bytes of a file of a matrix, and of what it unpacks to."""
MOST_ROWS: Final = 300_000
_DIGITS: Final = b"0123456789+-.eEdD \t\r\n"
_SUFFIXES: Final = (".mtx", ".npy", ".npz", ".mat", ".csv", ".txt")


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
    try:
        if suffix in (".csv", ".txt"):
            value: Any = _numbers_of(path, name)
        else:
            value = _binary(suffix, read_content(path, name, LARGEST_FILE), name, variable)
        if is_sparse(value) and value.format in ("csr", "csc", "bsr"):
            # an index outside of the matrix would crash the process
            value.check_format(full_check=True)
    except DataFileError:
        raise
    except Exception as error:
        # libraries raise nearly any exception for bytes of another format
        reason = excerpt(str(error) or type(error).__name__, 160)
        raise DataFileError(f"{name}: not a readable {suffix} file: {reason}") from None
    if value.dtype.kind not in "iuf":
        raise DataFileError(f"{name}: its entries are {value.dtype}; they must be real numbers")
    if max(value.shape, default=0) > MOST_ROWS:
        raise DataFileError(f"{name}: a matrix may have {MOST_ROWS} rows; it is {value.shape}")
    # entries that are not finite, or too large for a double, are refused below
    with np.errstate(all="ignore"):
        try:
            return symmetric_form(value, name)
        except ValueError as error:
            raise DataFileError(str(error)) from None


def _binary(suffix: str, content: bytes, name: str, variable: str | None) -> Any:
    """What the library of a format reads."""
    from scipy.io import loadmat, mminfo, mmread, whosmat
    from scipy.sparse import load_npz

    file: Any = io.BytesIO(content)
    if suffix == ".npy":
        return np.load(file, allow_pickle=False)
    if suffix == ".mtx":
        _check_digits(content, name)
        # an entry takes a digit and a line break, at least
        if 2 * mminfo(file)[2] > len(content) + 2:
            raise ValueError("more entries are declared than there are")
        return mmread(io.BytesIO(content), spmatrix=False)
    if suffix == ".npz":
        with zipfile.ZipFile(file) as archive:
            if sum(one.file_size for one in archive.infolist()) > LARGEST_FILE:
                raise ValueError(f"it unpacks to more than {LARGEST_FILE} bytes")
        with np.load(file, allow_pickle=False) as found:
            if variable is None and {"format", "shape", "data"} <= set(found.files):
                return load_npz(io.BytesIO(content))
            return found[_chosen(found.files, name, variable)]
    try:
        which = _chosen([one for one, *_ in whosmat(file)], name, variable)
    except NotImplementedError:
        words = "a .mat file of MATLAB 7.3; save it with -v7, or as Matrix Market"
        raise DataFileError(f"{name}: {words}") from None
    return loadmat(io.BytesIO(content), variable_names=[which], spmatrix=False)[which]  # type: ignore[arg-type]


def _check_digits(content: bytes, name: str) -> None:
    """Refuse numbers that SciPy would read in part: it reads 1,5 and 1_0 as 1."""
    numbers = re.sub(rb"(?m)^[ \t]*%.*$", b"", content)
    if odd := numbers.translate(None, _DIGITS):
        line = numbers.count(b"\n", 0, numbers.index(odd[:1])) + 1
        sign = excerpt(odd[:1].decode("latin-1"))
        raise DataFileError(
            f"{name}:{line}: {sign!r} is not allowed; numbers are written like 1.5e-3"
        )


def _numbers_of(path: Path, name: str) -> NDArray[np.float64]:
    text = read_text(path, name).replace(",", " ").replace(";", " ")
    with warnings.catch_warnings():
        # a text without numbers is a mistake
        warnings.simplefilter("error")
        return np.loadtxt(io.StringIO(text), ndmin=2)


def _chosen(names: Sequence[str], name: str, variable: str | None) -> str:
    """The name of the requested matrix, or of the only one."""
    if variable is None and len(names) == 1:
        return names[0]
    if variable is not None and variable in names:
        return variable
    shown = listed(excerpt(one) for one in names[:10]) or "no matrix"
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; name one of them under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: has no array called {excerpt(variable)!r}{hint} ({shown})")


def matrix_as_numbers(matrix: Form) -> Array:
    """A symmetric matrix as it is kept: dense by rows; of a sparse one rows, places and entries."""
    if isinstance(matrix, np.ndarray):
        return np.array(matrix, dtype=float)
    found = as_csr(matrix).tocoo()
    return np.concatenate([[matrix.shape[0]], found.row, found.col, found.data]).astype(float)


@functools.lru_cache(maxsize=32)
def _matrix_of_digest(digest: str) -> Form:
    numbers = kept_numbers(digest)
    if numbers.ndim == 2:
        return numbers
    from scipy.sparse import coo_array, csr_array

    rows, (row, column, data) = int(numbers[0]), numbers[1:].reshape(3, -1)
    places = (row.astype(np.int32), column.astype(np.int32))
    return cast(SparseMatrix, csr_array(coo_array((data, places), shape=(rows, rows))))


class MatrixFile(FromFile):
    """A symmetric matrix from a file."""

    file: str = key(
        "Matrix Market (.mtx), NumPy (.npy, .npz, also of scipy.sparse), MATLAB (.mat) or rows of "
        "numbers (.csv, .txt); a relative path begins at the configuration."
    )
    variable: str | None = key("Which matrix of a .mat or .npz file that holds several.", None)

    def read(self, path: Path, name: str) -> Array:
        """The entries as they are kept."""
        return matrix_as_numbers(read_matrix(path, name, self.variable))

    @property
    def value(self) -> Form:
        """The matrix."""
        return _matrix_of_digest(str(self.digest))


class Numbers(FromFile):
    """Numbers from a column of a table, or from a text with a number in every line."""

    file: str = key(
        "Table with names of columns, or numbers alone, from the configuration's folder."
    )
    column: str | None = key("Column of the numbers in a table.", None)
    decimal: Decimal = DECIMAL

    def read(self, path: Path, name: str) -> Array:
        """The numbers, shape ``(n,)``."""
        if self.column is not None:
            return read_csv_columns(path, name, (self.column,), decimal=self.decimal)[0].ravel()
        try:
            found = _numbers_of(path, name)
        except DataFileError:
            raise
        except (ValueError, UserWarning) as error:
            reason = excerpt(str(error), 160)
            raise DataFileError(f"{name}: not a list of numbers: {reason}") from None
        if 1 not in found.shape or not np.isfinite(found).all():
            raise DataFileError(f"{name}: it must be one line, or one column, of finite numbers")
        return found.ravel()


NumberOrMatrix = Annotated[float | Matrix | MatrixFile, BY_FORM]
PositiveOrMatrix = Annotated[Positive | Matrix | MatrixFile, BY_FORM]


def rows_of(value: object) -> int:
    """Number of rows of a matrix, or entries of a list; 1 for a number."""
    if isinstance(value, MatrixFile):
        return int(value.value.shape[0])
    return len(value) if isinstance(value, list) else 1


def matrix_of(value: object, dimension: int, *, sparse: bool = False) -> Form:
    """A number times the unit matrix (sparse if requested), or a matrix unchanged."""
    if is_sparse(value):
        return cast("SparseMatrix", value)
    matrix = np.asarray(value, dtype=float)
    if matrix.ndim:
        return matrix
    return float(matrix) * sparse_unit(dimension) if sparse else matrix * np.eye(dimension)
