"""Tableaux of the Runge-Kutta methods, and their convolution quadrature symbols."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fvi_cli.integrator.memory.stages import stage_operator
from fvi_cli.mathematics.arrays import Array, ComplexArray


@dataclass(frozen=True, kw_only=True, eq=False)
class ButcherTableau:
    """A method with m stages; orders p of the weights and q of the stages, as the books have them.

    They fulfil B(p), ``sum_i b_i c_i^(k-1) = 1/k`` for k = 1..p, and C(q), ``sum_j a_ij c_j^(k-1) =
    c_i^k / k`` for k = 1..q (Hairer, Wanner, *Solving Ordinary Differential Equations II*, section
    IV.5).
    """

    A: Array
    b: Array
    c: Array
    order: int
    stage_order: int


def tableau(name: str, m: int) -> ButcherTableau:
    """The method by which the package remembers; of its own matrix between coefficients."""
    own = stage_operator(name, m)
    return ButcherTableau(
        A=own.to_values @ own.matrix @ own.to_coefficients,
        b=own.rule.weights,
        c=own.rule.nodes,
        order=2 * m - 2 * (name == "lobatto-iiic"),
        stage_order=m - (name == "lobatto-iiic"),
    )


def at_infinity(tableau: ButcherTableau) -> float:
    """Stability function at infinity, ``R = 1 - b^T A^{-1} 1``; -1, 0 and 1 are exact."""
    value = 1.0 - float(tableau.b @ np.linalg.solve(tableau.A, np.ones(tableau.b.size)))
    nearest = float(round(value)) + 0.0
    return nearest if abs(value - nearest) < 1e-10 else value


def symbol(tableau: ButcherTableau, points: ArrayLike) -> ComplexArray:
    """``Delta(z) = (A + z/(1-z) 1 b^T)^{-1}`` for step size 1, shape ``(..., m, m)``.

    Lubich and Ostermann, *Runge-Kutta methods for parabolic equations and convolution
    quadrature*, Math. Comp. 60, 1993, equation (1.8). Evaluated as
    ``A^{-1} - z/(1 - R(inf) z) A^{-1} 1 b^T A^{-1}`` (Sherman and Morrison), which has no
    singularity of its own at z = 1.
    """
    z = np.asarray(points, dtype=np.complex128)[..., None, None]
    inverse = np.linalg.inv(tableau.A)
    update = np.outer(inverse.sum(axis=1), tableau.b @ inverse)
    return np.asarray(inverse - z / (1 - at_infinity(tableau) * z) * update, dtype=np.complex128)


def symbol_power(tableau: ButcherTableau, exponent: float, points: ArrayLike) -> ComplexArray:
    """``Delta(z)^theta``, the principal power.

    For ``|z| < 1`` the eigenvalues of the symbol lie in the open right half-plane, and the power
    is the generating function ``sum_n w_n z^n`` of the convolution quadrature weights.
    """
    values, vectors = np.linalg.eig(symbol(tableau, points))
    powers = values[..., None, :] ** exponent
    return np.asarray(vectors * powers @ np.linalg.inv(vectors), dtype=np.complex128)
