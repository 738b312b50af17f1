"""Equations of a step: sums of Kronecker products of small and large matrices."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import Form, Solve

Array = NDArray[np.float64]

LARGEST_INVERSE = 200
"""Unknowns up to which a system is inverted: a product is quicker than two triangular solves."""


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
        factorised = splu(csc_array(whole), permc_spec="MMD_AT_PLUS_A")
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from error
    s = parts[0][0].shape[0]

    def solve(right: Array) -> Array:
        swapped = right.reshape(s, -1).T.ravel()
        return np.asarray(factorised.solve(swapped).reshape(-1, s).T.ravel())

    return solve
