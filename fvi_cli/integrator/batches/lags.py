r"""The damping of systems side by side by backward differences on equal steps.

The states are those of :mod:`fvi_cli.integrator.convolution.lags`. All systems have the same
orders, and one response for every order serves all; they differ in coefficients. Where a term
subtracts the start velocity one more column, driven by the constant velocity -1, serves all systems
that have any.
"""

from __future__ import annotations

import numpy as np

from fvi_cli.integrator.batches.memory import SideDamping, SideTables, along
from fvi_cli.integrator.batches.systems import Systems, Terms
from fvi_cli.integrator.convolution.lags import LagStep, lag_step, lag_tail
from fvi_cli.integrator.convolution.stages import BlockHistory
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array

Factors = dict[int, Array]
"""By the number of an order the coefficients of all systems, ``(q,)``."""

ORDER_ONE = 0.0
"""The exponent of the terms of order 1."""
PIECE = 128
"""Sums of more products are rounded differently beside more or fewer systems."""


class SideLags(SideDamping):
    """Fractional damping of systems side by side on N equal steps.

    Parameters
    ----------
    systems
        Whose damping; all of the same orders.
    method, tables
        The method and its numbers.
    step_size, n_steps
        h and N.
    block
        Most steps B of a block.
    jumps
        Whether samples on the nodes begin with a step from 0 to the initial position.
    """

    def __init__(
        self,
        systems: Systems,
        method: Method,
        tables: StepTables,
        *,
        step_size: float,
        n_steps: int,
        block: int,
        jumps: bool,
    ) -> None:
        self._slots, self._h, self.block = systems.slots, step_size, block
        self._m, self._inputs = tables.sample_points.size, tables.degree
        self._e, self._q = systems.shape
        self._column, self._jumps = -tables.control_points[1:], jumps
        self._blocks = {}
        found = {term for slot in systems.slots for (term, _), _, _ in slot.terms}
        exponents = sorted(term for term in found if isinstance(term, float))
        if any(slot.rate.any() for slot in systems.slots) and ORDER_ONE not in exponents:
            exponents = sorted([*exponents, ORDER_ONE])
        self._exponents = exponents
        orders = tuple(1.0 - term for term in exponents)
        self._step: LagStep | None = None
        if orders:
            tail = lag_tail(method.bdf_order, orders, n_steps)
            self._step = lag_step(method.bdf_order, tables, orders, tail, step_size)
        self._factors = [self._of(slot.terms, slot.rate) for slot in systems.slots]
        self._relative = [self._of(slot.relative) for slot in systems.slots]

    def _of(self, terms: Terms, rate: Array | None = None) -> Factors:
        found: Factors = {}
        if rate is not None and rate.any():
            found[self._exponents.index(ORDER_ONE)] = rate.copy()
        for (term, _), places, factors in terms:
            if isinstance(term, float):
                own = found.setdefault(self._exponents.index(term), np.zeros(self._q))
                own[places] += factors
        return dict(sorted(found.items()))

    @property
    def n_states(self) -> int:
        """Number of states of every system."""
        return 0 if self._step is None else self._step.n_states

    def at_start(self, systems: Systems) -> tuple[Array, Array]:
        """The states of all systems, and those of a start velocity of 1, at the start."""
        states, carried = np.zeros((self.n_states, *systems.shape)), np.zeros(self.n_states)
        if self._jumps and self._step is not None:
            first = np.zeros((self._inputs, *systems.shape))
            first[-1] = systems.position / self._h
            states = self.pushed(self._step.over(1), states, first)
        return states, carried

    def tables(self, step_size: float) -> SideTables:
        """Numbers of a step."""
        if self._step is None:
            return SideTables(local=(), lags=(), constant=None, step=None)
        newest = self._step.kernels[:, 0]
        # from the largest lag to the smallest, beside each other
        before = self._step.kernel_at(np.arange(self.block - 1, 0, -1)).transpose(0, 2, 1, 3)
        before = before.reshape(len(before), self._m, -1)
        constant = np.zeros((self._m, self._e, self._q))
        for slot, factors in zip(self._slots, self._relative, strict=True):
            for index, own in factors.items():
                constant += (newest[index] @ self._column)[:, None, None] * (own * slot.start)
        return SideTables(
            local=tuple(self._combined(newest, factors) for factors in self._factors),
            lags=tuple(self._combined(before, factors) for factors in self._factors),
            constant=constant if constant.any() else None,
            step=self._step,
        )

    def _combined(self, by_order: Array, factors: Factors) -> Array:
        total = np.zeros((*by_order.shape[1:], self._q))
        for index, own in factors.items():
            total += by_order[index][..., None] * own
        return total

    def past(self, block: BlockHistory, states: Array, carried: Array) -> Array:
        """Force of the states on all steps of a block, shape ``(count, m, e, q)``."""
        e, q, flat = self._e, self._q, states.reshape(self.n_states, -1)
        forces = [_in_pieces(response, flat).reshape(-1, e, q) for response in block.response]
        total = np.zeros(forces[0].shape)
        every = zip(self._slots, self._factors, self._relative, strict=True)
        for slot, factors, relative in every:
            own = np.zeros_like(total)
            for index, numbers in factors.items():
                own += forces[index] * numbers
            total += own if slot.direction is None else along(own, slot.direction)
            for index, numbers in relative.items():
                column = (block.response[index] @ carried).reshape(-1, self._m)
                column[1:] += np.cumsum(block.lags[index] @ self._column, axis=0)
                total += column.reshape(-1, 1, 1) * (numbers * slot.start)
        if self._jumps and not carried.any():
            # the paper's first step is without the force of the initial position
            total[0] = 0.0
        return total.reshape(-1, self._m, e, q)

    def carried_after(self, block: BlockHistory, carried: Array) -> Array:
        """The states of a start velocity behind a block."""
        steps = block.lags.shape[1] + 1
        return block.after(carried[:, None], np.tile(self._column, steps)[:, None])[:, 0]


def _in_pieces(matrix: Array, values: Array) -> Array:
    """A matrix product, the inner index in pieces."""
    total = matrix[:, :PIECE] @ values[:PIECE]
    for first in range(PIECE, len(values), PIECE):
        piece = slice(first, first + PIECE)
        total += matrix[:, piece] @ values[piece]
    return np.asarray(total)
