"""The damping's past over a few equal steps that are done one by one.

States of thousands of components are more than the processor keeps at hand: they are looked at once
for a group of steps. What the steps of a group do to each other are sums with the weights of their
lags, as in a block.
"""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.convolution.damping import Damping, DampingTables
from fvi_cli.integrator.convolution.stages import BlockHistory
from fvi_cli.mathematics.arrays import Array

GROUP = 16
"""Steps of a group: then the sums inside of it take as long as the states at its ends."""


class StepGroup:
    """Forces of the past in up to :data:`GROUP` equal steps, and the states after them.

    Parameters
    ----------
    damping, tables
        The damping and its numbers for the step size; with memory.
    """

    def __init__(self, damping: Damping, tables: DampingTables) -> None:
        if tables.step is None:
            raise ValueError("damping: without memory there is no past")
        self._damping, self._step = damping, tables.step
        self._stages, self._inputs = tables.local[0].shape
        self._kernels: dict[int, BlockHistory] = {}
        whole = self._kernel(GROUP)
        self._directions = [one for one in damping.directions if one.terms]
        self._responses = [damping.combined(one, whole.response) for one in self._directions]
        # from the largest lag to the smallest, side by side: the last columns are the nearest
        self._lags = [
            np.concatenate(list(damping.combined(one, whole.lags)[::-1]), axis=1)
            for one in self._directions
        ]
        self._states = np.zeros((0, 0))
        self._known: list[Array] = []
        self._driving = np.zeros((0, 0))
        self.done = 0

    def _kernel(self, steps: int) -> BlockHistory:
        if steps not in self._kernels:
            self._kernels[steps] = self._step.over(steps)
        return self._kernels[steps]

    def begin(self, states: Array) -> None:
        """Take the states, shape ``(J, columns)``, at the beginning of a group."""
        self._states = states
        self._known = [response @ states for response in self._responses]
        self._driving = np.empty((GROUP * self._inputs, states.shape[1]))
        self.done = 0

    @property
    def is_full(self) -> bool:
        """Whether the group holds no further step."""
        return self.done == GROUP

    def force(self) -> Array:
        """Force of the past at the stages of the next step, shape ``(m, d)``."""
        m, first, before = self._stages, self.done * self._stages, self.done * self._inputs
        total = np.zeros((m, self._damping.n_remembered))
        for one, known, lags in zip(self._directions, self._known, self._lags, strict=True):
            carried = known[first : first + m]
            if before:
                carried = carried + lags[:, -before:] @ self._driving[:before]
            total += self._damping.force_of_states(one, carried)
        return self._damping.spread(total)

    def push(self, driving: Array) -> None:
        """Note what drove the states in that step, shape ``(inputs, columns)``."""
        first = self.done * self._inputs
        self._driving[first : first + self._inputs] = driving
        self.done += 1

    def end(self) -> Array:
        """The states after the steps that are done."""
        if self.done == 0:
            return self._states
        driving = self._driving[: self.done * self._inputs]
        return self._kernel(self.done).after(self._states, driving)
