"""Runge-Kutta tableaux for convolution quadrature and what follows from them at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import comb, perm

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.mathematics.quadrature import (
    QuadratureRule,
    gauss_rule,
    lobatto_rule,
    radau_right_rule,
)

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

LARGEST_STAGES = 21
"""Largest number of stages that the tableaux are made for."""

_CONDITION_TOLERANCE = 1e-13
_STABILITY_TOLERANCE = 1e-10
# Eigenvectors worse conditioned than this lose digits in a matrix power.
_LARGEST_CONDITION = 1e4
# exp(-800) is zero in double precision, and 0 * -800 is 0 where 0 * -inf would be NaN.
_LOG_OF_ZERO = -800.0


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
        return nearest if abs(value - nearest) < _STABILITY_TOLERANCE else value


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


def log_stability(tableau: ButcherTableau, points: ArrayLike) -> tuple[Array, Array]:
    """Return the sign and the logarithm of the magnitude of ``R(-x)`` for x >= 0.

    The relative accuracy of the logarithm is full wherever ``|R|`` comes near 1, at 0 and, for
    Gauss, at infinity, so that ``exp(n log|R|)`` is good for any n.

    Parameters
    ----------
    tableau
        A method whose stability function is the Padé approximant of exp with denominator of
        degree m and numerator of degree order - m: Gauss, Radau IIA and Lobatto IIIC.
    points
        The points x >= 0, any shape; infinity is allowed.

    Returns
    -------
    signs, logarithms
        Both of the shape of `points`. A zero of R has the logarithm -800.

    Raises
    ------
    ValueError
        For a tableau with another stability function, and for negative points.

    Notes
    -----
    With ``R = P/Q`` the terms of ``Q(-x)``, ``Q(-x) - P(-x)`` and ``Q(-x) + P(-x)`` are all
    positive (Hairer and Wanner, *Solving Ordinary Differential Equations II*, section IV.3), so
    ``1 - R`` and ``1 + R`` come without cancellation.
    """
    x = np.asarray(points, dtype=np.float64)
    if not np.all(x >= 0):
        raise ValueError(f"points: {x.min()} is not allowed; they must be at least 0")
    m = tableau.n_stages
    numerator_degree = tableau.order - m
    _check_pade(tableau, numerator_degree)
    denominator, alternating = _pade(numerator_degree, m)
    below = np.minimum(x, 1.0)
    # Beyond 1 both polynomials are divided by x^m.
    above = np.divide(1.0, x, out=np.ones_like(x), where=x > 1.0)

    def evaluate(coefficients: Array) -> Array:
        small = np.polynomial.polynomial.polyval(below, coefficients)
        large = np.polynomial.polynomial.polyval(above, coefficients[::-1])
        return np.where(x > 1.0, large, small)

    bottom = evaluate(denominator)
    ratio = evaluate(alternating) / bottom
    magnitude = np.where(ratio == 0, 1.0, np.abs(ratio))
    logarithm = np.where(ratio == 0, _LOG_OF_ZERO, np.log(magnitude))
    for sign in (1, -1):
        near = sign * ratio > 0.5
        defect = evaluate(denominator - sign * alternating) / bottom
        logarithm = np.where(near, np.log1p(-np.where(near, defect, 0.0)), logarithm)
    return np.where(ratio < 0, -1.0, 1.0), np.maximum(logarithm, _LOG_OF_ZERO)


def _pade(numerator_degree: int, denominator_degree: int) -> tuple[Array, Array]:
    """Coefficients of ``Q(-x)`` and ``P(-x)`` of the Padé approximant P/Q of exp, both (m+1,)."""
    k, m = numerator_degree, denominator_degree
    denominator = [comb(m, i) / perm(k + m, i) for i in range(m + 1)]
    numerator = [(-1) ** i * comb(k, i) / perm(k + m, i) for i in range(m + 1)]
    return np.array(denominator), np.array(numerator)


def _check_pade(tableau: ButcherTableau, numerator_degree: int) -> None:
    """Check against the tableau itself, at a few points, that R is the Padé approximant."""
    m = tableau.n_stages
    if numerator_degree >= 0:
        denominator, alternating = _pade(numerator_degree, m)
        points = np.array([0.25, 1.0, 4.0])
        expected = np.polynomial.polynomial.polyval(
            points, alternating
        ) / np.polynomial.polynomial.polyval(points, denominator)
        matrices = np.eye(m) + points[:, None, None] * tableau.A
        columns = np.linalg.solve(matrices, np.ones((points.size, m, 1)))[..., 0]
        if np.all(np.abs(1 - points * (columns @ tableau.b) - expected) < _STABILITY_TOLERANCE):
            return
    raise ValueError(
        f"{tableau.name}: the stability function is not the Padé approximant of exp of order "
        f"{tableau.order}; permitted are Gauss, Radau IIA and Lobatto IIIC"
    )


def symbol(tableau: ButcherTableau, points: ArrayLike) -> ComplexArray:
    """Return the symbol ``Delta(z) = (A + z/(1-z) 1 b^T)^{-1}`` of the method for step size 1.

    Parameters
    ----------
    tableau
        The method, m stages.
    points
        The complex numbers z, any shape ``(...)``.

    Returns
    -------
    ComplexArray
        Shape ``(..., m, m)``; finite everywhere but at ``z = 1/R(infinity)``.

    Notes
    -----
    Lubich and Ostermann, *Runge-Kutta methods for parabolic equations and convolution
    quadrature*, Math. Comp. 60, 1993, equation (1.8). Evaluated as
    ``A^{-1} - z/(1 - R(inf) z) A^{-1} 1 b^T A^{-1}`` (Sherman and Morrison), which has no
    singularity at z = 1.
    """
    z = np.asarray(points, dtype=np.complex128)[..., None, None]
    inverse = np.linalg.inv(tableau.A)
    update = np.outer(inverse.sum(axis=1), tableau.b @ inverse)
    return np.asarray(inverse - z / (1 - tableau.R_infinity * z) * update, dtype=np.complex128)


def symbol_power(tableau: ButcherTableau, exponent: float, points: ArrayLike) -> ComplexArray:
    """Return ``Delta(z)^theta``, the principal power of the symbol.

    For ``|z| < 1`` and the A-stable methods of this module the eigenvalues of the symbol lie in
    the open right half-plane, and the power is the generating function ``sum_n w_n z^n`` of the
    convolution quadrature weights.

    Parameters
    ----------
    tableau
        The method, m stages.
    exponent
        The exponent theta, any finite number.
    points
        The complex numbers z, any shape ``(...)``.

    Returns
    -------
    ComplexArray
        Shape ``(..., m, m)``.

    Raises
    ------
    ValueError
        For an exponent that is not finite, and a negative one at ``z = 1``, where the symbol is
        singular.
    """
    if not np.isfinite(exponent):
        raise ValueError(f"exponent: {exponent} is not allowed; it must be finite")
    z = np.asarray(points, dtype=np.complex128)
    if exponent < 0 and np.any(z == 1):
        raise ValueError(f"points: z = 1 is not allowed with the negative exponent {exponent}")
    matrices = symbol(tableau, z)
    values, vectors = np.linalg.eig(matrices)
    result = np.asarray(
        (vectors * (values**exponent)[..., None, :]) @ np.linalg.inv(vectors), dtype=np.complex128
    )
    # Two eigenvalues can meet at isolated points, where eigenvectors are of no use.
    suspect = np.linalg.cond(vectors) > _LARGEST_CONDITION
    if np.any(suspect):
        from scipy.linalg import fractional_matrix_power

        for index in np.ndindex(*z.shape):
            if suspect[index]:
                result[index] = fractional_matrix_power(matrices[index], exponent)
    return result


__all__ = [
    "LARGEST_STAGES",
    "ButcherTableau",
    "gauss_tableau",
    "lobatto_iiic_tableau",
    "log_stability",
    "radau_iia_tableau",
    "symbol",
    "symbol_power",
    "tableau",
]
