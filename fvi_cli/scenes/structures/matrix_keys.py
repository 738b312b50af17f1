"""Symmetric matrices as values of keys, also from files."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Annotated, cast

import numpy as np

from fvi_cli.effects.matrices import Form, SparseMatrix, as_csr, is_sparse, sparse_unit
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.keys.values import BY_FORM, Matrix, Positive, key
from fvi_cli.scenes.records.inputs import FromFile, kept_numbers
from fvi_cli.scenes.structures.matrix_files import read_matrix, read_vector


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
    def form(self) -> Form:
        """The matrix."""
        return _matrix_of_digest(str(self.digest))


class Vector(FromFile):
    """A list of numbers from a file."""

    file: str = key("Text with a number in every line, from the folder of the configuration.")

    def read(self, path: Path, name: str) -> Array:
        """The numbers, shape ``(n,)``."""
        return read_vector(path, name)


NumberOrMatrix = Annotated[float | Matrix | MatrixFile, BY_FORM]
PositiveOrMatrix = Annotated[Positive | Matrix | MatrixFile, BY_FORM]


def matrix_size(value: object) -> int | None:
    """Number of rows of a matrix; None for a number."""
    if isinstance(value, MatrixFile):
        return int(value.form.shape[0])
    return len(value) if isinstance(value, list) else None


def is_sparse_file(value: object) -> bool:
    """Whether a value is a sparse matrix from a file."""
    return isinstance(value, MatrixFile) and is_sparse(value.form)


def matrix_of(value: object, dimension: int, *, sparse: bool = False) -> Form:
    """A number times the unit matrix (sparse if requested), or a matrix unchanged."""
    if isinstance(value, MatrixFile):
        return value.form
    if is_sparse(value):
        return cast("SparseMatrix", value)
    matrix = np.asarray(value, dtype=float)
    if matrix.ndim:
        return matrix
    return float(matrix) * sparse_unit(dimension) if sparse else matrix * np.eye(dimension)
