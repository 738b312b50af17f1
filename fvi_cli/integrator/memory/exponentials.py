"""The memory of Runge-Kutta methods: states s' = x (v - s) by the method itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.convolution.kernel import Term, power_kernel
from fvi_cli.integrator.convolution.stages import BlockKernel, StageOperator
from fvi_cli.integrator.memory.interface import Kernels
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.runge_kutta import tableau

ACCURACY = 1e-14
"""Of the sums of exponentials, relative to the weights of the past."""


class Exponentials:
    """Powers of integration and relaxation laws as sums of exponentials.

    Parameters
    ----------
    method, terms
        A Runge-Kutta method, and what is remembered; at least one.
    shortest_step, final_time, steps
        As for :func:`fvi_cli.integrator.convolution.kernel.power_kernel`.
    """

    column: Array | None = None
    column_start = 1.0

    def __init__(
        self,
        method: Method,
        terms: Sequence[Term],
        *,
        shortest_step: float,
        final_time: float,
        steps: float | None,
    ) -> None:
        self._operator = StageOperator(tableau=tableau(method.cq, method.stages))
        self._terms, self._inputs = terms, method.stages
        self.kernel = power_kernel(
            terms,
            shortest_step=shortest_step,
            final_time=final_time,
            stages=method.stages,
            steps=steps,
            accuracy=ACCURACY,
        )
        self.n_states = self.kernel.n_states

    def kernels(self, h: float, count: int) -> Kernels:
        """For `count` steps of length h."""
        op = self._operator
        local = np.array(
            [
                h**term * op.local_block(term) if isinstance(term, float) else op.law_block(term, h)
                for term in self._terms
            ]
        )
        block = op.step_tables(self.kernel, h).over(count)
        return Kernels(local=local, lags=block.lags, response=block.response, block=block)

    def over(self, kernels: Kernels, count: int) -> tuple[Array, Array]:
        """Change of undriven states ``(J,)`` and intake ``(J, count i)`` of the first steps."""
        block = kernels.block
        if not isinstance(block, BlockKernel):
            raise TypeError("kernels: those of another memory")
        if count == block.steps:
            return block.change, block.intake
        logs = count * block.step.log_magnitudes
        signs = block.step.signs if count % 2 else np.ones_like(logs)
        change = np.where(signs > 0, np.expm1(logs), signs * np.exp(logs) - 1)
        return change, block.intake[:, (block.steps - count) * self._inputs :]

    def push(self, kernels: Kernels, z: Array, inputs: Array, count: int) -> Array:
        """States behind `count` steps."""
        change, intake = self.over(kernels, count)
        return np.asarray(z + (change[:, None] * z + np.matmul(intake, inputs)))

    def change_of_all(self, kernels: Kernels, count: int) -> Array:
        """A diagonal matrix."""
        return np.diag(self.over(kernels, count)[0])
