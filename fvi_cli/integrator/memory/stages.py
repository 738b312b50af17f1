r"""Tables of the memory for one step of a Runge-Kutta method, for one step size.

All is computed in coefficients of the polynomials that are orthonormal in the quadrature rule
of the method. There the matrix has :math:`X_{11} = 1/2`, :math:`\mp\xi_k` next to the diagonal and
a positive last entry or zero (Hairer, Wanner, *Solving Ordinary Differential Equations II*,
section IV.5, "W-transformation"), so that :math:`(1 + z X)^{-1} e_1` is a continued fraction of
positive numbers: real arithmetic, full relative accuracy in every entry for any number of stages
and any z > 0. Eigenvectors of A lose a digit for every two stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import legendre

from fvi_cli.integrator.memory.kernel import Term
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.quadrature import (
    QuadratureRule,
    gauss_rule,
    lobatto_rule,
)
from fvi_cli.mathematics.runge_kutta import matrix_power

_RULES = {"gauss": gauss_rule, "lobatto-iiic": lobatto_rule}
# exp(-800) is zero in double precision, and 0 * -800 is 0 where 0 * -inf would be NaN
_LOG_OF_ZERO = -800.0


@dataclass(frozen=True, kw_only=True, eq=False)
class StageExponentials:
    """Exponentials over one step, ``s' = x (v - s)``, for rates times its length."""

    # values at the stages of states that begin with 1 and have no input, (m, J)
    stages: Array
    signs: Array  # sign and log|R(-h x_j)|, shape (J,); the logarithm of zero is -800
    log_magnitudes: Array
    intake: Array  # s_{n+1} = R s_n + intake @ V_n, shape (J, m)

    def changes(self, count: int) -> Array:
        """``R^count - 1`` in full relative accuracy, shape ``(J,)``.

        In long runs of equal steps ``s += change * s + intake @ V`` decays at the right rate;
        the rounding of a ratio near 1 would be repeated in each step.
        """
        logs = count * self.log_magnitudes
        changes = np.expm1(logs)
        return changes if count % 2 == 0 else np.where(self.signs > 0, changes, -2.0 - changes)

    def powers(self, count: int) -> Array:
        """``R^n`` for n = 0 .. count - 1, shape ``(count, J)``."""
        n = np.arange(count)[:, None]
        signs = np.where(n % 2 == 1, self.signs, 1.0)
        return np.asarray(signs * np.exp(n * self.log_magnitudes))


@dataclass(frozen=True, kw_only=True, eq=False)
class StageOperator:
    """Functions of integration by one Runge-Kutta method over one step."""

    name: str  # gauss or lobatto-iiic
    rule: QuadratureRule  # its nodes and weights, m stages

    @cached_property
    def _entries(self) -> tuple[Array, float]:
        """Entries xi_k below the diagonal of X, ``(m - 1,)``, and an addition to its last entry."""
        m = self.n_stages
        off = 0.5 / np.sqrt(4.0 * np.arange(1, m) ** 2 - 1.0)
        if self.name == "gauss":
            return off, 0.0
        # Lobatto IIIC: the rule is not exact for the square of the last polynomial
        off[-1] *= math.sqrt((2 * m - 1) / (m - 1))
        return off, 1.0 / (2 * m - 2)

    @property
    def n_stages(self) -> int:
        """Number m of stages."""
        return self.rule.n_points

    @cached_property
    def to_values(self) -> Array:
        """Values at the stages of the orthonormal polynomials, shape ``(m, m)``; first column 1."""
        c, m = self.rule.nodes, self.n_stages
        values = legendre.legvander(2.0 * c - 1.0, m - 1) * np.sqrt(2.0 * np.arange(m) + 1.0)
        if self.name == "lobatto-iiic":
            values[:, -1] *= math.sqrt((m - 1) / (2 * m - 1))
        return np.asarray(values)

    @cached_property
    def to_coefficients(self) -> Array:
        """Inverse of `to_values`: its transpose times the quadrature weights, ``(m, m)``."""
        return np.asarray(self.to_values.T * self.rule.weights)

    @cached_property
    def matrix(self) -> Array:
        """The tridiagonal matrix X of the method in coefficients, shape ``(m, m)``."""
        off, corner = self._entries
        matrix = np.diag(off, -1) - np.diag(off, 1)
        matrix[0, 0] += 0.5
        matrix[-1, -1] += corner
        return matrix

    def local_blocks(self, term: Term, sizes: Array) -> Array:
        r"""Matrices of a term on the stages of steps of u lengths h, shape ``(u, m, m)``.

        .. math:: h^\theta A^\theta, \qquad \hat k((h A)^{-1})

        for a power and a law. The power 0 is the identity.
        """
        name, m, h = self.name, self.n_stages, sizes[:, None, None]
        if isinstance(term, float):
            return np.asarray(h**term * _power(name, m, term))
        block = term.on_integration(
            h * self.matrix, lambda theta: h**theta * _power_of_coefficients(name, m, theta)
        )
        return np.asarray(self.to_values @ block @ self.to_coefficients)

    def exponentials(self, z: Array) -> StageExponentials:
        """Exponentials over a step whose rates times its length are z, shape ``(J,)``."""
        columns, signs, log_magnitudes = self._resolvent(z)
        rows = columns * z
        rows[1::2] *= -1.0  # first rows of the inverse: X^T is X with these signs on both sides
        return StageExponentials(
            stages=self.to_values @ columns,
            signs=signs,
            log_magnitudes=log_magnitudes,
            intake=rows.T @ self.to_coefficients,
        )

    def _resolvent(self, z: Array) -> tuple[Array, Array, Array]:
        """First column of ``(1 + z X)^{-1}``, shape ``(m, J)``, sign and logarithm of R(-z)."""
        off, corner = self._entries
        m = self.n_stages
        tails = np.empty((m, z.size))
        tails[-1] = 1.0 + corner * z
        squares = (off * off)[:, None] * (z * z)
        for k in range(m - 2, -1, -1):
            tails[k] = squares[k] / tails[k + 1] + 1.0
        rest, half = tails[0], 0.5 * z
        columns = np.empty((m, z.size))
        columns[0] = 1.0 / (rest + half)
        columns[1:] = -off[:, None] * z / tails[1:]
        columns = np.multiply.accumulate(columns, axis=0)
        # R = (1 - ratio) / (1 + ratio): no digits cancel at either end
        ratio = half / rest
        with np.errstate(divide="ignore"):
            log_magnitudes = -2.0 * np.arctanh(np.minimum(ratio, 1.0 / ratio))
        return columns, np.where(ratio > 1, -1.0, 1.0), np.maximum(log_magnitudes, _LOG_OF_ZERO)


@cache
def stage_operator(name: str, n_stages: int) -> StageOperator:
    """The operator of a method, the same object every time."""
    return StageOperator(name=name, rule=_RULES[name](n_stages))


@cache
def _power_of_coefficients(name: str, n_stages: int, theta: float) -> Array:
    return matrix_power(stage_operator(name, n_stages).matrix, theta)


@cache
def _power(name: str, n_stages: int, theta: float) -> Array:
    if theta == 0.0:
        return np.eye(n_stages)
    operator = stage_operator(name, n_stages)
    block = _power_of_coefficients(name, n_stages, theta)
    return np.asarray(operator.to_values @ block @ operator.to_coefficients)
