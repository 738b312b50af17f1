"""Matrices as they are best kept, dense or sparse, and equations with them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class SparseMatrix(Protocol):
    """What is asked of a sparse matrix; SciPy is loaded only where there is one."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers of rows and columns."""

    def __matmul__(self, other: Array) -> Array:
        """The matrix times columns."""

    def toarray(self) -> Array:
        """The matrix with all its zeros."""


Form = Array | SparseMatrix
Solve = Callable[[Array], Array]

LEAST_SPARSE = 32
"""Rows from which on a matrix may be worth keeping as sparse."""
SPARSE_DENSITY = 0.1
"""A matrix with fewer entries, relative to all places, is taken as sparse."""
LARGEST_INVERSE = 200
"""Unknowns up to which a system is inverted: a product is quicker than two triangular solves."""


def form(matrix: Array) -> Form:
    """A matrix as sparse where that is worth while."""
    rows = matrix.shape[0]
    if rows < LEAST_SPARSE or np.count_nonzero(matrix) > SPARSE_DENSITY * matrix.size:
        return matrix
    from scipy.sparse import csr_array

    return cast("SparseMatrix", csr_array(matrix))


def dense(matrix: Form) -> Array:
    """A matrix with all its zeros."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.toarray())


def times(values: Array, matrix: Form) -> Array:
    """Rows of values ``(..., d)`` times a symmetric matrix."""
    if isinstance(matrix, np.ndarray):
        return np.asarray(values @ matrix)
    flat = values.reshape(-1, values.shape[-1])
    return np.asarray((matrix @ flat.T).T.reshape(values.shape))


def kronecker(a: Array, b: Array) -> Array:
    """The Kronecker product of two matrices; ``numpy.kron`` is slow on small ones."""
    rows, columns = a.shape[0] * b.shape[0], a.shape[1] * b.shape[1]
    return np.asarray((a[:, None, :, None] * b[None, :, None, :]).reshape(rows, columns))


def solver_of(parts: list[tuple[Array, Form]]) -> Solve:
    """What solves equations with the sum of Kronecker products of small and large matrices.

    Parameters
    ----------
    parts
        Pairs of an ``(s, s)`` and a ``(d, d)`` matrix.

    Returns
    -------
    callable
        From right-hand sides ``(s d,)`` to solutions.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.
    """
    size = parts[0][0].shape[0] * parts[0][1].shape[0]
    if all(isinstance(large, np.ndarray) for _, large in parts):
        total = np.zeros((size, size))
        for small, large in parts:
            total += kronecker(small, np.asarray(large))
        if size <= LARGEST_INVERSE:
            return np.linalg.inv(total).__matmul__
        from scipy.linalg import lu_factor, lu_solve

        factors = lu_factor(total)
        if not np.abs(np.diagonal(factors[0])).min() > 0:
            raise np.linalg.LinAlgError("Singular matrix")
        return lambda right: np.asarray(lu_solve(factors, right))
    from scipy.sparse import csc_array, csr_array, kron
    from scipy.sparse.linalg import splu

    # the components of a step side by side: the band of the large matrices stays narrow
    whole = csc_array((size, size))
    for small, large in parts:
        whole = whole + kron(cast("csr_array", large), small, format="csc")
    try:
        factorised = splu(csc_array(whole))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error
    s = parts[0][0].shape[0]

    def solve(right: Array) -> Array:
        swapped = right.reshape(s, -1).T.ravel()
        return np.asarray(factorised.solve(swapped).reshape(-1, s).T.ravel())

    return solve
