"""Equations of a step: sums of Kronecker products of small and large matrices."""

from __future__ import annotations

from typing import cast

import numpy as np

from fvi_cli.effects.matrices import Form, Solve, as_csr, factors_of, times, touched
from fvi_cli.mathematics.arrays import Array

FEW = 32
"""A sparse matrix that acts on no more components than this is taken as dense on these."""
LARGEST_OFF_DIAGONAL = 1e-12
"""Entries off the diagonal up to this, relative to the largest entry, are round-off."""


def kronecker(a: Array, b: Array) -> Array:
    """The Kronecker product of two matrices; ``numpy.kron`` is slow on small ones."""
    rows, columns = a.shape[0] * b.shape[0], a.shape[1] * b.shape[1]
    return np.asarray((a[:, None, :, None] * b[None, :, None, :]).reshape(rows, columns))


def solver_of(parts: list[tuple[Array, Form]]) -> Solve:
    """A function that solves equations with a sum of Kronecker products, ``(s d,)`` to the same.

    Parts are pairs of an ``(s, s)`` and a ``(d, d)`` matrix.

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
        from scipy.linalg import lu_factor, lu_solve

        factors = lu_factor(total)
        if not np.abs(np.diagonal(factors[0])).min() > 0:
            raise np.linalg.LinAlgError("Singular matrix")
        return lambda right: np.asarray(lu_solve(factors, right))
    modal = _stagewise(parts)
    if modal is not None:
        return modal
    from scipy.sparse import csc_array, csr_array, kron

    # the unknowns of one component are neighbours: the band of the large matrices stays narrow
    whole = csc_array((size, size))
    for small, large in parts:
        whole = whole + kron(cast("csr_array", large), small, format="csc")
    factorised = factors_of(csc_array(whole))
    s = parts[0][0].shape[0]

    def solve(right: Array) -> Array:
        swapped = right.reshape(s, -1).T.ravel()
        return np.asarray(factorised.solve(swapped).reshape(-1, s).T.ravel())

    return solve


def _stagewise(parts: list[tuple[Array, Form]]) -> Solve | None:
    """As `solver_of`, in coordinates in which all small matrices are diagonal, or None.

    The small matrices are the first one times functions of the method's matrix. In its eigenvectors
    the equations decouple into complex ones of the size of the large matrices, half of them the
    conjugates of the others.
    """
    from scipy.sparse import csc_array

    first = np.linalg.inv(parts[0][0])
    quotients = [first @ small for small, _ in parts]
    s, d = first.shape[0], parts[0][1].shape[0]
    values, vectors = np.linalg.eig(quotients[-1])
    back = np.linalg.inv(vectors)
    along = [back @ one @ vectors for one in quotients]
    for one in along:
        off_diagonal = one - np.diag(np.diagonal(one))
        if np.abs(off_diagonal).max(initial=0.0) > LARGEST_OFF_DIAGONAL * np.abs(one).max():
            return None
    chosen = np.flatnonzero(values.imag >= 0)
    into = (back @ first)[chosen]
    outof = vectors[:, chosen] * np.where(values[chosen].imag > 0, 2.0, 1.0)
    factors = []
    for k in chosen:
        whole = csc_array((d, d), dtype=complex)
        for one, (_, large) in zip(along, parts, strict=True):
            whole = whole + csc_array(as_csr(large), dtype=complex) * complex(one[k, k])
        factors.append(factors_of(csc_array(whole)))

    whole_ones, few = [], []
    for small, large in parts:
        places = np.flatnonzero(touched(large))
        if places.size > FEW:
            whole_ones.append((small, large))
        else:
            few.append((small, places, as_csr(large)[places][:, places].toarray()))

    def solved(right: Array) -> Array:
        given = into @ right
        found = np.stack([one.solve(row) for one, row in zip(factors, given, strict=True)])
        return np.asarray((outof @ found).real)

    def solve(right: Array) -> Array:
        rows = right.reshape(s, d)
        found = solved(rows)
        left = rows.copy()
        for small, large in whole_ones:
            left -= small @ times(found, large)
        for small, places, inner in few:
            left[:, places] -= small @ (found[:, places] @ inner)
        # eigenvectors of many stages lose digits, which one refinement recovers
        return np.asarray((found + solved(left)).ravel())

    return solve
