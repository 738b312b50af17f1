r"""Legendre coefficients in place of stage values, for the memory of Runge-Kutta methods.

The weights :math:`w_n` of :math:`\Delta(z)^\theta` act on the values of the velocity at the m
stages. For two or more stages the entries that join the differences between stages decay like
:math:`n^{\theta-1}` or not at all, while those that join the mean decay like
:math:`n^{-\theta-1}`: in values the first drown the second in their rounding, and with them the
damping force, the more the smaller the step. With Legendre coefficients :math:`T V` (Hairer,
Wanner, *Solving Ordinary Differential Equations II*, section IV.5, "W-transformation") each part
is rounded on its own, the differences are small because the solution is smooth, and the weights
:math:`T w_n T^{-1}` of a Gauss method equal their transposes up to signs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

if TYPE_CHECKING:
    from fvi_cli.mathematics.runge_kutta import ButcherTableau

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class StageBasis:
    """Matrices between values at the stages and Legendre coefficients, shape ``(m, m)``."""

    to_coefficients: Array
    to_values: Array


def legendre_stages(nodes: Array) -> StageBasis:
    """Orthonormal Legendre polynomials on [0, 1] at the `nodes`: the first one is 1."""
    m = nodes.size
    scales = np.sqrt(2.0 * np.arange(m) + 1.0)
    values = legendre.legvander(2.0 * nodes - 1.0, m - 1) * scales
    return StageBasis(to_coefficients=np.linalg.inv(values), to_values=values)


def legendre_weights(tableau: ButcherTableau, theta: float, n_weights: int) -> Array:
    """Weights of ``Delta(z)^theta`` between Legendre coefficients, shape ``(n_weights, m, m)``."""
    from fvi_cli.mathematics.runge_kutta_weights import exponential_sum

    basis = legendre_stages(tableau.c)
    exponentials = exponential_sum(tableau, theta, max(n_weights - 1, 1))
    return replace(
        exponentials,
        instantaneous=basis.to_coefficients @ exponentials.instantaneous @ basis.to_values,
        columns=exponentials.columns @ basis.to_coefficients.T,
        rows=exponentials.rows @ basis.to_values,
    ).weights(n_weights)
