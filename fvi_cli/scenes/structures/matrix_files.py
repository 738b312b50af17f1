"""Symmetric matrices from files of finite-element programs."""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, is_sparse, symmetric_form
from fvi_cli.effects.matrices import form as shortest
from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import (
    DataFileError,
    check_lines,
    read_content,
)

LARGEST_FILE: Final = 400_000_000
"""Most bytes of a file of a matrix, and of what it unpacks to."""
MOST_ROWS: Final = 300_000
"""Most rows of a sparse matrix."""
MOST_DENSE_ROWS: Final = 2000
"""Most rows of a dense matrix."""
_COMMENTS: Final = re.compile(rb"(?:[ \t]*%[^\n]*\n|[ \t\r]*\n)*+")
_DIGITS: Final = b"0123456789+-.eEdD \t\r\n"


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
    _check_rows(value.shape, name, sparse=True)
    try:
        return _symmetric(value, name)
    except ValueError as error:
        raise DataFileError(str(error)) from None


def read_vector(path: Path, name: str) -> NDArray[np.float64]:
    """Read numbers from a text, ``(n,)``: a line of them, or one in every line.

    Raises
    ------
    DataFileError
        If it cannot be read, or holds anything else.
    """
    content = read_content(path, name, LARGEST_FILE)
    try:
        found = _text(content, name)
    except (ValueError, UserWarning) as error:
        raise DataFileError(f"{name}: not a list of numbers: {excerpt(str(error), 160)}") from None
    if 1 not in found.shape or not np.isfinite(found).all():
        raise DataFileError(f"{name}: it must be one line, or one column, of finite numbers")
    return found.ravel()


def _symmetric(value: Any, name: str) -> Form:
    """A matrix, sparse where it is large and has few entries; refuses unsymmetric ones."""
    # entries that are not finite, or too large for a double, are refused below
    with np.errstate(all="ignore"):
        if not is_sparse(value):
            value = np.asarray(value, dtype=float)
            if len(value) > MOST_DENSE_ROWS:
                value = shortest(value)
        if not is_sparse(value):
            _check_rows(value.shape, name, sparse=False)
        return symmetric_form(value, name)


def _check_rows(shape: Sequence[int], name: str, *, sparse: bool) -> None:
    """Refuse a shape that is not square or too large."""
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] < 1:
        text = " x ".join(map(str, shape))
        raise DataFileError(f"{name}: it is {text or 'a number'}; a square matrix is needed")
    most = MOST_ROWS if sparse else MOST_DENSE_ROWS
    if shape[0] > most:
        kind, hint = ("sparse", "") if sparse else ("dense", "; save it as a sparse matrix")
        raise DataFileError(
            f"{name}: it has {shape[0]} rows; a {kind} matrix may have {most}{hint}"
        )


def _market(content: bytes, name: str) -> Any:
    from scipy.io import mminfo, mmread

    begin = _COMMENTS.match(content)
    place = begin.end() if begin else 0
    _check_digits(content, place, name)
    # SciPy expects neither 1.5D+00, nor blanks before comments, nor a banner in small letters
    banner = content.partition(b"\n")[0].lower().replace(b"market", b"Market", 1) + b"\n"
    banner = banner.replace(b"%%matrix", b"%%Matrix", 1)
    numbers = content[place:].translate(bytes.maketrans(b"Dd", b"ee"))
    plain = banner + numbers
    rows, columns, entries, layout, *_ = mminfo(io.BytesIO(plain))
    if layout == "coordinate":
        _check_rows((rows, columns), name, sparse=True)
    # an entry takes a digit and a line break, at least
    if 2 * entries > len(plain) + 2:
        raise ValueError(f"{entries} entries are declared, {len(plain)} bytes are there")
    return mmread(io.BytesIO(plain), spmatrix=False)


def _check_digits(content: bytes, place: int, name: str) -> None:
    """Refuse numbers that SciPy would read in part: it reads 1,5 and 1_0 as 1."""
    odd = content[place:].translate(None, _DIGITS)
    if odd:
        line = content.count(b"\n", 0, content.index(odd[:1], place)) + 1
        sign = excerpt(odd[:1].decode("latin-1"))
        raise DataFileError(
            f"{name}:{line}: {sign!r} is not allowed; numbers are written like 1.5e-3"
        )


def _text(content: bytes, name: str) -> NDArray[np.float64]:
    check_lines(content, name)
    text = content.decode("utf-8-sig").replace(",", " ").replace(";", " ")
    with warnings.catch_warnings():
        # a text without numbers is a mistake
        warnings.simplefilter("error")
        return np.loadtxt(io.StringIO(text), ndmin=2)


def _npz(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of an ``.npz`` file of NumPy, or of ``scipy.sparse.save_npz``."""
    from scipy.sparse import load_npz

    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(one.file_size for one in archive.infolist()) > LARGEST_FILE:
            raise DataFileError(f"{name}: it unpacks to more than {LARGEST_FILE // 10**6} MB")
    with np.load(io.BytesIO(content), allow_pickle=False) as found:
        if variable is None and {"format", "shape", "data"} <= set(found.files):
            return load_npz(io.BytesIO(content))
        return found[_chosen(found.files, name, variable)]


def _mat(content: bytes, name: str, variable: str | None) -> Any:
    """A matrix of a ``.mat`` file up to MATLAB's version 7."""
    from scipy.io import loadmat, whosmat

    try:
        names = [one for one, *_ in whosmat(io.BytesIO(content))]  # type: ignore[arg-type]
    except NotImplementedError:
        raise DataFileError(
            f"{name}: a .mat file of MATLAB 7.3; save it with -v7, or as Matrix Market"
        ) from None
    which = _chosen(names, name, variable)
    return loadmat(io.BytesIO(content), variable_names=[which], spmatrix=False)[which]  # type: ignore[arg-type]


def _chosen(names: Sequence[str], name: str, variable: str | None) -> str:
    """The name of the requested matrix, or of the only one."""
    if variable is None and len(names) == 1:
        return names[0]
    if variable is not None and variable in names:
        return variable
    shown = listed(excerpt(one) for one in names[:10])
    if not names:
        raise DataFileError(f"{name}: it contains no matrix")
    if variable is None:
        raise DataFileError(f"{name}: it holds {shown}; name one of them under variable")
    hint = suggestion(variable, names)
    raise DataFileError(f"{name}: has no array called {excerpt(variable)!r}{hint} ({shown})")


_READERS: Final[Mapping[str, Callable[[bytes, str], Any]]] = MappingProxyType(
    {
        ".mtx": _market,
        ".npy": lambda content, name: np.load(io.BytesIO(content), allow_pickle=False),
        ".csv": _text,
        ".txt": _text,
    }
)
_ARCHIVES: Final = MappingProxyType({".npz": _npz, ".mat": _mat})
_SUFFIXES: Final = (".mtx", ".npy", *_ARCHIVES, ".csv", ".txt")
