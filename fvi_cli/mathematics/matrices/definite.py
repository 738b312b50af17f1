"""Whether a symmetric matrix is positive definite beyond its round-off."""

from __future__ import annotations

import numpy as np

from fvi_cli.mathematics.arrays import Array

LEAST = 1e-14
"""Least eigenvalue of a matrix whose diagonal is one, for each of its rows: below, it is the
round-off of a singular one."""


def least_scaled_eigenvalue(matrix: Array) -> float:
    """Least eigenvalue of a symmetric matrix whose rows and columns are scaled to a diagonal of 1.

    The units of the coordinates do not count. Not positive where an entry of the diagonal is not.
    """
    diagonal = np.diagonal(matrix)
    if not (diagonal > 0).all():
        return float(min(diagonal.min(), 0.0))
    root = np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(matrix / root[:, None] / root)[0])


def singular_words(matrix: Array) -> str:
    """Why a matrix is not positive definite beyond round-off; empty where it is."""
    least, bound = least_scaled_eigenvalue(matrix), LEAST * len(matrix)
    if least > bound:
        return ""
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    if least < -bound:
        return f"smallest eigenvalue is {smallest:g}; a mass must be positive definite"
    return (
        f"smallest eigenvalue is {smallest:.3g}, {least:.1e} where its diagonal is scaled to 1: "
        "the matrix is singular up to round-off, a motion without any mass; a mass must be "
        "positive definite: give that motion a mass, or take its coordinate away"
    )
