"""Gauss and Lobatto quadrature on [0, 1], with any number of points up to 64.

Nodes are roots of Legendre polynomials and of their derivatives; weights by Davis and Rabinowitz,
*Methods of Numerical Integration*, section 2.7.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import Legendre

from fvi_cli.mathematics.arrays import Array, LongArray

LARGEST_RULE = 64
"""Largest number of points that the rules are made for."""

# Newton's method in extended precision starts from eigenvalues that are right to about 1e-14.
_NEWTON_STEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadratureRule:
    """The integral of f over [0, 1] is about ``sum_i b_i f(c_i)``."""

    nodes: Array  # the c_i, increasing, and the b_i, positive; shape (n,), read-only
    weights: Array
    order: int  # 2n for Gauss, 2n - 2 for Lobatto

    def __post_init__(self) -> None:
        self.nodes.setflags(write=False)
        self.weights.setflags(write=False)

    @property
    def n_points(self) -> int:
        """Number of nodes n."""
        return int(self.nodes.size)


@cache
def gauss_rule(n_points: int) -> QuadratureRule:
    """The Gauss-Legendre rule with 1 to 64 points.

    With the roots x_i of the Legendre polynomial P_n the weights on [0, 1] are
    ``1 / ((1 - x_i^2) P_n'(x_i)^2)``.
    """
    roots: LongArray = Legendre.basis(n_points).roots().astype(np.longdouble)
    for _ in range(_NEWTON_STEPS):
        value, slope = _legendre(n_points, roots)
        roots = roots - value / slope
    _, slope = _legendre(n_points, roots)
    return _symmetric_rule(roots, np.reciprocal((1 - roots**2) * slope**2), 2 * n_points)


@cache
def lobatto_rule(n_points: int) -> QuadratureRule:
    """The Gauss-Lobatto rule with 2 to 64 points, the first and last of which are 0 and 1.

    The inner nodes are the roots of ``P_{n-1}'``; the weights on [0, 1] are
    ``1 / (n (n-1) P_{n-1}(x_i)^2)``.
    """
    degree, product = n_points - 1, n_points * (n_points - 1)
    inner: LongArray = Legendre.basis(degree).deriv().roots().astype(np.longdouble)
    for _ in range(_NEWTON_STEPS):
        value, slope = _legendre(degree, inner)
        # by Legendre's equation, P'' = (2 x P' - n (n - 1) P) / (1 - x^2)
        inner = inner - slope * (1 - inner**2) / (2 * inner * slope - product * value)
    roots: LongArray = np.concatenate([[np.longdouble(-1)], inner, [np.longdouble(1)]])
    value, _ = _legendre(degree, roots)
    return _symmetric_rule(roots, np.reciprocal(product * value**2), 2 * n_points - 2)


def jacobi_rule(n_points: int, exponent: float) -> tuple[Array, Array]:
    """Nodes and weights for integrals over [0, 1] with the weight ``(1 - u)**exponent``.

    From eigenvalues and eigenvectors of the symmetric tridiagonal matrix of the recurrence
    (Golub and Welsch 1969).
    """
    a, k = exponent, np.arange(1.0, n_points)
    t = 2.0 * k + a
    diagonal = -a * np.append(1.0 / (a + 2.0), a / (t * (t + 2.0)))
    off = np.diag(2.0 * k * (k + a) / (t * np.sqrt(t * t - 1.0)), 1)
    nodes, vectors = np.linalg.eigh(np.diag(diagonal) + off + off.T)
    weights = vectors[0] ** 2
    return (1.0 + nodes) / 2.0, weights / ((exponent + 1.0) * weights.sum())


def _symmetric_rule(roots: LongArray, weights: LongArray, order: int) -> QuadratureRule:
    """Map a rule from [-1, 1] so that node pairs add up to 1 exactly."""
    upper = np.maximum(np.abs(roots), np.abs(roots[::-1]))
    half_up = ((1 + upper) / 2).astype(np.float64)
    # 1 - c is exact for c in [1/2, 1].
    nodes = np.where(np.arange(roots.size) < roots.size // 2, 1.0 - half_up, half_up)
    if roots.size % 2:
        nodes[roots.size // 2] = 0.5
    mean = ((weights + weights[::-1]) / 2).astype(np.float64)
    return QuadratureRule(nodes=nodes, weights=mean, order=order)


def _legendre(degree: int, x: LongArray) -> tuple[LongArray, LongArray]:
    """Value and derivative of the Legendre polynomial P_degree by three-term recurrences."""
    before, value = np.zeros_like(x), np.ones_like(x)
    slope_before, slope = np.zeros_like(x), np.zeros_like(x)
    for n in range(1, degree + 1):
        slope_before, slope = slope, slope_before + (2 * n - 1) * value
        before, value = value, ((2 * n - 1) * x * value - (n - 1) * before) / np.longdouble(n)
    return value, slope
