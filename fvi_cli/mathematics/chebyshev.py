r"""Chebyshev series :math:`\sum_k c_k T_k(z)` on [-1, 1], many at once.

Sources: Trefethen, *Approximation Theory and Approximation Practice*, SIAM 2013; Boyd, *Solving
Transcendental Equations*, SIAM 2014, chapters 2 and 3.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from fvi_cli.mathematics.arrays import Array, Places


def second_kind_points(count: int) -> Array:
    """The extremes of :math:`T_{n-1}` from -1 to 1, shape ``(n,)``."""
    return np.asarray(-np.cos(np.pi * np.arange(count) / (count - 1)))


def to_coefficients(points: Array) -> Array:
    """From values at k points to the coefficients of the polynomial through them, ``(k, k)``."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(points, points.size - 1)), dtype=float)


def evaluate_series(coefficients: Array, rows: Places, z: Array) -> Array:
    """Values of some of N series at places of their own, by Clenshaw's recurrence.

    From coefficients ``(K, N, d)``, numbers of the series and places in [-1, 1], both ``(n,)``, to
    ``(n, d)``; where each has k places, from ``(n, 1)`` and ``(n, k)`` to ``(n, k, d)``.
    """
    z = z[..., None]
    last, before = coefficients[-1][rows], np.zeros(())
    if len(coefficients) == 1:
        return np.array(np.broadcast_to(last, (*z.shape[:-1], last.shape[-1])))
    for one in coefficients[-2:0:-1]:
        last, before = one[rows] + 2.0 * z * last - before, last
    return np.asarray(coefficients[0][rows] + z * last - before)


def slopes_of_series(size: int) -> Array:
    """From K coefficients to those of the derivative, ``(K, max(K - 1, 1))``."""
    return np.asarray(chebyshev.chebder(np.eye(size), axis=0).T)


def products_of_series(size: int) -> Array:
    r""":math:`\int_{-1}^1 T_k T_l`, shape ``(K, K)``."""
    degrees = np.arange(size)
    integrals = np.array([0.0 if k % 2 else 2.0 / (1.0 - k * k) for k in range(2 * size)])
    sums, gaps = degrees[:, None] + degrees, np.abs(degrees[:, None] - degrees)
    return np.asarray(0.5 * (integrals[sums] + integrals[gaps]))


def roots_of_series(coefficients: Array) -> tuple[Places, Array]:
    """Real roots in (-1, 1) of series ``(n, K)``: the number of each root's series, and the roots.

    They are eigenvalues of the colleague matrix, in the symmetric scaling of NumPy's
    ``chebcompanion``; nearly double roots leave the real axis by the root of round-off. A last
    coefficient that is round-off moves them, so two steps of Newton follow.
    """
    size = np.abs(coefficients)
    counted = size > 1e-14 * size.max(axis=1, keepdims=True, initial=0.0)
    degrees = np.where(counted, np.arange(size.shape[1]), 0).max(axis=1, initial=0)
    owners, roots = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    for degree in np.unique(degrees[degrees > 0]).tolist():
        own = np.flatnonzero(degrees == degree)
        matrix = np.zeros((own.size, degree, degree))
        off_diagonal = np.full(degree - 1, 0.5)
        off_diagonal[:1] = np.sqrt(0.5)
        index = np.arange(degree - 1)
        matrix[:, index, index + 1] = matrix[:, index + 1, index] = off_diagonal
        scale = np.full(degree, np.sqrt(0.5))
        scale[0] = 1.0
        series = coefficients[own, : degree + 1]
        factor = 0.5 if degree > 1 else 1.0
        matrix[:, :, -1] -= factor * series[:, :-1] / series[:, -1:] * (scale / scale[-1])
        values = np.linalg.eigvals(matrix)
        near = (np.abs(values.imag) < 1e-4) & (np.abs(values.real) < 1.1)
        which, found = np.nonzero(near)[0], values.real[near]
        columns = series[which].T
        slopes = chebyshev.chebder(columns)
        for _ in range(2):
            rate = chebyshev.chebval(found, slopes, tensor=False)
            step = chebyshev.chebval(found, columns, tensor=False) / np.where(rate, rate, np.inf)
            found = found - np.clip(step, -0.1, 0.1)
        kept = np.abs(found) < 1.0
        owners.append(own[which[kept]])
        roots.append(found[kept])
    return np.concatenate(owners), np.concatenate(roots)
