r"""What a step of a Runge-Kutta method is to the memory, for one step size.

All is worked out in coefficients of the polynomials that are orthonormal in the quadrature rule
of the method. There the matrix is :math:`X_{11} = 1/2`, :math:`\mp\xi_k` beside the diagonal and
a positive last entry or none (Hairer, Wanner, *Solving Ordinary Differential Equations II*,
section IV.5, "W-transformation"), so that :math:`(1 + z X)^{-1} e_1` is a continued fraction of
positive numbers: real arithmetic, full relative accuracy in every entry for any number of stages
and any z > 0. Eigenvectors of A lose a digit for every two stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Protocol

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.integrator.convolution.kernel import Kernel
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.matrices.powers import matrix_power
from fvi_cli.mathematics.runge_kutta import ButcherTableau, tableau


class StepHistory(Protocol):
    """What a step is to states that stand for the past."""

    @property
    def response(self) -> Array:
        """Force by unit states, shape ``(n_terms, m, n_states)``."""

    def over(self, steps: int) -> BlockHistory:
        """The same over `steps` equal steps that are taken at once."""


class BlockHistory(Protocol):
    """What B equal steps, taken at once, are to states that stand for the past."""

    @property
    def response(self) -> Array:
        """Force on the block by the states at its beginning, ``(n_terms, B m, n_states)``."""

    @property
    def lags(self) -> Array:
        """Force by what drove 1 to B - 1 steps before, ``(n_terms, B - 1, m, inputs)``."""

    @property
    def intake(self) -> Array:
        """What drives the block, in the states at its end, ``(n_states, B inputs)``."""

    def after(self, states: Array, driving: Array) -> Array:
        """States ``(n_states, columns)`` behind the block, driven by ``(B inputs, columns)``."""

    def change_of_all(self) -> Array:
        """The matrix that turns all states into their change over the block."""


# exp(-800) is zero in double precision, and 0 * -800 is 0 where 0 * -inf would be NaN.
_LOG_OF_ZERO = -800.0


@dataclass(frozen=True, kw_only=True, eq=False)
class StepKernel:
    """History of a kernel over one step of length h, in stage values or in coefficients.

    Parameters
    ----------
    response
        Force at the stages by unit states at the beginning of the step, the weights of the
        kernel in it: ``response[k] @ s``, shape ``(n_terms, m, J)``.
    signs, log_magnitudes
        Sign and ``log|R(-h x_j)|``, shape ``(J,)``; the logarithm of zero is -800.
    intake
        ``s_{n+1} = decay * s_n + intake @ V_n``, shape ``(J, m)``.
    """

    response: Array
    signs: Array
    log_magnitudes: Array
    intake: Array

    @cached_property
    def decay(self) -> Array:
        """Ratios R(-h x_j), shape ``(J,)``."""
        return np.asarray(self.signs * np.exp(self.log_magnitudes))

    @cached_property
    def change(self) -> Array:
        """``R - 1``, shape ``(J,)``, in full relative accuracy.

        In long runs of equal steps ``s += change * s + intake @ V`` forgets at the right pace,
        where the rounding of a ratio near 1 would be repeated in each step.
        """
        positive = self.signs > 0
        return np.where(positive, np.expm1(self.log_magnitudes), self.decay - 1)

    def powers(self, exponents: NDArray[np.int64]) -> Array:
        """Return ``R(-h x_j)^n`` for integers n >= 0, shape ``(n, J)``, good for any n."""
        n = np.asarray(exponents)[:, None]
        return np.asarray(np.where(n % 2 == 1, self.signs, 1.0) * np.exp(n * self.log_magnitudes))

    def over(self, steps: int) -> BlockKernel:
        """History over `steps` equal steps."""
        n_terms, m, n_states = self.response.shape
        powers = self.powers(np.arange(steps))
        response = self.response[:, None] * powers[:, None, :]
        intake = powers[::-1].T[:, :, None] * self.intake[:, None, :]
        whole = StepKernel(
            response=response.reshape(n_terms, steps * m, n_states),
            signs=self.signs if steps % 2 else np.ones_like(self.signs),
            log_magnitudes=steps * self.log_magnitudes,
            intake=intake.reshape(n_states, steps * m),
        )
        return BlockKernel(
            steps=steps,
            response=whole.response,
            decay=whole.decay,
            change=whole.change,
            intake=whole.intake,
            step=self,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockKernel:
    """History of a kernel over B equal steps, taken at once.

    Parameters
    ----------
    steps
        Number B of steps.
    response
        Force at the stages of the block by the states at its beginning,
        shape ``(n_terms, B m, J)``.
    decay, change
        ``R^B`` and, in full relative accuracy, ``R^B - 1``, shape ``(J,)``.
    intake
        What the stages of the block add to the states at its end, shape ``(J, B m)``.
    step
        The same for one of the steps.
    """

    steps: int
    response: Array
    decay: Array
    change: Array
    intake: Array
    step: StepKernel

    @cached_property
    def lags(self) -> Array:
        """Weights of the stages 1 to B - 1 steps before, shape ``(n_terms, B - 1, m, m)``.

        The local block ``h^theta A^theta`` is lag 0.
        """
        n_terms, m, _ = self.step.response.shape
        before = self.response[:, : (self.steps - 1) * m]
        return np.asarray((before @ self.step.intake).reshape(n_terms, self.steps - 1, m, m))

    def after(self, states: Array, driving: Array) -> Array:
        """The states ``(J, columns)`` behind the block, driven by ``(B m, columns)``."""
        return np.asarray(states + (self.change[:, None] * states + self.intake @ driving))

    def change_of_all(self) -> Array:
        """The matrix that turns all states into their change over the block, ``(J, J)``."""
        return np.diag(self.change)


@dataclass(frozen=True, kw_only=True, eq=False)
class StageOperator:
    """Powers of integration by one Runge-Kutta method, step by step.

    Parameters
    ----------
    tableau
        Gauss, Radau IIA or Lobatto IIIC, m stages.

    Raises
    ------
    ValueError
        For another family of tableaux.
    """

    tableau: ButcherTableau

    def __post_init__(self) -> None:
        _matrix_entries(self.tableau)

    @property
    def n_stages(self) -> int:
        """Number m of stages."""
        return self.tableau.n_stages

    @cached_property
    def to_values(self) -> Array:
        """Values at the stages of the orthonormal polynomials, shape ``(m, m)``; first column 1."""
        c, m = self.tableau.c, self.n_stages
        values = legendre.legvander(2.0 * c - 1.0, m - 1) * np.sqrt(2.0 * np.arange(m) + 1.0)
        if self.tableau.name == "lobatto-iiic":
            values[:, -1] *= math.sqrt((m - 1) / (2 * m - 1))
        return np.asarray(values)

    @cached_property
    def to_coefficients(self) -> Array:
        """Inverse of `to_values`: its transpose times the quadrature weights, ``(m, m)``."""
        return np.asarray(self.to_values.T * self.tableau.b)

    @cached_property
    def matrix(self) -> Array:
        """The tridiagonal matrix X of the method in coefficients, shape ``(m, m)``."""
        off, corner = _matrix_entries(self.tableau)
        matrix = np.diag(off, -1) - np.diag(off, 1)
        matrix[0, 0] += 0.5
        matrix[-1, -1] += corner
        return matrix

    def local_block(self, theta: float) -> Array:
        r"""The power :math:`A^\theta`, to be multiplied by :math:`h^\theta`, shape ``(m, m)``.

        Parameters
        ----------
        theta
            Exponent in (-1, 1).

        Raises
        ------
        ValueError
            For an exponent outside (-1, 1).
        """
        power = _power(self.tableau.name, self.n_stages, float(theta))
        return np.asarray(self.to_values @ power @ self.to_coefficients)

    def law_block(self, kernel: RelaxationKernel, h: float) -> Array:
        """The local block of a relaxation law over a step of length `h`, shape ``(m, m)``."""

        def power(theta: float) -> Array:
            return np.asarray(h**theta * _power(self.tableau.name, self.n_stages, theta))

        block = kernel.on_integration(h * self.matrix, power)
        return np.asarray(self.to_values @ block @ self.to_coefficients)

    def step_tables(self, kernel: Kernel, h: float) -> StepKernel:
        """History of `kernel` over a step of length `h`."""
        one = self.unweighted(h * kernel.rates)
        return replace(one, response=kernel.weights[:, None, :] * one.response)

    def unweighted(self, z: Array) -> StepKernel:
        """History of exponentials of weight 1 over a step, whose rates times its length are z."""
        columns, signs, log_magnitudes = self._resolvent(z)
        rows = columns * z
        rows[1::2] *= -1.0
        return StepKernel(
            response=(self.to_values @ columns)[None],
            signs=signs,
            log_magnitudes=log_magnitudes,
            intake=rows.T @ self.to_coefficients,
        )

    def _resolvent(self, z: Array) -> tuple[Array, Array, Array]:
        """First column of ``(1 + z X)^{-1}``, shape ``(m, J)``, sign and logarithm of R(-z)."""
        off, corner = _matrix_entries(self.tableau)
        m = self.n_stages
        columns = np.empty((m, z.size))
        tail = 1.0 + corner * z
        if m == 1:
            rest = corner * z
        else:
            square = z * z
            tails = [tail]
            for value in off[:0:-1]:
                tail = 1.0 + (value * value) * square / tail
                tails.append(tail)
            rest = (off[0] * off[0]) * square / tail
        rest = 1.0 + rest
        half = 0.5 * z
        np.reciprocal(rest + half, out=columns[0])
        for k in range(1, m):
            np.multiply(columns[k - 1], (-off[k - 1]) * z / tails[m - 1 - k], out=columns[k])
        # R = (1 - q) / (1 + q): nothing cancels at either end
        q = half / rest
        with np.errstate(divide="ignore"):
            log_magnitudes = -2.0 * np.arctanh(np.minimum(q, 1.0 / q))
        return columns, np.where(q > 1, -1.0, 1.0), np.maximum(log_magnitudes, _LOG_OF_ZERO)


def _matrix_entries(method: ButcherTableau) -> tuple[Array, float]:
    """Entries xi_k below the diagonal of X, shape ``(m - 1,)``, and what the last one has more."""
    m = method.n_stages
    off = 0.5 / np.sqrt(4.0 * np.arange(1, m) ** 2 - 1.0)
    if method.name == "gauss":
        return off, 0.0
    if method.name == "radau-iia":
        return off, 1.0 / (4 * m - 2)
    if method.name == "lobatto-iiic":
        # the rule is not exact for the square of the last polynomial
        off[-1] *= math.sqrt((2 * m - 1) / (m - 1))
        return off, 1.0 / (2 * m - 2)
    raise ValueError(f"tableau: {method.name!r} is not one of gauss, radau-iia, lobatto-iiic")


@cache
def _power(name: str, n_stages: int, theta: float) -> Array:
    """A power of the matrix of a method, shape ``(m, m)``."""
    power = matrix_power(StageOperator(tableau=tableau(name, n_stages)).matrix, theta)
    power.setflags(write=False)
    return power


__all__ = ["BlockKernel", "StageOperator", "StepKernel"]
