r"""The damping along a run, with its derivative by the orders.

The discrete force of a term is :math:`F = \mu I^{\theta} U`, :math:`\theta = 1 - \gamma`, with the
power of the mesh's own integration matrix. Its derivative by the order is exact,
:math:`-\mu \ln(I) I^{\theta} U`: the local block becomes
:math:`h^\theta A^\theta (\ln h + \ln A)`, and in the sum of exponentials only the weights
:math:`\sin(\pi\theta)/\pi\, x^{-\theta}` depend on the order, not the rates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TypedDict

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.damping import LARGEST_EXPONENT
from fvi_cli.integrator.convolution.kernel import power_kernel, power_kernel_slopes
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import tableau


@dataclass(frozen=True, kw_only=True, eq=False)
class TermTables:
    """Numbers of one step size, for K damping terms and J rates.

    Parameters
    ----------
    local, local_slopes
        Powers of the method's matrix and their derivatives by the exponents, ``(K, m, m)``.
    response, response_slopes
        The same for the effect of the states at the stages, ``(K, m, J)``.
    decay, intake
        What a step makes of the states, ``(J,)`` and ``(J, m)``.
    """

    local: Array
    local_slopes: Array
    response: Array
    response_slopes: Array
    decay: Array
    intake: Array


class RunMemory:
    """All damping terms of a scene, those with a coefficient of zero as well, then its laws.

    Parameters
    ----------
    scene
        Its damping and relaxation laws.
    operator
        The Runge-Kutta method.
    step_sizes
        Of the whole mesh, shape ``(n,)``.

    Attributes
    ----------
    n_damping
        Number of damping terms, which come first.
    matrices
        Coefficients of all terms, those of laws times their size, shape ``(K, d, d)``.
    is_relative
        Whether the start velocity is subtracted, shape ``(K,)``: Caputo orders above 1.
    n_rates
        Number J of exponentials.
    """

    def __init__(self, scene: Scene, operator: StageOperator, step_sizes: Array) -> None:
        self._operator = operator
        d = scene.dimension
        self._exponents = [min(1.0 - term.order, LARGEST_EXPONENT) for term in scene.damping]
        self._laws = [law.kernel for law in scene.laws]
        self.n_damping = len(self._exponents)
        coefficients = [term.coefficient for term in scene.damping]
        coefficients += [law.size * law.coefficient for law in scene.laws]
        self.matrices = np.array(coefficients).reshape(-1, d, d)
        above = [scene.derivative == "caputo" and term.order > 1 for term in scene.damping]
        self.is_relative = np.array(above + [False for _ in scene.laws], dtype=bool)
        shortest = float(step_sizes.min())
        mesh = _MeshNumbers(
            shortest_step=shortest,
            final_time=scene.final_time,
            stages=operator.n_stages,
            steps=float((shortest / step_sizes).sum()),
        )
        parts = [] if not self._exponents else [power_kernel_slopes(self._exponents, **mesh)]
        if self._laws:
            distinct = list(dict.fromkeys(self._laws))
            kernel = power_kernel(distinct, accuracy=1e-14, **mesh)
            weights = kernel.weights[[distinct.index(one) for one in self._laws]]
            parts.append((kernel.rates, weights, np.zeros_like(weights)))
        self._rates = [rates for rates, _, _ in parts]
        self._weights = _apart([weights for _, weights, _ in parts])
        self._slopes = _apart([slopes for _, _, slopes in parts])
        self.n_rates = sum(rates.size for rates in self._rates)
        logarithm = _logarithm(operator)
        self._blocks = [operator.local_block(theta) for theta in self._exponents]
        self._log_blocks = [block @ logarithm for block in self._blocks]

    @property
    def n_terms(self) -> int:
        """Number K of terms."""
        return len(self._exponents) + len(self._laws)

    def tables(self, sizes: Array) -> list[TermTables]:
        """Numbers of steps of these lengths."""
        k, m, j = self.n_terms, self._operator.n_stages, self.n_rates
        rates = np.concatenate([*self._rates, np.zeros(0)])
        every = self._operator.unweighted(np.outer(sizes, rates).ravel())
        response = every.response.reshape(m, sizes.size, j)
        decay = every.decay.reshape(sizes.size, j)
        intake = every.intake.reshape(sizes.size, j, m)
        found = []
        for index, h in enumerate(sizes.tolist()):
            local, slopes = np.empty((k, m, m)), np.zeros((k, m, m))
            for term, theta in enumerate(self._exponents):
                local[term] = h**theta * self._blocks[term]
                slopes[term] = h**theta * self._log_blocks[term] + math.log(h) * local[term]
            for term, law in enumerate(self._laws, start=self.n_damping):
                local[term] = self._operator.law_block(law, h)
            found.append(
                TermTables(
                    local=local,
                    local_slopes=slopes,
                    response=response[:, index] * self._weights[:, None, :],
                    response_slopes=response[:, index] * self._slopes[:, None, :],
                    decay=decay[index],
                    intake=intake[index],
                )
            )
        return found

    def first_states(self, start_velocity: Array) -> Array:
        """States at the start, for every term, shape ``(K, J, d)``."""
        shape = (self.n_terms, self.n_rates, *start_velocity.shape)
        relative = self.is_relative.reshape(-1, *(1 for _ in shape[1:]))
        return np.where(relative, np.broadcast_to(start_velocity, shape), 0.0)

    def forces(
        self, tables: Sequence[TermTables], of_step: Sequence[int], velocity: Array, start: Array
    ) -> tuple[Array, Array]:
        """Forces of all terms without their matrices, and their derivatives by the orders.

        Parameters
        ----------
        tables, of_step
            Numbers of every step size, and which of them are a step's.
        velocity, start
            At the stages of every step, ``(n, m, d)``, and at t = 0, ``(d,)``.

        Returns
        -------
        tuple of Array
            Each of shape ``(K, n, m, d)``; laws have no derivatives here.
        """
        plain = np.empty((self.n_terms, *velocity.shape))
        slopes = np.empty_like(plain)
        states = self.first_states(start)
        relative = self.is_relative[:, None, None]
        for index, own in enumerate(velocity):
            terms = tables[of_step[index]]
            for local, response, found in (
                (terms.local, terms.response, plain),
                (terms.local_slopes, terms.response_slopes, slopes),
            ):
                left = local.sum(axis=2) + response.sum(axis=2)
                force = local @ own + response @ states
                found[:, index] = force - np.where(relative, left[:, :, None] * start, 0.0)
            states = terms.decay[:, None] * states + terms.intake @ own
        return plain, -slopes


class _MeshNumbers(TypedDict):
    """What a sum of exponentials must know of a mesh."""

    shortest_step: float
    final_time: float
    stages: int
    steps: float


def _apart(parts: list[Array]) -> Array:
    """Matrices along the diagonal of one."""
    shape = (sum(one.shape[0] for one in parts), sum(one.shape[1] for one in parts))
    whole, row, column = np.zeros(shape), 0, 0
    for one in parts:
        whole[row : row + one.shape[0], column : column + one.shape[1]] = one
        row, column = row + one.shape[0], column + one.shape[1]
    return whole


def _logarithm(operator: StageOperator) -> Array:
    """The logarithm of the method's matrix, shape ``(m, m)``."""
    found = _of_coefficients(operator.tableau.name, operator.n_stages)
    return np.asarray(operator.to_values @ found @ operator.to_coefficients)


@cache
def _of_coefficients(name: str, stages: int) -> Array:
    from scipy.linalg import logm

    return np.real(logm(StageOperator(tableau=tableau(name, stages)).matrix))
