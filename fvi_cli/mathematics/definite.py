"""Find whether a symmetric matrix is positive definite beyond its round-off."""

from __future__ import annotations

import numpy as np

from fvi_cli.mathematics.arrays import Array

LEAST = 1e-14
"""Least eigenvalue of a positive definite matrix with unit diagonal, over its number of rows: below
that it is singular up to round-off."""


def least_scaled_eigenvalue(matrix: Array) -> Array:
    """Least eigenvalues of symmetric matrices whose diagonals are scaled to 1, ``(..., d, d)``.

    The result does not depend on the units of the coordinates. It is not positive where an entry of
    the diagonal is not positive.
    """
    diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
    least = diagonal.min(axis=-1)
    root = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = matrix / root[..., :, None] / root[..., None, :]
    return np.where(least > 0, np.linalg.eigvalsh(scaled)[..., 0], np.minimum(least, 0.0))


def singular_words(matrix: Array) -> str:
    """Why a matrix is not positive definite beyond round-off; empty where it is."""
    if matrix.size == 1 and matrix[0, 0] > 0:
        # sweeps have many masses of one coordinate
        return ""
    least = float(least_scaled_eigenvalue(matrix))
    if least > LEAST * len(matrix):
        return ""
    return (
        f"its smallest eigenvalue is {least:.2g} where its diagonal is scaled to 1; a mass must be "
        "positive definite: give every motion a mass, or take its coordinate away"
    )
