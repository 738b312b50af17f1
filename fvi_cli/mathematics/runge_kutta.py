"""Tableaux of the Runge-Kutta methods for convolution quadrature, and powers of their matrices.

They fulfil the simplifying assumptions B(p), ``sum_i b_i c_i^(k-1) = 1/k`` for k = 1..p, and C(q),
``sum_j a_ij c_j^(k-1) = c_i^k / k`` for k = 1..q, of Hairer and Wanner, *Solving Ordinary
Differential Equations II*, section IV.5, to which tests hold them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.quadrature import (
    QuadratureRule,
    gauss_rule,
    lobatto_rule,
    radau_right_rule,
)

_RULES = {"gauss": gauss_rule, "radau-iia": radau_right_rule, "lobatto-iiic": lobatto_rule}


@dataclass(frozen=True, kw_only=True, eq=False)
class ButcherTableau:
    """An implicit Runge-Kutta method with m stages and an invertible matrix."""

    name: str  # family of the method, as it stands in tables
    A: Array  # matrix a_ij, shape (m, m), weights b_i and nodes c_i, shape (m,); read-only
    b: Array
    c: Array
    order: int  # p and q of B(p) and C(q)
    stage_order: int

    def __post_init__(self) -> None:
        for array in (self.A, self.b, self.c):
            array.setflags(write=False)

    @property
    def n_stages(self) -> int:
        """Number m of stages."""
        return int(self.b.size)


@cache
def tableau(name: str, n_stages: int) -> ButcherTableau:
    """A method by its name in tables, with m stages.

    ``gauss``: order 2m, stage order m, symmetric and symplectic. ``radau-iia``: order 2m - 1, stage
    order m, stiffly accurate. ``lobatto-iiic``, m > 1: order 2m - 2, stage order m - 1, stiffly
    accurate.
    """
    rule = _RULES[name](n_stages)
    matrix, stage_order = _collocation(rule), n_stages
    if name == "lobatto-iiic":
        matrix, stage_order = _lobatto_iiic(rule, matrix), n_stages - 1
    return ButcherTableau(
        name=name, A=matrix, b=rule.weights, c=rule.nodes, order=rule.order, stage_order=stage_order
    )


def _lobatto_iiic(rule: QuadratureRule, collocation: Array) -> Array:
    """The matrix that ``a_i1 = b_1`` and C(m-1) fix.

    A row that obeys C(m-1) differs from the row of the collocation method by a multiple of the
    divided difference over all nodes, and the first column says which.
    """
    gaps = rule.nodes[:, None] - rule.nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    difference = 1 / np.prod(4 * gaps, axis=1)
    matrix = collocation + np.outer(rule.weights[0] - collocation[:, 0], difference / difference[0])
    matrix[:, 0] = rule.weights[0]
    matrix[-1] = rule.weights
    return matrix


def _collocation(rule: QuadratureRule) -> Array:
    """Matrix ``a_ij``: the integral of the Lagrange polynomial l_j from 0 to c_i.

    The polynomials are products of differences, which lose nothing, and Gauss quadrature with m
    points is exact for their degree m - 1.
    """
    nodes = rule.nodes.astype(np.longdouble)
    fine = gauss_rule(nodes.size)
    points = nodes[:, None] * fine.nodes[None, :]
    matrix = np.empty((nodes.size, nodes.size))
    for j in range(nodes.size):
        others = np.delete(nodes, j)
        basis = np.prod((points[:, :, None] - others) / (nodes[j] - others), axis=2)
        matrix[:, j] = nodes * (basis @ fine.weights.astype(np.longdouble))
    return matrix


# eigenvalues between 1/70 and 1, and within 75 degrees of the positive axis, leave exp(-48)
_FIRST, _LAST, _WIDTH = -1.0, 6.0, 0.25
_FAR = 300.0


def matrix_power(matrix: Array, exponent: float) -> Array:
    r"""The power :math:`B^\theta` of a matrix whose symmetric part has no negative eigenvalue.

    :math:`B^{-s} = \frac{\sin \pi s}{\pi} \int_0^\infty x^{s - 1} (1 + x B)^{-1} dx`, 0 < s < 1,
    and a factor B more where the exponent is positive. Eigenvectors, which lose digits, are not
    used.

    B is ``(m, m)``, its eigenvalues of size 1/70 to 1 and within 75 degrees of the positive axis,
    as those of Gauss, Radau IIA and Lobatto IIIC methods; exponents lie in (-1, 1).
    """
    unit = np.eye(matrix.shape[0])
    if exponent == 0:
        return unit
    # s and 1 - s, neither of them rounded
    s, rest = (-exponent, 1 + exponent) if exponent < 0 else (1 - exponent, exponent)
    end = math.log(45.0 / min(s, rest)) + 0.5
    u = np.arange(_FIRST - end, _LAST + end, _WIDTH)
    left, right = np.exp(_FIRST - u), np.exp(u - _LAST)
    logs = u - left + right
    # far out the resolvent is at its limit, the power of x is not
    near = np.clip(logs, -_FAR, _FAR)
    resolvents = np.linalg.inv(np.exp(-near)[:, None, None] * unit + matrix)
    powers = np.exp(np.where(logs < 0, s * logs - near, -rest * logs)) * (1 + left + right)
    sine = math.sin(math.pi * min(s, rest))
    power = np.tensordot(powers, resolvents, axes=1) * (_WIDTH * sine / math.pi)
    return np.asarray(power if exponent < 0 else matrix @ power)
