r"""Many equal blocks of steps of one linear system, as a recurrence from block to block.

Later steps depend on one vector w: the states of the memory, the position and the momentum,
:math:`w = (z, x, p)`. A block with load vectors g maps it to

.. math:: w + \text{change}\, w + \text{change by loads}\, g,

and its *outputs*, the results of every step in it, are linear in w and g too. So the vectors
before all blocks are computed first, and then the outputs of all blocks in one matrix product.

Letters in shapes: B steps of a block, s unknowns of a step for every component, e components, J
states of the memory of every component, i inputs of the memory of a step for every component, m
points of a step where the damping force is taken, K <= J e numbers of z, D = K + 2 e numbers of w,
L = B (s + 1) e numbers of the load vectors of a block.

The lags of a block act on the next block only, and few combinations of them have an effect on its
force: z has these combinations, orthonormal, in place of the lags.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fvi_cli.integrator.engine.law import Linear
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.tables import on_steps
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import UNIT

if TYPE_CHECKING:
    from fvi_cli.integrator.engine.engine import Engine

LARGEST_STATE = 300  # numbers D of w up to which a recurrence is used
LEAST_BLOCKS = 24  # blocks from which on it is used
LARGE_STATE, STEPS_OF_LARGE = 200, 4
"""If w has more than 200 numbers, the tables pay if there is a block for every 4 of them."""
DOUBLINGS = 3
"""Blocks are joined to pairs, these to groups of 4, and these to groups of 2^3."""


def is_recurrence_quicker(size: int, block: int, blocks: int, total: int) -> bool:
    """Whether a recurrence is quicker for `blocks` blocks of a linear system with D = `size`.

    Blocks have `block` steps; they are part of `total` successive equal steps.
    """
    return (
        size <= LARGEST_STATE
        and block >= LEAST_BLOCKS // 6
        and blocks >= LEAST_BLOCKS
        and (size <= LARGE_STATE or total // block >= size // STEPS_OF_LARGE)
    )


class _Map(NamedTuple):
    """Contributions of the n numbers of w, or of load vectors, to a block."""

    # changes of position and momentum up to the end of every step, components first, (n, 2 e B)
    ends: Array
    inputs: Array  # inputs of the memory in every step, (n, B i e)
    change: Array  # change of w over the block, (D, n)


class Recurrence:
    """The recurrence of blocks of `count` steps of length h, of an engine with one linear scene."""

    def __init__(self, engine: Engine, h: float, count: int) -> None:
        self.engine, self.h, self.count = engine, h, count
        self._operator = engine.operator(h, count)
        self.frame = self._operator.frame
        (by_force,), motion_size = self._operator.outputs, 2 * engine.e
        # from states of the memory to z, (K, J e)
        self._seen = np.zeros((0, 0))
        force = np.zeros((by_force.shape[1] - motion_size, 0))
        if engine.n_states:
            force = self._memory_force()
            self._seen = self._seen_by(force)
            force = force @ self._seen.T
        self._memory_size = memory_size = len(self._seen)
        outputs = np.hstack([by_force[:, motion_size:] @ force, by_force[:, :motion_size]])
        self._of_state = self._split(outputs)
        if self.frame.damping is not None:
            free = np.kron(self.frame.damping.kernels.change_of_all(count), np.eye(engine.e))
            self._of_state.change[:memory_size, :memory_size] += self._seen @ free @ self._seen.T

    @staticmethod
    def is_quicker(engine: Engine, block: int, blocks: int, total: int) -> bool:
        """Whether `blocks` blocks, of `total` equal steps, are quicker as a recurrence."""
        is_one = isinstance(engine.law, Linear) and engine.q == 1 and not engine.is_batch
        size = (engine.n_states + 2) * engine.e
        return is_one and is_recurrence_quicker(size, block, blocks, total)

    def _memory_force(self) -> Array:
        """From states of the memory to the memory force in a block, ``(B m e, J e)``."""
        engine, tables = self.engine, self.frame.damping
        if engine.damping is None or tables is None:
            raise ValueError("damping: the scene has no damping")
        size = engine.n_states * engine.e
        units = np.eye(size).reshape(size, engine.n_states, engine.e)
        zero = np.zeros((1, engine.n_states, 1))
        force = engine.damping.at_rest().past(tables, units, zero, self.count)
        return force.reshape(size, -1).T

    def _seen_by(self, force: Array) -> Array:
        """Orthonormal combinations of states that cause all the memory force, ``(K, J e)``."""
        engine, found = self.engine, np.eye(force.shape[1])
        memory = None if engine.damping is None else engine.damping.memory
        if memory is None or not 0 < memory.n_lags <= self.count:
            return found
        lags = memory.n_lags * len(engine.tables.to_inputs) * engine.e
        _, sizes, rows = np.linalg.svd(force[:, :lags], full_matrices=False)
        # the decomposition itself rounds by up to 3 units
        rows = rows[sizes > 4.0 * UNIT * sizes[0]]
        found = found[lags - len(rows) :]
        found[: len(rows), :lags] = rows
        return found

    def _split(self, outputs: Array) -> _Map:
        """Split outputs of the operator, ``(B (i + 2) e, n)``: inputs, positions, momenta of steps.

        The change of the memory is that by these inputs only.
        """
        engine, e, columns = self.engine, self.engine.e, outputs.shape[1]
        input_rows = len(outputs) - 2 * self.count * e
        ends = outputs[input_rows:].reshape(2, self.count, e, columns)
        inputs = np.ascontiguousarray(outputs[:input_rows].T)
        change = np.zeros((self._memory_size + 2 * e, columns))
        if self.frame.damping is not None and self._memory_size:
            zero = np.zeros((columns, engine.n_states, e))
            by_step = inputs.reshape(columns, -1, e)
            states = self.frame.damping.kernels.push(zero, by_step, self.count)
            change[: self._memory_size] = self._seen @ states.reshape(columns, -1).T
        change[self._memory_size :] = ends[:, -1].reshape(2 * e, columns)
        components_first = ends.transpose(3, 0, 2, 1).reshape(columns, -1)
        return _Map(np.ascontiguousarray(components_first), inputs, change)

    @cached_property
    def _changes_of_groups(self) -> list[Array]:
        """Changes of w without loads over 1, 2, 4, ... blocks, each ``(D, D)``."""
        found = [self._of_state.change]
        for _ in range(DOUBLINGS):
            found.append(2 * found[-1] + found[-1] @ found[-1])
        return found

    @cached_property
    def _of_loads(self) -> _Map:
        """Contributions of the load vectors of a block (n = L); `change` is transposed."""
        found = self._split(self._operator.outputs_of_loads[0])
        return found._replace(change=np.ascontiguousarray(found.change.T))

    def _before_blocks(
        self,
        w: Array,
        rounding: Array,
        blocks: int,
        load_changes: Array | None,
        doublings: int,
    ) -> tuple[Array, Array, Array]:
        """Vectors w before every block, ``(blocks, D)``, and after all, with its rounding error.

        `load_changes` are changes of w by the loads of every block, ``(blocks, D)``. Changes over
        groups of ``2^doublings`` blocks are added by Kahan's sum; inside a group the vector
        before its second half is computed from that before its first, and so on down to blocks.
        """
        changes = self._changes_of_groups[: doublings + 1]
        levels = [load_changes]
        for change_of_half in changes[:-1]:
            if load_changes is not None:
                first_halves, second_halves = load_changes[::2], load_changes[1::2]
                load_changes = second_halves + first_halves + first_halves @ change_of_half.T
            levels.append(load_changes)
        before = np.empty((blocks >> doublings, w.size))
        for index in range(len(before)):
            before[index] = w
            change = changes[-1] @ w
            if load_changes is not None:
                change += load_changes[index]
            change -= rounding
            total = w + change
            rounding = (total - w) - change
            w = total
        for change_of_half, by_loads in zip(changes[-2::-1], levels[-2::-1], strict=True):
            halves = np.empty((len(before), 2, w.size))
            halves[:, 0], halves[:, 1] = before, before + before @ change_of_half.T
            if by_loads is not None:
                halves[:, 1] += by_loads[::2]
            before = halves.reshape(-1, w.size)
        return before, w, rounding

    def run(
        self, state: State, blocks: int, loads: Array | None, *, with_inputs: bool = False
    ) -> tuple[Array, Array, Array | None]:
        """Solve `blocks` blocks, and move the state to their end.

        Returns x and p after each of the N = `blocks` B steps, ``(1, N, e)`` each, and the inputs
        of the memory, ``(blocks, B i e)``, if `with_inputs`. `loads` are ``(1, N, s + 1, e)``.
        """
        e, memory_size = self.engine.e, self._memory_size
        load_vectors = self._load_vectors(state, blocks, loads)
        w = np.concatenate([self._seen @ state.z.ravel(), state.x[0], state.p[0]])
        rounding = np.concatenate([np.zeros(memory_size), state.x_lost[0], state.p_lost[0]])
        load_changes = None if load_vectors is None else load_vectors @ self._of_loads.change
        if load_changes is not None and len(load_changes) < blocks:
            load_changes = np.repeat(load_changes, blocks, axis=0)
        group = 1 << DOUBLINGS
        grouped = blocks - blocks % group
        parts = []
        for first, last, doublings in ((0, grouped, DOUBLINGS), (grouped, blocks, 0)):
            own = None if load_changes is None else load_changes[first:last]
            part, w, rounding = self._before_blocks(w, rounding, last - first, own, doublings)
            parts.append(part)
        before = np.concatenate(parts) if blocks % group else parts[0]
        ends = before @ self._of_state.ends
        inputs = before @ self._of_state.inputs if with_inputs else None
        if load_vectors is not None:
            ends += load_vectors @ self._of_loads.ends
            if inputs is not None:
                inputs += load_vectors @ self._of_loads.inputs
        ends = ends.reshape(blocks, 2 * e, self.count)
        ends += before[:, memory_size:, None]
        state.x, state.p = _position_and_momentum(w, e)
        state.z = (w[:memory_size] @ self._seen).reshape(state.z.shape)
        state.x_lost, state.p_lost = _position_and_momentum(rounding, e)
        state.unknowns, state.h = None, self.h
        x, p = (one.swapaxes(1, 2).reshape(1, -1, e) for one in (ends[:, :e], ends[:, e:]))
        return x, p, inputs

    def _load_vectors(self, state: State, blocks: int, loads: Array | None) -> Array | None:
        """Load vectors of all blocks, ``(blocks, L)``, with the memory force of a start velocity.

        One row if all blocks have the same load vectors; None if there are none.
        """
        engine, count, damping = self.engine, self.count, self.engine.damping
        tables = self.frame.damping
        is_relative = damping is not None and damping.subtracts
        if loads is None and not is_relative:
            return None
        is_constant = loads is None and damping is not None and not damping.has_column
        rows = 1 if is_constant else blocks
        found = np.zeros((rows, count, engine.tables.degree + 1, engine.e))
        if loads is not None:
            found += loads[0].reshape(found.shape)
        if damping is not None and tables is not None and is_relative:
            columns, state.column = damping.columns(tables, state.column, rows)
            zero = np.zeros((rows, engine.n_states, engine.e))
            force = damping.past(tables, zero, columns, count)
            found -= on_steps(self.frame.to_loads, force.reshape(rows, count, -1, engine.e))
        return found.reshape(rows, -1)


def _position_and_momentum(w: Array, e: int) -> tuple[Array, Array]:
    """Position and momentum, the end of w, ``(1, e)`` each."""
    return w[None, -2 * e : -e], w[None, -e:]
