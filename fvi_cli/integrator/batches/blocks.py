"""Whole blocks of equal steps of linear systems side by side, each by a matrix of its own."""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.batches.memory import SideDamping
from fvi_cli.integrator.batches.steps import SideStep
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array


class SideBlocks:
    """Blocks of B steps of one size.

    All follows from the response to inputs of the first step: forces of the past where they act,
    load vectors, position and momentum at the beginning.

    Parameters
    ----------
    step, damping, sampling
        Steps of that size, the damping of the systems, and where it acts.
    """

    def __init__(self, step: SideStep, damping: SideDamping, sampling: ForceSampling) -> None:
        self._step, self._damping = step, damping
        self._h, self._block = step.step_size, damping.block
        self._to_driving = sampling.driving
        rows, degree = sampling.driving.shape
        self._m, self._driven = sampling.weights.size, rows
        self._e = step.matrix.shape[0] // (degree + 1)
        inputs = self._m * self._e
        moved, starts = step.matrix[:, :inputs], step.matrix[:, inputs:]
        first = np.zeros((2 * self._e, inputs, moved.shape[-1]))
        by_force = self._dense(self._impulses(moved, first), inputs)
        # momentum and position, in this order
        units = np.zeros((2 * self._e, 2 * self._e, moved.shape[-1]))
        units[np.arange(2 * self._e), np.arange(2 * self._e)] = 1.0
        by_start = self._rows(self._impulses(starts, units))
        self._response = np.concatenate([by_force, by_start], axis=2)
        self._by_load: Array | None = None

    def advance(
        self, past: Array | None, position: Array, momentum: Array, loads: Array | None
    ) -> tuple[Array, Array, Array]:
        """Do the steps of a block.

        Parameters
        ----------
        past
            Force of the past in all steps, ``(B, m, e, q)``; None: there is none.
        position, momentum
            At the beginning, shape ``(e, q)``.
        loads
            Load vectors of known forces, shape ``(B, s + 1, e, q)``.

        Returns
        -------
        tuple of Array
            What drives the damping, ``(B inputs, e, q)``, and what position and momentum have
            changed by after every step, ``(B, e, q)``.
        """
        block, rows, e, q = self._block, self._driven, self._e, position.shape[-1]
        start = np.concatenate([momentum, position])
        force = np.zeros((block * self._m * e, q)) if past is None else past.reshape(-1, q)
        inputs = np.concatenate([force, start]).T
        found = (self._response @ inputs[:, :, None])[..., 0]
        if loads is not None:
            known = np.ascontiguousarray(loads.reshape(-1, q).T)
            found = found + (self._loads() @ known[:, :, None])[..., 0]
        steps = np.ascontiguousarray(found.T).reshape(block, (rows + 2) * e, q)
        driving = np.ascontiguousarray(steps[:, : rows * e]).reshape(block * rows, e, q)
        return driving, steps[:, (rows + 1) * e :], steps[:, rows * e : (rows + 1) * e]

    def _loads(self) -> Array:
        if self._by_load is None:
            columns = self._step.loads.shape[1]
            first = np.zeros((2 * self._e, columns, self._step.loads.shape[-1]))
            self._by_load = self._dense(self._impulses(self._step.loads, first), columns)
        return self._by_load

    def _impulses(self, moved: Array, start: Array) -> Array:
        """What drives, and changes of momentum and position, ``(B, (inputs + 2) e, columns, q)``.

        Parameters
        ----------
        moved
            What the first step moves for each input, shape ``((s + 1) e, columns, q)``.
        start
            Momentum and position that the input is itself, shape ``(2 e, columns, q)``.
        """
        rows, e = self._driven, self._e
        columns, q = moved.shape[1:]
        driving = np.zeros((self._block * rows, e, columns, q))
        found = np.empty((self._block, (rows + 2) * e, columns, q))
        change = np.zeros_like(start)
        for index in range(self._block):
            if index:
                force = self._damping.of_block(self._step.damping, driving, index)
                inputs = np.concatenate([force.reshape(-1, columns, q), start + change])
                moved = (self._step.matrix[:, :, None] * inputs).sum(axis=1)
            unknowns = moved[:-e].reshape(self._to_driving.shape[1], -1)
            own = (self._to_driving @ unknowns).reshape(rows, e, columns, q)
            driving[index * rows : (index + 1) * rows] = own
            change = change + np.concatenate([moved[-e:], self._h * moved[-2 * e : -e]])
            found[index, : rows * e] = own.reshape(rows * e, columns, q)
            found[index, rows * e :] = change
        return found

    def _rows(self, impulses: Array) -> Array:
        """Systems first, all rows one after the other, ``(q, rows, columns)``."""
        columns, q = impulses.shape[2:]
        return np.ascontiguousarray(np.moveaxis(impulses.reshape(-1, columns, q), -1, 0))

    def _dense(self, impulses: Array, columns: int) -> Array:
        """From the response to the first step's inputs that to all, ``(q, rows, B columns)``."""
        block, rows, _, q = impulses.shape
        own = np.moveaxis(impulses, -1, 0)
        total = np.zeros((q, block, rows, block * columns))
        for first in range(block):
            part = slice(first * columns, (first + 1) * columns)
            total[:, first:, :, part] = own[:, : block - first]
        return total.reshape(q, block * rows, block * columns)
