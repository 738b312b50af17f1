"""The damping's past over blocks of equal steps."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.convolution.damping import Damping, DampingTables
from fvi_cli.integrator.convolution.stages import BlockHistory
from fvi_cli.mathematics.arrays import Array


class BlockMemory:
    """Forces of the past on the steps of a block, and what a block adds to the states.

    Parameters
    ----------
    damping, tables
        The damping and its numbers for the step size; with memory.
    block
        Most steps B of a block.
    """

    def __init__(self, damping: Damping, tables: DampingTables, block: int) -> None:
        if tables.step is None:
            raise ValueError("damping: without memory there is no past")
        self._damping, self._tables = damping, tables
        self._stages = tables.local[0].shape[0]
        self._made: dict[int, BlockHistory] = {}
        self.block = block
        whole = self.kernel(block)
        combined = [damping.combined(one, whole.response) for one in damping.directions]
        self.responses = tuple(combined)
        self._driven: tuple[Array, ...] = ()
        if damping.has_column and damping.column_driving.any():
            # what drives the column in the steps of a block acts on those behind them
            lags = [damping.combined(one, whole.lags) for one in damping.directions]
            self._driven = tuple(np.cumsum(one @ damping.column_driving, axis=0) for one in lags)

    def kernel(self, steps: int) -> BlockHistory:
        """Tables of blocks of so many steps."""
        if steps not in self._made:
            step = self._tables.step
            if step is None:
                raise ValueError("damping: without memory there is no past")
            self._made[steps] = step.over(steps)
        return self._made[steps]

    def carried_force(self, carried: Array, steps: int) -> Array:
        """Force, on every stage, of the start velocity in the column of its own.

        Parameters
        ----------
        carried
            That column of the states, shape ``(J,)``.
        steps
            At most B.

        Returns
        -------
        Array
            Shape ``(steps, m, d)``.
        """
        m, d = self._stages, self._damping.dimension
        total = np.zeros((steps, m, d))
        for index, one in enumerate(self._damping.directions):
            if one.start_force is not None:
                own = (self.responses[index][: steps * m] @ carried).reshape(steps, m)
                if self._driven:
                    own[1:] += self._driven[index][: steps - 1]
                total += own[:, :, None] * one.start_force
        return total

    def carried_after(self, carried: Array, steps: int) -> Array:
        """The same column so many steps later."""
        driving = np.tile(self._damping.column_driving, steps)
        return self.kernel(steps).after(carried[:, None], driving[:, None])[:, 0]
