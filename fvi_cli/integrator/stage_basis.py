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
    from fvi_cli.mathematics.runge_kutta_weights import ExponentialSum

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
    return legendre_exponentials(tableau, theta, max(n_weights - 1, 1)).weights(n_weights)


def legendre_exponentials(tableau: ButcherTableau, theta: float, n_steps: int) -> ExponentialSum:
    """The same weights as a sum of exponentials, good up to ``w_n`` with n = `n_steps`.

    Ratios and rows depend on the method and `n_steps`, not on `theta`.
    """
    from fvi_cli.mathematics.runge_kutta_weights import exponential_sum, real_axis_rule

    m, basis = tableau.n_stages, legendre_stages(tableau.c)
    if tableau.name != "gauss" or theta == 0 or m == 1:
        exponentials = exponential_sum(tableau, theta, n_steps)
        return replace(
            exponentials,
            instantaneous=basis.to_coefficients @ exponentials.instantaneous @ basis.to_values,
            columns=exponentials.columns @ basis.to_coefficients.T,
            rows=exponentials.rows @ basis.to_values,
        )
    # X equals its transpose up to the signs of every other row and column
    signs = (-1.0) ** np.arange(m)

    def vectors(nodes: Array) -> tuple[Array, Array]:
        columns = _gauss_resolvent(nodes, m)
        return columns, columns * signs

    exponentials = exponential_sum(tableau, theta, n_steps, vectors)
    first = basis.to_coefficients @ exponentials.instantaneous @ basis.to_values
    if theta > 0:
        nodes, factors = real_axis_rule(theta, n_steps)
        first[0] = _balancing_row(nodes, factors, exponentials.rows, theta)
        first[1:, 0] = (signs * first[0])[1:]
    return replace(exponentials, instantaneous=first)


def _gauss_resolvent(nodes: Array, m: int) -> Array:
    r"""First column of :math:`(1 + x X)^{-1}` with full relative accuracy in every entry.

    In Legendre coefficients the matrix A of a Gauss method is tridiagonal, :math:`X_{11} = 1/2`
    and :math:`\mp \xi_k`, :math:`\xi_k = 1 / (2 \sqrt{4 k^2 - 1})`, beside the diagonal, and the
    column follows from a continued fraction of positive numbers.

    Parameters
    ----------
    nodes
        The x from 0 to infinity; there, x times the column, shape ``(J,)``.
    m
        Number of stages, at least 2.
    """
    xi = 0.5 / np.sqrt(4.0 * np.arange(1, m) ** 2 - 1.0)
    x = nodes[:-1]
    tails = [np.ones_like(x)]
    for value in xi[:0:-1]:
        tails.append(1.0 + (value * x) ** 2 / tails[-1])
    entries = [1.0 / (1.0 + 0.5 * x + (xi[0] * x) ** 2 / tails[-1])]
    for value, tail in zip(xi, reversed(tails), strict=True):
        entries.append(-value * x * entries[-1] / tail)
    # the limit, from the last equation upwards: every other entry is zero
    limit = np.zeros(m)
    first = 1 if m % 2 == 0 else 0
    limit[first] = -1.0 / xi[0] if first else 2.0
    for index in range(first + 2, m, 2):
        limit[index] = xi[index - 2] / xi[index - 1] * limit[index - 2]
    return np.concatenate([np.stack(entries, axis=1), [limit]])


def _balancing_row(nodes: Array, factors: Array, rows: Array, theta: float) -> Array:
    r"""First row of w_0 for theta > 0, so that the first rows of all weights sum to zero.

    A constant velocity leaves no damping force in the end. Summed over n, the term of a node is
    its row over x, because :math:`1 - R(-x)` is x times the first entry of its column.
    """
    step = float(np.log(nodes[2] / nodes[1]))
    total = (factors[1:-1] / nodes[1:-1]) @ rows[1:-1] + factors[-1] * rows[-1]
    # below the first node the rows are (1, 0, ..), and what remains is a geometric series
    total[0] += factors[1] / nodes[1] / np.expm1(step * theta)
    return np.asarray(-total)
