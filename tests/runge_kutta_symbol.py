"""Convolution quadrature symbol of a Runge-Kutta method."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.mathematics.arrays import ComplexArray
from fvi_cli.mathematics.runge_kutta import ButcherTableau

# Eigenvectors worse conditioned than this lose digits in a matrix power.
_LARGEST_CONDITION = 1e4


def at_infinity(tableau: ButcherTableau) -> float:
    """Stability function at infinity, ``R = 1 - b^T A^{-1} 1``; -1, 0 and 1 are exact."""
    value = 1.0 - float(tableau.b @ np.linalg.solve(tableau.A, np.ones(tableau.n_stages)))
    nearest = float(round(value)) + 0.0
    return nearest if abs(value - nearest) < 1e-10 else value


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
    limit = at_infinity(tableau)
    if np.any(limit * z == 1):
        raise ValueError(f"points: z = {1 / limit:g} is a pole of the symbol")
    inverse = np.linalg.inv(tableau.A)
    update = np.outer(inverse.sum(axis=1), tableau.b @ inverse)
    return np.asarray(inverse - z / (1 - limit * z) * update, dtype=np.complex128)


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
