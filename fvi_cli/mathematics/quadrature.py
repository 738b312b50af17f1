"""Gauss and Lobatto quadrature on [0, 1], with any number of points up to 64.

Nodes are roots of Jacobi polynomials; weights by Davis and Rabinowitz, *Methods of Numerical
Integration*, section 2.7. Tests check for every rule which polynomials it integrates exactly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from fvi_cli.mathematics.arrays import Array, LongArray

LARGEST_RULE = 64
"""Largest number of points that the rules are made for."""

_ORDER_DEFICIT = {"gauss": 0, "lobatto": 2}  # 2n minus the order
# Newton's method starts from eigenvalues that are right to about 1e-15 and converges
# quadratically; the third step only catches what the second one rounds.
_NEWTON_STEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class QuadratureRule:
    """The integral of f over [0, 1] is about ``sum_i b_i f(c_i)``."""

    name: str  # gauss or lobatto; it fixes the order
    nodes: Array  # the c_i, increasing, and the b_i, positive; shape (n,), read-only
    weights: Array

    def __post_init__(self) -> None:
        self.nodes.setflags(write=False)
        self.weights.setflags(write=False)

    @property
    def n_points(self) -> int:
        """Number of nodes n."""
        return int(self.nodes.size)

    @property
    def order(self) -> int:
        """Order of the rule: 2n for Gauss, 2n - 2 for Lobatto."""
        return 2 * self.n_points - _ORDER_DEFICIT[self.name]


@cache
def gauss_rule(n_points: int) -> QuadratureRule:
    """The Gauss-Legendre rule with 1 to 64 points.

    With the roots x_i of the Legendre polynomial P_n the weights on [0, 1] are
    ``1 / ((1 - x_i^2) P_n'(x_i)^2)``.
    """
    roots = _jacobi_roots(n_points, 0, 0)
    _, slopes = _jacobi(n_points, 0, 0, roots)
    return _symmetric_rule("gauss", roots, np.reciprocal((1 - roots**2) * slopes**2))


@cache
def lobatto_rule(n_points: int) -> QuadratureRule:
    """The Gauss-Lobatto rule with 2 to 64 points, the first and last of which are 0 and 1.

    The inner nodes are the roots of ``P_{n-1}'``; the weights on [0, 1] are
    ``1 / (n (n-1) P_{n-1}(x_i)^2)``.
    """
    one = np.ones(1, dtype=np.longdouble)
    roots = np.concatenate([-one, _jacobi_roots(n_points - 2, 1, 1), one])
    legendre, _ = _jacobi(n_points - 1, 0, 0, roots)
    return _symmetric_rule("lobatto", roots, np.reciprocal(n_points * (n_points - 1) * legendre**2))


def jacobi_rule(n_points: int, exponent: float) -> tuple[Array, Array]:
    """Nodes and weights for integrals over [0, 1] with the weight ``(1 - u)**exponent``.

    The weights on [-1, 1] are in the ratios of ``1 / ((1 - x_i^2) P_n'(x_i)^2)``.
    """
    roots = _jacobi_roots(n_points, exponent, 0)
    _, slopes = _jacobi(n_points, exponent, 0, roots)
    weights = np.reciprocal((1 - roots**2) * slopes**2)
    weights /= (exponent + 1.0) * weights.sum()
    return ((1 + roots) / 2).astype(np.float64), weights.astype(np.float64)


def _symmetric_rule(name: str, roots: LongArray, weights: LongArray) -> QuadratureRule:
    """Map a rule from [-1, 1] so that node pairs add up to 1 exactly."""
    upper = np.maximum(np.abs(roots), np.abs(roots[::-1]))
    half_up = ((1 + upper) / 2).astype(np.float64)
    # 1 - c is exact for c in [1/2, 1].
    nodes = np.where(np.arange(roots.size) < roots.size // 2, 1.0 - half_up, half_up)
    if roots.size % 2:
        nodes[roots.size // 2] = 0.5
    return QuadratureRule(
        name=name, nodes=nodes, weights=((weights + weights[::-1]) / 2).astype(np.float64)
    )


def _jacobi_roots(degree: int, a: float, b: float) -> LongArray:
    """Roots of the Jacobi polynomial P_degree^{(a,b)}, increasing.

    Eigenvalues of the symmetric tridiagonal matrix (Golub and Welsch 1969), then Newton's method
    in extended precision where the machine has it.
    """
    if degree == 0:
        return np.empty(0, dtype=np.longdouble)
    n = np.arange(degree, dtype=np.float64)
    total = 2 * n + a + b
    diagonal = np.full(degree, (b - a) / (a + b + 2.0))
    diagonal[1:] = (b * b - a * a) / (total[1:] * (total[1:] + 2))
    k, t = n[1:], total[1:]
    squares = 4 * k * (k + a) * (k + b) * (k + a + b) / (t * t * (t + 1) * np.maximum(t - 1, 1))
    # For k = 1 the factors k + a + b and t - 1 cancel; written out they may be 0/0.
    squares[:1] = 4 * (1 + a) * (1 + b) / ((2 + a + b) ** 2 * (3 + a + b))
    off = np.sqrt(squares)
    matrix = np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1)
    roots = np.linalg.eigvalsh(matrix).astype(np.longdouble)
    for _ in range(_NEWTON_STEPS):
        values, slopes = _jacobi(degree, a, b, roots)
        roots = roots - values / slopes
    return roots


def _jacobi(degree: int, a: float, b: float, x: LongArray) -> tuple[LongArray, LongArray]:
    """Value and derivative of P_degree^{(a,b)} at `x` by the three-term recurrence.

    The recurrence is differentiated as it stands, so that the end points need no special case.
    """
    before, value = np.zeros_like(x), np.ones_like(x)
    slope_before, slope = np.zeros_like(x), np.zeros_like(x)
    for n in range(1, degree + 1):
        t = 2 * n + a + b
        if n == 1:
            scale, shift, factor, back = 2.0, a - b, a + b + 2, 0.0
        else:
            scale = 2 * n * (n + a + b) * (t - 2)
            shift = (t - 1) * (a * a - b * b)
            factor = (t - 2) * (t - 1) * t
            back = 2 * (n + a - 1) * (n + b - 1) * t
        line = shift + factor * x
        following = line * value - back * before
        slope_following = factor * value + line * slope - back * slope_before
        before, value = value, following / np.longdouble(scale)
        slope_before, slope = slope, slope_following / np.longdouble(scale)
    return value, slope
