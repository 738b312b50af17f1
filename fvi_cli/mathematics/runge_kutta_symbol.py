"""Stability function and convolution quadrature symbol of a Runge-Kutta method."""

from __future__ import annotations

from math import comb, perm

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.mathematics.runge_kutta import ButcherTableau

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_STABILITY_TOLERANCE = 1e-10
# Eigenvectors worse conditioned than this lose digits in a matrix power.
_LARGEST_CONDITION = 1e4
# exp(-800) is zero in double precision, and 0 * -800 is 0 where 0 * -inf would be NaN.
_LOG_OF_ZERO = -800.0


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
        Shape ``(..., m, m)``.

    Raises
    ------
    ValueError
        At the pole ``z = 1/R(infinity)``: for Gauss at 1 (m even) or -1 (m odd).

    Notes
    -----
    Lubich and Ostermann, *Runge-Kutta methods for parabolic equations and convolution
    quadrature*, Math. Comp. 60, 1993, equation (1.8). Evaluated as
    ``A^{-1} - z/(1 - R(inf) z) A^{-1} 1 b^T A^{-1}`` (Sherman and Morrison), which has no
    singularity of its own at z = 1.
    """
    z = np.asarray(points, dtype=np.complex128)[..., None, None]
    if np.any(tableau.R_infinity * z == 1):
        raise ValueError(f"points: z = {1 / tableau.R_infinity:g} is a pole of the symbol")
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
        For an exponent that is not finite, a negative one at ``z = 1``, where the symbol is
        singular, and at the pole of the symbol.
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


__all__ = ["log_stability", "symbol", "symbol_power"]
