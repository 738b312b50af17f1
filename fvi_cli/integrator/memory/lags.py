"""The memory of backward differences: the last steps one by one, sums of exponentials behind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fvi_cli.integrator.convolution.lags import lag_step, lag_tail
from fvi_cli.integrator.memory.interface import Kernels
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array


class Lags:
    """Powers of backward differences on N equal steps of length h.

    Parameters
    ----------
    method, tables
        The method and its numbers.
    exponents
        1 less the orders of the terms.
    n_steps, h
        Number and length of the steps.
    writes_out
        Whether every sum over the past is written out.
    """

    column_start = 0.0

    def __init__(
        self,
        method: Method,
        tables: StepTables,
        exponents: Sequence[float],
        *,
        n_steps: int,
        h: float,
        writes_out: bool,
    ) -> None:
        self._inputs, self.h = tables.degree, h
        orders = tuple(1.0 - one for one in exponents)
        tail = lag_tail(method.bdf_order, orders, n_steps, writes_out=writes_out)
        self._step = lag_step(method.bdf_order, tables, orders, tail, h)
        self.n_states = self._step.n_states
        self.column: Array | None = -tables.control_points[1:]
        self._decays: dict[int, Array] = {}

    def kernels(self, h: float, count: int) -> Kernels:
        """For `count` steps."""
        block = self._step.over(count)
        return Kernels(
            local=self._step.kernels[:, 0], lags=block.lags, response=block.response, block=block
        )

    def push(self, kernels: Kernels | None, z: Array, inputs: Array, count: int) -> Array:
        """States behind `count` steps."""
        s, step = self._inputs, self._step
        last, own = step.n_lags * s, count * s
        found = np.empty_like(z)
        kept = max(last - own, 0)
        found[:, :kept] = z[:, last - kept : last]
        found[:, kept:last] = inputs[:, own - (last - kept) :]
        if step.rates.size:
            if count not in self._decays:
                powers = np.outer(step.rates, np.arange(count, 0, -1))
                self._decays[count] = np.exp(-powers)
            decay = self._decays[count]
            q, _, e = z.shape
            sums = z[:, last:].reshape(q, -1, s * e)
            fresh = np.matmul(decay, inputs.reshape(q, count, s * e))
            found[:, last:] = (decay[:, :1] * sums + fresh).reshape(q, -1, e)
        return found

    def change_of_all(self, kernels: Kernels, count: int) -> Array:
        """By the block of the same number of steps."""
        return self._step.over(count).change_of_all()
