"""Symmetric matrices of effects, dense or sparse, checked, and products with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.errors import ArgumentError
from fvi_cli.mathematics.arrays import Array, Places

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array
    from scipy.sparse.linalg import SuperLU

SYMMETRY_TOLERANCE = 1e-12
"""Largest difference of an entry and its mirror image, relative to the largest entry."""
LEAST_SPARSE = 32
"""Rows from which on a matrix may be worth keeping as sparse."""
SPARSE_DENSITY = 0.1
"""A matrix with a smaller share of nonzero entries is kept as sparse."""
LEAST_SCALED = 1e-14
"""Least eigenvalue of a positive definite matrix with unit diagonal, over its number of rows: below
that it is singular up to round-off."""


class SparseMatrix(Protocol):
    """A sparse matrix, with operations of arrays; SciPy is loaded only where there is one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of rows and columns."""

    def __add__(self, other: Any, /) -> Any: ...
    def __radd__(self, other: Any, /) -> Any: ...
    def __rmul__(self, factor: float, /) -> Any: ...
    def __matmul__(self, other: Array, /) -> Array: ...

    def diagonal(self) -> Array:
        """The entries on the diagonal, shape ``(d,)``."""

    def nonzero(self) -> tuple[Places, Places]:
        """Rows and columns of the entries that are not zero."""

    def toarray(self) -> Array:
        """The matrix with all its zeros."""


Form: TypeAlias = Array | SparseMatrix
"""A dense or a sparse matrix."""
Solve = Callable[[Array], Array]
"""From right-hand sides, shape ``(d,)`` or ``(d, n)``, to solutions."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Factored:
    r"""A symmetric matrix :math:`B^T C B` of low rank, of a force along directions.

    Raises
    ------
    ValueError
        If C is neither a number nor a symmetric r x r matrix.
    """

    rows: Array  # B, shape (r, d): the directions
    inner: Array  # C, symmetric, shape (r, r); a number stands for its multiple of the unit matrix

    def __post_init__(self) -> None:
        count = len(self.rows)
        inner = np.asarray(self.inner, dtype=float)
        inner = inner * np.eye(count) if inner.ndim == 0 else inner
        inner = dense(symmetric_form(inner, "coefficient"))
        if len(inner) != count:
            words = f"a matrix of size {len(inner)} for {count} entries in acts_on"
            raise ArgumentError("coefficient", words)
        object.__setattr__(self, "inner", inner)

    @cached_property
    def form(self) -> Form:
        """The d x d matrix, sparse where it has many rows."""
        rows: Any = self.rows  # dense or sparse: only operators that both have are used
        rows = rows if rows.shape[1] < LEAST_SPARSE else as_csr(rows)
        full = rows.T @ (as_csr(self.inner) if is_sparse(rows) else self.inner) @ rows
        return symmetric_form(0.5 * (full + full.T), "coefficient")


def is_sparse(matrix: object) -> bool:
    """Whether a matrix is sparse."""
    return hasattr(matrix, "toarray")


def as_csr(matrix: Form) -> csr_array[np.float64]:
    """A matrix in compressed rows."""
    from scipy.sparse import csr_array

    found = csr_array(cast("csr_array[np.float64]", matrix))
    return found if found.dtype == np.float64 else csr_array(found.astype(np.float64))


def as_csc(matrix: Form) -> csc_array[np.float64]:
    """A matrix in compressed columns."""
    from scipy.sparse import csc_array

    return csc_array(cast("csr_array[np.float64]", matrix), dtype=np.float64)


def symmetric_form(value: ArrayLike | SparseMatrix, name: str) -> Form:
    """`value` as a read-only symmetric float matrix; a number becomes 1 x 1.

    A sparse matrix stays sparse, unless it has few rows: then the dense matrix is quicker.

    Raises
    ------
    ArgumentError
        If it is not square, not finite or not symmetric to 1e-12 relative.
    """
    matrix: Any  # dense or sparse: only operators that both have are used
    if is_sparse(value):
        matrix = as_csr(cast(SparseMatrix, value))
        matrix.sum_duplicates()
        matrix = matrix.toarray() if matrix.shape[0] < LEAST_SPARSE else matrix
    else:
        matrix = np.array(value, dtype=float)
        matrix = matrix.reshape(1, 1) if matrix.ndim == 0 else matrix
    shape = matrix.shape
    if len(shape) != 2 or shape[0] != shape[1] or shape[0] == 0:
        raise ArgumentError(name, f"shape {shape} is not allowed; give a number or a square matrix")
    if isinstance(matrix, np.ndarray):
        matrix.setflags(write=False)
    largest = abs(matrix).max()
    if not np.isfinite(largest):
        raise ArgumentError(name, "every entry must be finite")
    off = abs(matrix - matrix.T).max()
    if off > SYMMETRY_TOLERANCE * largest:
        raise ArgumentError(
            name, f"it differs by {off:.3g} from its mirror image; it must be symmetric"
        )
    return cast(Form, matrix)


@dataclass(frozen=True, kw_only=True, eq=False, init=False)
class MatrixEffect:
    """An effect that is a symmetric matrix."""

    form: Form  # the matrix as it is kept, shape (d, d)

    @property
    def dimension(self) -> int:
        """Number d of degrees of freedom."""
        return int(self.form.shape[0])


def form(matrix: Form) -> Form:
    """A matrix, converted to sparse where that is worth while."""
    if not isinstance(matrix, np.ndarray):
        return matrix
    rows = matrix.shape[0]
    if rows < LEAST_SPARSE or np.count_nonzero(matrix) > SPARSE_DENSITY * matrix.size:
        return matrix
    return cast("SparseMatrix", as_csr(matrix))


def dense(matrix: Form) -> Array:
    """A matrix with all its zeros."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


def times(values: Array, matrix: Form) -> Array:
    """Rows of values ``(..., d)`` times a symmetric matrix."""
    if isinstance(matrix, np.ndarray):
        return np.asarray(values @ matrix)
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray((matrix @ flat.T).T.reshape(values.shape))


def sparse_unit(dimension: int) -> SparseMatrix:
    """The unit matrix as a sparse matrix."""
    from scipy.sparse import eye_array

    return cast(SparseMatrix, eye_array(dimension, format="csr"))


def entries(matrix: Form) -> Array:
    """The entries that are kept, shape ``(n,)``; all of a dense matrix."""
    return matrix.ravel() if isinstance(matrix, np.ndarray) else np.asarray(as_csr(matrix).data)


def touched(matrix: Form) -> NDArray[np.bool_]:
    """Which rows of a matrix have entries other than zero, shape ``(d,)``."""
    found = np.zeros(matrix.shape[0], dtype=bool)
    found[matrix.nonzero()[0]] = True
    return found


def solver(matrix: Form) -> Solve:
    """A function that solves equations with a symmetric matrix.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.
    """
    if isinstance(matrix, np.ndarray):
        return lambda right: np.asarray(np.linalg.solve(matrix, right))
    factors = factors_of(as_csc(matrix))
    return lambda right: np.asarray(factors.solve(np.ascontiguousarray(right)))


def factors_of(matrix: csc_array[Any], least_pivot: float = 0.1) -> SuperLU:
    """Factors of a matrix with a symmetric pattern.

    A pivot stays on the diagonal unless it is less than `least_pivot` times its column's largest
    entry.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.
    """
    from scipy.sparse.linalg import splu

    try:
        return splu(
            matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=least_pivot,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error


def negative_pivots(matrix: SparseMatrix) -> int:
    """Number of pivots that are not positive in an elimination without exchange of rows.

    By Sylvester's law of inertia this is the number of eigenvalues of a sparse symmetric matrix
    that are not positive; where the elimination breaks down it is the number of rows.
    """
    try:
        factors = factors_of(as_csc(matrix), least_pivot=0.0)
    except np.linalg.LinAlgError:
        return int(matrix.shape[0])
    if not np.array_equal(factors.perm_r, factors.perm_c):
        return int(matrix.shape[0])
    return int(np.count_nonzero(~(factors.U.diagonal() > 0)))


def indefinite_words(matrix: Form) -> str:
    """Why a symmetric matrix is not positive definite, a dense one beyond its round-off."""
    if isinstance(matrix, np.ndarray):
        return _singular_words(matrix)
    wrong = "an eigenvalue is zero or negative; a mass must be positive definite"
    return wrong if negative_pivots(matrix) else ""


SEMIDEFINITE_TOLERANCE = 1e-13
"""Negative eigenvalues up to this, relative to the largest entry, are round-off."""


def is_semidefinite(matrix: Form) -> bool:
    """Whether a symmetric matrix has no negative eigenvalue but for round-off."""
    largest = float(np.abs(entries(matrix)).max(initial=0.0))
    if largest == 0.0:
        return True
    if isinstance(matrix, np.ndarray):
        return bool(np.linalg.eigvalsh(matrix)[0] >= -SEMIDEFINITE_TOLERANCE * largest)
    slack = SEMIDEFINITE_TOLERANCE * largest * sparse_unit(matrix.shape[0])
    return negative_pivots(matrix + slack) == 0


def _least_scaled_eigenvalue(matrix: Array) -> Array:
    """Least eigenvalues of symmetric matrices whose diagonals are scaled to 1, ``(..., d, d)``.

    The result does not depend on the units of the coordinates. It is not positive where an entry of
    the diagonal is not positive.
    """
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    least = diagonal.min(axis=-1)
    root = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = matrix / root[..., :, None] / root[..., None, :]
    return np.where(least > 0, np.linalg.eigvalsh(scaled)[..., 0], np.minimum(least, 0.0))


def _singular_words(matrix: Array) -> str:
    """Why a matrix is not positive definite beyond round-off; empty where it is."""
    if matrix.size == 1 and matrix[0, 0] > 0:
        # sweeps have many masses of one coordinate
        return ""
    least = float(_least_scaled_eigenvalue(matrix))
    if least > LEAST_SCALED * len(matrix):
        return ""
    return (
        f"its smallest eigenvalue is {least:.2g} where its diagonal is scaled to 1; a mass must be "
        "positive definite: give every motion a mass, or take its coordinate away"
    )
