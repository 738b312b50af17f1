"""Symmetric matrices under a key, also from files."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Annotated, Any, Final, cast

import numpy as np

from fvi_cli.effects.matrices import (
    Form,
    SparseMatrix,
    as_csr,
    indefinite_words,
    is_sparse,
    sparse_unit,
)
from fvi_cli.keys.cursor import INVALID, PLAIN, Cursor
from fvi_cli.keys.scalars import Text
from fvi_cli.keys.settings import PlainSetting, key, record_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.records.data_files import file_under, with_digest
from fvi_cli.scenes.records.inputs import DIGEST, Digest, is_kept, numbers_of
from fvi_cli.scenes.structures.matrix_files import read_matrix


def matrix_as_numbers(matrix: Form) -> Array:
    """A symmetric matrix as it is kept: dense by rows; of a sparse one rows, places and entries."""
    if isinstance(matrix, np.ndarray):
        return np.array(matrix, dtype=float)
    found = as_csr(matrix).tocoo()
    return np.concatenate([[matrix.shape[0]], found.row, found.col, found.data]).astype(float)


@functools.lru_cache(maxsize=32)
def _matrix_of_digest(digest: str) -> Form:
    numbers = numbers_of({"file": "", "digest": digest})
    if numbers.ndim == 2:
        return numbers
    from scipy.sparse import coo_array, csr_array

    rows, (row, column, data) = int(numbers[0]), numbers[1:].reshape(3, -1)
    places = (row.astype(np.int32), column.astype(np.int32))
    return cast(SparseMatrix, csr_array(coo_array((data, places), shape=(rows, rows))))


def _read(values: Mapping[str, Any], at: Cursor, *, positive: bool) -> Any:
    """The keys of a matrix with the digest of its entries in the file."""
    if is_kept(values.get("digest")):
        return values
    file, name = file_under(values["file"], at)
    variable = values.get("variable")

    def read() -> Array:
        return matrix_as_numbers(read_matrix(file, name, variable))

    found = with_digest(values, at, ("matrix", file, variable), read)
    if positive and found is not INVALID and indefinite_words(_matrix_of_digest(found["digest"])):
        return at.refuse(
            f"{name}: an eigenvalue is zero or negative; a mass must be positive definite", "file"
        )
    return found


class MatrixFileShape(PlainSetting, expected="a matrix from a file, such as {file: K.mtx}"):
    """A symmetric matrix from a file that is read together with the configuration."""

    file: Annotated[str, Text(what="the path of a file, from the configuration's folder")] = key(
        "Matrix Market (.mtx), NumPy (.npy, .npz, also of scipy.sparse), MATLAB (.mat) or "
        "rows of numbers (.csv, .txt); a relative path begins at the configuration."
    )
    variable: Annotated[str | None, Text(what="the name of a matrix")] = key(
        "Which matrix of a .mat or .npz file that holds several.", default=None
    )
    digest: Digest = DIGEST

    def check(self, at: Cursor, values: dict[str, Any]) -> Any:
        """The keys with the digest of the entries in the file."""
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
    numbers_of(value)
    return _matrix_of_digest(str(value["digest"]))


def matrix_size(value: object) -> int | None:
    """Number of rows of a matrix from a file; None for anything else."""
    if isinstance(value, Mapping) and "file" in value and "column" not in value:
        return int(_matrix_of_digest(str(value["digest"])).shape[0]) if "digest" in value else None
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
