r"""The memory of Runge-Kutta methods on any mesh: sums of exponentials.

With :math:`\theta = 1 - \gamma` the force of a term at the stages of step n is

.. math:: F_n = h_n^{\theta} A^{\theta} V_n + \sum_j w_j (1 + h_n x_j A)^{-1} 1\, s_{n,j},

with the matrix A of the method, velocities V at the stages and rates x; the states follow
:math:`s_j' = x_j (v - s_j)` by the method itself (:mod:`fvi_cli.integrator.memory.kernel`). Terms
differ in weights w alone: a table of a step size serves all terms and all members of a batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fvi_cli.integrator.memory.interface import Direction, Kernels, along
from fvi_cli.integrator.memory.kernel import Kernel, Term, power_kernel
from fvi_cli.integrator.memory.stages import (
    StageExponentials,
    StageOperator,
    stage_operator,
)
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array

STEPS_KEPT = 256
"""Number of step sizes whose exponentials are kept in a process: some 20 kilobytes each."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExponentialKernels(Kernels):
    """Tables of sums of exponentials for B equal steps."""

    step: StageExponentials  # exponentials over one of the steps
    weights: tuple[Array, ...]  # of the states in the force of every direction, (q or 1, J)
    response: Array  # undriven states that begin with 1, at the stages of the block, (B m, J)
    intake: Array  # from inputs of the block to the states at its end, (J, B m)

    @cached_property
    def change(self) -> Array:
        """Change of undriven states over the block, ``(J,)``."""
        return self.step.changes(self.count)

    def past(self, states: Sequence[Array], count: int) -> Array:
        """Force of the past on the first `count` steps: all directions in one product."""
        weighted = [
            along(weights[:, :, None] * acted, one.matrix)
            for weights, acted, one in zip(self.weights, states, self.directions, strict=True)
        ]
        total = sum(weighted[1:], start=weighted[0])
        return np.asarray(np.matmul(self.response[: count * self.n_samples], total))

    def push(self, states: Array, inputs: Array, count: int) -> Array:
        """States after the first `count` steps."""
        change = self.change if count == self.count else self.step.changes(count)
        after = change[:, None] * states
        after += np.matmul(self.intake[:, (self.count - count) * self.n_inputs :], inputs)
        after += states
        return np.asarray(after)

    def change_of_all(self, count: int) -> Array:
        """The matrix P - 1, which is diagonal."""
        return np.diag(self.step.changes(count))


class Exponentials:
    """Powers of integration and relaxation laws as sums of exponentials.

    Every term occurs once. The power 0, a damper of order 1, acts on the velocity itself and needs
    no states; if no term has memory there are none. Steps and times as for
    :func:`fvi_cli.integrator.memory.kernel.power_kernel`.
    """

    n_lags = 0  # number of steps that are stored one by one, in states of their own

    def __init__(
        self,
        method: Method,
        terms: Sequence[Term],
        *,
        shortest_step: float,
        final_time: float,
        steps: float | None,
    ) -> None:
        self._operator = stage_operator(method.cq, method.stages)
        self.terms = tuple(terms)
        # inputs of a start velocity of -1 in every step, (i,), which relative terms add
        self.column = -np.ones(self._operator.n_stages)
        self.kernel = Kernel(rates=np.zeros(0), weights=np.zeros((len(self.terms), 0)))
        if any(term != 0.0 for term in self.terms):
            self.kernel = power_kernel(
                self.terms,
                shortest_step=shortest_step,
                final_time=final_time,
                stages=method.stages,
                steps=steps,
            )
        self.weights, self.energy_weights = self.kernel.weights, self.kernel.energy_weights
        self.n_states = int(self.kernel.rates.size)

    @property
    def operations_per_step(self) -> tuple[int, int]:
        """Multiply-adds for one component in a step: for the force of a direction, and states."""
        count = self._operator.n_stages * self.n_states
        return count, count

    def of_steps(self, sizes: Array) -> tuple[Array, Array, Array, Array]:
        """Tables of single steps of u lengths at once.

        Local blocks ``(u, K, m, m)``, values at the stages of states that begin with 1 ``(u, m,
        J)``, intake ``(u, J, m)`` and change ``(u, J)``.
        """
        u, j, m = sizes.size, self.n_states, self._operator.n_stages
        local = [self._operator.local_blocks(term, sizes) for term in self.terms]
        step = self._operator.exponentials(np.outer(sizes, self.kernel.rates).ravel())
        return (
            np.array(local).reshape(len(self.terms), u, m, m).swapaxes(0, 1),
            step.stages.reshape(m, u, j).swapaxes(0, 1),
            step.intake.reshape(u, j, m),
            step.changes(1).reshape(u, j),
        )

    def kernels(
        self, h: float, count: int, directions: tuple[Direction, ...]
    ) -> ExponentialKernels:
        """Tables of `count` steps of length h."""
        m = self._operator.n_stages
        sizes = np.array([h])
        sequence = np.array([self._operator.local_blocks(term, sizes) for term in self.terms])
        step = _over_one_step(self._operator, self.kernel, h)
        response, intake = step.stages, step.intake
        if count > 1:
            powers = step.powers(count)
            response = (powers[:, None] * step.stages).reshape(count * m, -1)
            # one product for every term
            lags = np.matmul(response[:-m], self.weights[:, :, None] * step.intake)
            lags = lags.reshape(len(self.terms), count - 1, m, m)
            sequence = np.concatenate([sequence, lags], axis=1)
            intake = (powers[::-1].T[:, :, None] * step.intake[:, None]).reshape(-1, count * m)
            # by columns, of which there are fewer
            intake = np.asfortranarray(intake)
        return ExponentialKernels(
            count=count,
            directions=directions,
            sequences=tuple(one.combine(sequence) for one in directions),
            column=self.column,
            step=step,
            weights=tuple(one.combine(self.weights) for one in directions),
            response=response,
            intake=intake,
        )


@lru_cache(maxsize=STEPS_KEPT)
def _over_one_step(operator: StageOperator, kernel: Kernel, h: float) -> StageExponentials:
    """Exponentials over a step; runs of one scene, and of similar ones, take the same sizes."""
    return operator.exponentials(h * kernel.rates)
