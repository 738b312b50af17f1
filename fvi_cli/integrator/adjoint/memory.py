r"""The damping along a run, with its derivative by the orders.

The discrete force of a term is :math:`F = \mu I^{\theta} U`, :math:`\theta = 1 - \gamma`, with the
power of the mesh's own integration matrix. Its derivative by the order is exact,
:math:`-\mu \ln(I) I^{\theta} U`: the local block becomes
:math:`h^\theta A^\theta (\ln h + \ln A)`, and in the sum of exponentials only the weights
:math:`\sin(\pi\theta)/\pi\, x^{-\theta}` depend on the order, not the rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.damping import LARGEST_EXPONENT
from fvi_cli.integrator.convolution.kernel import Kernel, power_kernel_slopes
from fvi_cli.integrator.convolution.stages import StageOperator
from fvi_cli.mathematics.runge_kutta import tableau

Array = NDArray[np.float64]


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
    """All damping terms of a scene, those with a coefficient of zero as well, on one mesh.

    Parameters
    ----------
    scene
        Its damping.
    operator
        The Runge-Kutta method.
    step_sizes
        Of the whole mesh, shape ``(n,)``.

    Raises
    ------
    ValueError
        For a scene with relaxation laws.

    Attributes
    ----------
    matrices
        Coefficients of the terms, shape ``(K, d, d)``.
    is_relative
        Whether the start velocity is subtracted, shape ``(K,)``: Caputo orders above 1.
    n_rates
        Number J of exponentials.
    """

    def __init__(self, scene: Scene, operator: StageOperator, step_sizes: Array) -> None:
        if scene.active_laws:
            raise ValueError("derivatives: runs with relaxation laws are not differentiated")
        self._operator = operator
        d = scene.dimension
        self._exponents = [min(1.0 - term.order, LARGEST_EXPONENT) for term in scene.damping]
        self.matrices = np.array([term.coefficient for term in scene.damping]).reshape(-1, d, d)
        above = [scene.derivative == "caputo" and term.order > 1 for term in scene.damping]
        self.is_relative = np.array(above, dtype=bool)
        self._rates, self._weights, self._slopes = np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0))
        if self._exponents:
            shortest = float(step_sizes.min())
            self._rates, self._weights, self._slopes = power_kernel_slopes(
                self._exponents,
                shortest_step=shortest,
                final_time=scene.final_time,
                stages=operator.n_stages,
                steps=float((shortest / step_sizes).sum()),
            )
        self.n_rates = int(self._rates.size)
        logarithm = _logarithm(operator)
        self._blocks = [operator.local_block(theta) for theta in self._exponents]
        self._log_blocks = [block @ logarithm for block in self._blocks]

    @property
    def n_terms(self) -> int:
        """Number K of terms."""
        return len(self._exponents)

    def tables(self, h: float) -> TermTables:
        """Numbers of a step of length `h`."""
        k, m = self.n_terms, self._operator.n_stages
        local, slopes = np.empty((k, m, m)), np.empty((k, m, m))
        for index, theta in enumerate(self._exponents):
            local[index] = h**theta * self._blocks[index]
            slopes[index] = h**theta * self._log_blocks[index] + math.log(h) * local[index]
        if not k:
            empty = np.zeros((0, m, 0))
            return TermTables(
                local=local,
                local_slopes=slopes,
                response=empty,
                response_slopes=empty,
                decay=np.zeros(0),
                intake=np.zeros((0, m)),
            )
        plain = Kernel(terms=(0.5,), rates=self._rates, weights=np.ones((1, self.n_rates)))
        step = self._operator.step_tables(plain, h)
        return TermTables(
            local=local,
            local_slopes=slopes,
            response=step.response * self._weights[:, None, :],
            response_slopes=step.response * self._slopes[:, None, :],
            decay=step.decay,
            intake=step.intake,
        )

    def first_states(self, start_velocity: Array) -> Array:
        """States at the start, for every term, shape ``(K, J, d)``."""
        shape = (self.n_terms, self.n_rates, *start_velocity.shape)
        relative = self.is_relative.reshape(-1, *(1 for _ in shape[1:]))
        return np.where(relative, np.broadcast_to(start_velocity, shape), 0.0)


def _logarithm(operator: StageOperator) -> Array:
    """The logarithm of the method's matrix, shape ``(m, m)``."""
    found = _of_coefficients(operator.tableau.name, operator.n_stages)
    if operator.basis == "values":
        return np.asarray(operator.to_values @ found @ operator.to_coefficients)
    return found


@cache
def _of_coefficients(name: str, stages: int) -> Array:
    from scipy.linalg import logm

    return np.real(logm(StageOperator(tableau=tableau(name, stages)).matrix))
