"""Whole blocks of equal steps of linear systems side by side, each by a matrix of its own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.batches.memory import SideDamping
from fvi_cli.integrator.batches.steps import SideStep
from fvi_cli.integrator.step_tables import StepTables

Array = NDArray[np.float64]


class SideBlocks:
    """Blocks of B steps of one size.

    All follows from the response to inputs of the first step: forces of the past at its stages,
    load vectors, position and momentum at the beginning.

    Parameters
    ----------
    step, damping, tables
        Steps of that size, the damping of the systems, and numbers of the method.
    """

    def __init__(self, step: SideStep, damping: SideDamping, tables: StepTables) -> None:
        self._step, self._damping = step, damping
        self._h, self._block = step.step_size, damping.block
        self._to_velocity = np.ascontiguousarray(tables.slopes[1:].T)
        self._r, self._e = tables.points.size, step.matrix.shape[0] // (tables.degree + 1)
        inputs = self._r * self._e
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
            Force of the past at the stages of all steps, ``(B, r, e, q)``; None: there is none.
        position, momentum
            At the beginning, shape ``(e, q)``.
        loads
            Load vectors of known forces, shape ``(B, s + 1, e, q)``.

        Returns
        -------
        tuple of Array
            Velocities at the stages, ``(B r, e, q)``, and what position and momentum have changed
            by after every step, ``(B, e, q)``.
        """
        block, r, e, q = self._block, self._r, self._e, position.shape[-1]
        start = np.concatenate([momentum, position])
        force = np.zeros((block * r * e, q)) if past is None else past.reshape(-1, q)
        inputs = np.concatenate([force, start]).T
        found = (self._response @ inputs[:, :, None])[..., 0]
        if loads is not None:
            known = np.ascontiguousarray(loads.reshape(-1, q).T)
            found = found + (self._loads() @ known[:, :, None])[..., 0]
        steps = np.ascontiguousarray(found.T).reshape(block, (r + 2) * e, q)
        velocity = np.ascontiguousarray(steps[:, : r * e]).reshape(block * r, e, q)
        return velocity, steps[:, (r + 1) * e :], steps[:, r * e : (r + 1) * e]

    def _loads(self) -> Array:
        if self._by_load is None:
            columns = self._step.loads.shape[1]
            first = np.zeros((2 * self._e, columns, self._step.loads.shape[-1]))
            self._by_load = self._dense(self._impulses(self._step.loads, first), columns)
        return self._by_load

    def _impulses(self, moved: Array, start: Array) -> Array:
        """Velocities and changes of momentum and position, ``(B, (r + 2) e, columns, q)``.

        Parameters
        ----------
        moved
            What the first step moves for each input, shape ``((s + 1) e, columns, q)``.
        start
            Momentum and position that the input is itself, shape ``(2 e, columns, q)``.
        """
        r, e = self._r, self._e
        columns, q = moved.shape[1:]
        velocities = np.zeros((self._block * r, e, columns, q))
        found = np.empty((self._block, (r + 2) * e, columns, q))
        change = np.zeros_like(start)
        for index in range(self._block):
            if index:
                force = self._damping.of_block(self._step.damping, velocities, index)
                inputs = np.concatenate([force.reshape(r * e, columns, q), start + change])
                moved = (self._step.matrix[:, :, None] * inputs).sum(axis=1)
            unknowns = moved[:-e].reshape(self._to_velocity.shape[1], -1)
            velocity = (self._to_velocity @ unknowns).reshape(r, e, columns, q)
            velocities[index * r : (index + 1) * r] = velocity
            change = change + np.concatenate([moved[-e:], self._h * moved[-2 * e : -e]])
            found[index, : r * e] = velocity.reshape(r * e, columns, q)
            found[index, r * e :] = change
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
