"""Checks shared by the effects that are given as matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def symmetric_matrix(value: ArrayLike, name: str) -> Array:
    """Return `value` as a read-only symmetric float matrix; a number becomes 1 x 1.

    Raises
    ------
    ValueError
        If it is not square, not finite or not symmetric to 1e-12 relative.
    """
    matrix = np.array(value, dtype=float)
    if matrix.ndim == 0:
        matrix = matrix.reshape(1, 1)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or matrix.size == 0:
        raise ValueError(
            f"{name}: shape {matrix.shape} is not allowed; give a number or a square matrix"
        )
    if not np.all(np.isfinite(matrix)):
        raise ValueError(f"{name}: every entry must be finite")
    if np.abs(matrix - matrix.T).max() > 1e-12 * np.abs(matrix).max():
        raise ValueError(f"{name}: the matrix must be symmetric")
    matrix.setflags(write=False)
    return matrix


def is_diagonal(matrix: Array) -> bool:
    """Whether every entry off the diagonal is zero."""
    return bool(np.count_nonzero(matrix) == np.count_nonzero(np.diagonal(matrix)))
