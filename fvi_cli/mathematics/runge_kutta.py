"""Tableaux of the Runge-Kutta methods for convolution quadrature."""

from __future__ import annotations

from collections.abc import Callable
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

LARGEST_STAGES = 21
"""Largest number of stages that the tableaux are made for."""

_CONDITION_TOLERANCE = 1e-13
_INFINITY_TOLERANCE = 1e-10


@dataclass(frozen=True, kw_only=True, eq=False)
class ButcherTableau:
    """An implicit Runge-Kutta method with m stages and an invertible matrix.

    Parameters
    ----------
    name
        Family of the method, as it stands in tables.
    A
        Matrix a_ij, shape ``(m, m)``.
    b
        Weights b_i, none of them zero, shape ``(m,)``.
    c
        Nodes c_i, shape ``(m,)``.
    order
        Order p of the underlying quadrature: ``sum_i b_i c_i^(k-1) = 1/k`` for k = 1..p, B(p).
    stage_order
        Stage order q: ``sum_j a_ij c_j^(k-1) = c_i^k/k`` for k = 1..q, C(q).

    Raises
    ------
    ValueError
        For wrong shapes, numbers that are not finite, a weight that is zero, a singular matrix,
        and where the row sums are not c, or B(p) or C(q) does not hold.

    Notes
    -----
    B(p) and C(q) are the simplifying assumptions of Hairer and Wanner, *Solving Ordinary
    Differential Equations II*, section IV.5.
    """

    name: str
    A: Array
    b: Array
    c: Array
    order: int
    stage_order: int

    def __post_init__(self) -> None:
        for field in ("A", "b", "c"):
            array = np.array(getattr(self, field), dtype=np.float64)
            if not np.all(np.isfinite(array)):
                raise ValueError(f"{self.name}: {field} = {array} must be finite")
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        m = self.b.size
        if m == 0 or self.A.shape != (m, m) or self.b.shape != (m,) or self.c.shape != (m,):
            raise ValueError(
                f"{self.name}: shapes {self.A.shape}, {self.b.shape}, {self.c.shape} of A, b, c "
                "are not allowed; they must be (m, m), (m,), (m,) with m >= 1"
            )
        if not np.all(self.b != 0):
            raise ValueError(f"{self.name}: weights b = {self.b} must not be zero")
        if np.linalg.matrix_rank(self.A) < m:
            raise ValueError(f"{self.name}: the matrix A is singular; it must be invertible")
        if self.order < 1 or self.stage_order < 1:
            raise ValueError(
                f"{self.name}: order {self.order} and stage order {self.stage_order} are not "
                "allowed; both must be at least 1"
            )
        # C(1) says that the row sums are c.
        for k in range(1, max(self.order, self.stage_order) + 1):
            powers = self.c ** (k - 1)
            if k <= self.order:
                self._check(f"B({k})", float(self.b @ powers - 1 / k))
            if k <= self.stage_order:
                self._check(f"C({k})", float(np.abs(self.A @ powers - self.c**k / k).max()))

    def _check(self, condition: str, defect: float) -> None:
        # Written as a negation so that NaN is refused as well.
        if not abs(defect) <= _CONDITION_TOLERANCE:
            raise ValueError(
                f"{self.name}: condition {condition} is missed by {defect:.3g}; at most "
                f"{_CONDITION_TOLERANCE:g} is allowed"
            )

    @property
    def n_stages(self) -> int:
        """Number m of stages."""
        return int(self.b.size)

    @property
    def R_infinity(self) -> float:  # noqa: N802 - the field's name
        """Stability function at infinity, ``R = 1 - b^T A^{-1} 1``; -1, 0 and 1 are exact."""
        value = 1.0 - float(self.b @ np.linalg.solve(self.A, np.ones(self.n_stages)))
        nearest = float(round(value)) + 0.0
        return nearest if abs(value - nearest) < _INFINITY_TOLERANCE else value


@cache
def gauss_tableau(n_stages: int) -> ButcherTableau:
    """Return the Gauss method: order 2m, stage order m, symmetric and symplectic.

    Parameters
    ----------
    n_stages
        Number m of stages, 1 to 21.

    Raises
    ------
    ValueError
        For a number of stages outside 1 to 21.
    """
    rule = _rule("gauss", gauss_rule, n_stages, least=1)
    return _tableau("gauss", rule, _collocation(rule), stage_order=n_stages)


@cache
def radau_iia_tableau(n_stages: int) -> ButcherTableau:
    """Return the Radau IIA method: order 2m - 1, stage order m, stiffly accurate.

    Parameters
    ----------
    n_stages
        Number m of stages, 1 to 21.

    Raises
    ------
    ValueError
        For a number of stages outside 1 to 21.
    """
    rule = _rule("radau-iia", radau_right_rule, n_stages, least=1)
    return _tableau("radau-iia", rule, _collocation(rule), stage_order=n_stages)


@cache
def lobatto_iiic_tableau(n_stages: int) -> ButcherTableau:
    """Return the Lobatto IIIC method: order 2m - 2, stage order m - 1, stiffly accurate.

    Parameters
    ----------
    n_stages
        Number m of stages, 2 to 21.

    Raises
    ------
    ValueError
        For a number of stages outside 2 to 21.

    Notes
    -----
    The matrix is fixed by ``a_i1 = b_1`` and C(m-1) (Hairer and Wanner, *Solving Ordinary
    Differential Equations II*, section IV.5). A row that obeys C(m-1) differs from the row of
    the collocation method by a multiple of the divided difference over all nodes, and the first
    column says which.
    """
    rule = _rule("lobatto-iiic", lobatto_rule, n_stages, least=2)
    collocation = _collocation(rule)
    gaps = rule.nodes[:, None] - rule.nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    difference = 1 / np.prod(4 * gaps, axis=1)
    matrix = collocation + np.outer(rule.weights[0] - collocation[:, 0], difference / difference[0])
    matrix[:, 0] = rule.weights[0]
    matrix[-1] = rule.weights
    return _tableau("lobatto-iiic", rule, matrix, stage_order=n_stages - 1)


def tableau(name: str, n_stages: int) -> ButcherTableau:
    """Return a method by its name in tables.

    Parameters
    ----------
    name
        ``gauss``, ``radau-iia`` or ``lobatto-iiic``.
    n_stages
        Number m of stages.

    Raises
    ------
    ValueError
        For an unknown name and a number of stages that the method cannot have.
    """
    families = {
        "gauss": gauss_tableau,
        "radau-iia": radau_iia_tableau,
        "lobatto-iiic": lobatto_iiic_tableau,
    }
    if name not in families:
        raise ValueError(f"tableau: {name!r} is not one of {', '.join(families)}")
    return families[name](n_stages)


def _rule(
    name: str, build: Callable[[int], QuadratureRule], n_stages: int, *, least: int
) -> QuadratureRule:
    if not least <= n_stages <= LARGEST_STAGES:
        raise ValueError(f"{name}: {n_stages} stages; permitted are {least} to {LARGEST_STAGES}")
    return build(n_stages)


def _tableau(name: str, rule: QuadratureRule, matrix: Array, *, stage_order: int) -> ButcherTableau:
    return ButcherTableau(
        name=name,
        A=matrix,
        b=rule.weights,
        c=rule.nodes,
        order=rule.order,
        stage_order=stage_order,
    )


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
