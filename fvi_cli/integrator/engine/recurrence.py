r"""Many equal blocks of steps of one linear scene, as a recurrence from block to block.

Later steps depend on one vector w: the states of the memory, the position and the momentum,
:math:`w = (z, x, p)`. A block with load vectors g maps it to

.. math:: w + \text{change}\, w + \text{change by loads}\, g,

and the rows of every step in it are linear in w and g too. So the vectors before all blocks are
computed first, and then the rows of all blocks in one matrix product.

Letters in shapes: B steps of a block, e components, J states of every component, K <= J e numbers
that stand for z, D = K + 2 e numbers of w, L = B (s + 1) e numbers of load vectors of a block.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.law import Linear
from fvi_cli.integrator.engine.products import on_steps
from fvi_cli.integrator.engine.state import State
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import UNIT

LARGEST_STATE = 300  # numbers of w; measured: quicker up to 200 with 2^13 steps, 530 with 2^15
LEAST_BLOCKS = 64  # measured: as quick with 64 blocks (Gauss3, one component), quicker with 128
DOUBLINGS = 3
"""Blocks join to pairs, fours, groups of 2^3: the loop is over groups. 2 to 5 are as quick."""


class _Map(NamedTuple):
    """Contributions of the n numbers of w, or of load vectors, to a block."""

    ends: Array  # changes of position and momentum up to the end of every step, (n, 2 B e)
    unknowns: Array  # U of every step, (n, B s e)
    change: Array  # change of w over the block, (n, D)


class Recurrence:
    """The recurrence of blocks of `count` steps of length h, of an engine with one linear scene."""

    def __init__(self, engine: Engine, h: float, count: int) -> None:
        self.engine, self.h, self.count = engine, h, count
        self._block = engine.linear_block(h, count)
        self._memory = self._block.frame.memory
        start, size = self._block.start[0], engine.n_states * engine.e
        # from states of the memory to the K numbers of w that stand for them, (K, J e)
        self._to_w = np.eye(size)
        by_memory = np.zeros((len(start), 0))
        if size and engine.damping is not None and self._memory is not None:
            units = np.eye(size).reshape(size, engine.n_states, engine.e)
            zero = np.zeros((1, engine.n_states, 1))
            force = engine.damping.at_rest().past(self._memory, units, zero, count)
            self._to_w = self._causes_of(force.reshape(size, -1), engine.damping.memory.n_lags)
            loads = self._as_loads(force)
            by_memory = self._block.by_load[0] @ (self._to_w @ loads).T
        self._of_state = self._map(np.hstack([by_memory, start]))
        if self._memory is not None:
            free = np.kron(self._memory.change_of_all(count), np.eye(engine.e))
            kept = len(self._to_w)
            self._of_state.change[:kept, :kept] += (self._to_w @ free @ self._to_w.T).T

    def _causes_of(self, force: Array, n_lags: int) -> Array:
        """Orthonormal combinations of states that cause all the memory force, ``(K, J e)``.

        `force` is that of unit states on a block, ``(J e, B m e)``. The lags of backward
        differences act on the next block only, and few combinations of them have an effect on it:
        with all of them 2^20 steps of BDF2 take 1.6 times as long.
        """
        units = np.eye(len(force))
        lags = n_lags * len(self.engine.tables.to_inputs) * self.engine.e
        if not 0 < n_lags <= self.count:
            return units
        combinations, sizes, _ = np.linalg.svd(force[:lags], full_matrices=False)
        # the decomposition itself rounds by up to 3 units
        kept = combinations[:, sizes > 4.0 * UNIT * sizes[0]].T
        return np.vstack([np.pad(kept, ((0, 0), (0, len(force) - lags))), units[lags:]])

    @staticmethod
    def is_quicker(engine: Engine, block: int, blocks: int) -> bool:
        """Whether a recurrence is quicker for so many blocks."""
        is_one_scene = isinstance(engine.law, Linear) and engine.q == 1 and not engine.is_single
        size = (engine.n_states + 2) * engine.e
        return is_one_scene and size <= LARGEST_STATE and block > 1 and blocks >= LEAST_BLOCKS

    def _as_loads(self, force: Array) -> Array:
        """Damping forces of n blocks ``(n, B m, e)`` as load vectors, ``(n, L)``."""
        n, _, e = force.shape
        by_step = force.reshape(n, self.count, -1, e)
        return on_steps(self._block.frame.to_loads, by_step).reshape(n, -1)

    def _map(self, rows: Array) -> _Map:
        """The map with these rows, ``(B (s + 2) e, n)``; the memory changes by its inputs only."""
        engine, e, n = self.engine, self.engine.e, rows.shape[1]
        by_step = rows.T.reshape(n, self.count, -1, e)
        states = np.zeros((n, engine.n_states, e))
        if self._memory is not None:
            inputs = on_steps(engine.tables.to_inputs, by_step[:, :, :-2]).reshape(n, -1, e)
            states = self._memory.push(states, inputs, self.count)
        memory = states.reshape(n, -1) @ self._to_w.T
        change = np.hstack([memory, by_step[:, -1, -2:].reshape(n, -1)])
        ends = np.ascontiguousarray(by_step[:, :, -2:].swapaxes(1, 2))
        return _Map(ends.reshape(n, -1), by_step[:, :, :-2].reshape(n, -1), change)

    @cached_property
    def _of_loads(self) -> _Map:
        """Contributions of the load vectors of a block."""
        return self._map(self._block.by_load[0])

    @cached_property
    def _changes_of_groups(self) -> list[Array]:
        """Changes of w without loads over 1, 2, 4, ... blocks, each ``(D, D)``."""
        changes = [self._of_state.change]
        for _ in range(DOUBLINGS):
            changes.append(2 * changes[-1] + changes[-1] @ changes[-1])
        return changes

    def _before_blocks(
        self, w: Array, lost: Array, blocks: int, load_changes: Array | None
    ) -> tuple[Array, Array, Array]:
        """Vectors w before every block, ``(blocks, D)``, and after all, with its rounding error.

        `load_changes` are changes of w by the loads of every block, ``(blocks, D)``. Changes over
        groups of ``2^DOUBLINGS`` blocks are added by Kahan's sum; inside a group the vector before
        its second half is computed from that before its first, and so on down to blocks.
        """
        *halves, whole = self._changes_of_groups
        levels: list[Array | None] = []  # changes by loads of the first halves of groups
        for change in halves:
            levels.append(None if load_changes is None else load_changes[::2])
            if load_changes is not None:
                first, second = load_changes[::2], load_changes[1::2]
                load_changes = second + first + first @ change
        before = np.empty((blocks >> DOUBLINGS, w.size))
        for index in range(len(before)):
            before[index] = w
            change = w @ whole - lost
            if load_changes is not None:
                change += load_changes[index]
            total = w + change
            lost = (total - w) - change
            w = total
        for change, by_loads in zip(reversed(halves), reversed(levels), strict=True):
            second = before + before @ change
            if by_loads is not None:
                second += by_loads
            before = np.stack([before, second], axis=1).reshape(-1, w.size)
        return before, w, lost

    def run(
        self, state: State, blocks: int, loads: Array | None, *, with_unknowns: bool
    ) -> tuple[Array, Array, Array | None] | None:
        """Solve `blocks` blocks, a multiple of 8, and move the state to their end.

        Returns x and p ``(1, N, e)``, and U ``(1, N, s, e)`` if `with_unknowns`, of the N =
        `blocks` B steps. `loads` are ``(1, N, s + 1, e)``. Where numbers cease to be finite it
        returns None, and keeps the state.
        """
        e, size = self.engine.e, len(self._to_w)
        by_block, column = self._load_vectors(state, blocks, loads)
        w = np.concatenate([self._to_w @ state.z[0].ravel(), state.x[0], state.p[0]])
        lost = np.concatenate([np.zeros(size), state.x_lost[0], state.p_lost[0]])
        load_changes = None
        if by_block is not None:
            load_changes = by_block @ self._of_loads.change
            if len(by_block) < blocks:
                load_changes = np.repeat(load_changes, blocks, axis=0)
        before, w, lost = self._before_blocks(w, lost, blocks, load_changes)
        if not np.isfinite(w).all():
            return None
        ends = before @ self._of_state.ends
        u = before @ self._of_state.unknowns if with_unknowns else None
        if by_block is not None:
            ends += by_block @ self._of_loads.ends
            if u is not None:
                u += by_block @ self._of_loads.unknowns
        ends = ends.reshape(blocks, 2, self.count, e)
        ends += before[:, size:].reshape(blocks, 2, 1, e)
        x, p = ends.swapaxes(0, 1).reshape(2, 1, -1, e)
        state.z, state.column = (w[:size] @ self._to_w).reshape(state.z.shape), column
        state.x, state.p = w[size:].reshape(2, 1, e)
        state.x_lost, state.p_lost = lost[size:].reshape(2, 1, e)
        state.unknowns, state.h = None, self.h
        return x, p, None if u is None else u.reshape(1, blocks * self.count, -1, e)

    def _load_vectors(
        self, state: State, blocks: int, loads: Array | None
    ) -> tuple[Array | None, Array]:
        """Load vectors of all blocks, ``(blocks, L)``, with the force of a start velocity.

        One row if all blocks have the same load vectors; None if there are none. And the states of
        a start velocity of -1 after all blocks.
        """
        engine, damping, column = self.engine, self.engine.damping, state.column
        by_block = None if loads is None else loads[0].reshape(blocks, -1)
        if damping is None or self._memory is None or not damping.subtracts:
            return by_block, column
        rows = blocks if damping.has_column else 1
        columns, column = damping.columns(self._memory, column, rows)
        zero = np.zeros((rows, engine.n_states, engine.e))
        force = self._as_loads(damping.past(self._memory, zero, columns, self.count))
        return force if by_block is None else by_block + force, column
