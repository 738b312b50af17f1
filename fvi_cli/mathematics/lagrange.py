"""Lagrange polynomials on [0, 1] in barycentric form."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.mathematics.arrays import Array, set_arrays
from fvi_cli.mathematics.quadrature import lobatto_rule

LARGEST_DEGREE = 20
"""Largest degree that the basis is made for."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LagrangeBasis:
    """The polynomials l_nu of degree s with ``l_nu(d_mu) = delta_{nu mu}``.

    Values by the second barycentric formula, derivatives by interpolation of the derivatives at
    the control points; the diagonal of the differentiation matrix makes its rows sum to zero
    (Berrut and Trefethen, *Barycentric Lagrange interpolation*, SIAM Review 46, 2004, sections 4
    and 9.3).
    """

    control_points: Array  # the points d_0 < ... < d_s in [0, 1], shape (s + 1,); s is 1 to 20
    _barycentric_weights: Array = field(init=False, repr=False)
    _differentiation: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        points = np.array(self.control_points, dtype=np.float64)
        gaps = points[:, None] - points[None, :]
        np.fill_diagonal(gaps, 1.0)
        # Differences four times as large keep the products of a full degree near 1.
        weights = 1 / np.prod(4 * gaps, axis=1)
        differentiation = weights[None, :] / (weights[:, None] * gaps)
        np.fill_diagonal(differentiation, 0.0)
        np.fill_diagonal(differentiation, -differentiation.sum(axis=1))
        set_arrays(
            self,
            control_points=points,
            _barycentric_weights=weights,
            _differentiation=differentiation,
        )

    @property
    def degree(self) -> int:
        """Degree s of the polynomials."""
        return int(self.control_points.size) - 1

    def values(self, points: ArrayLike) -> Array:
        """The ``l_nu(c_i)``, shape ``(s + 1, r)`` for r points; exact at control points."""
        points = np.atleast_1d(np.asarray(points, dtype=np.float64))
        gaps = points[None, :] - self.control_points[:, None]
        met = gaps == 0
        terms = self._barycentric_weights[:, None] / np.where(met, 1.0, gaps)
        at_control_point = met.any(axis=0)
        basis = terms / np.where(at_control_point, 1.0, terms.sum(axis=0))
        return np.where(at_control_point, met.astype(np.float64), basis)

    def derivatives(self, points: ArrayLike) -> Array:
        """The ``l_nu'(c_i)`` with respect to the variable in [0, 1], shape ``(s + 1, r)``."""
        return np.asarray(self._differentiation.T @ self.values(points), dtype=np.float64)


@cache
def lobatto_basis(degree: int) -> LagrangeBasis:
    """The basis on the ``degree + 1`` Lobatto points of [0, 1] (degree 1: 0 and 1)."""
    return LagrangeBasis(control_points=lobatto_rule(degree + 1).nodes)
