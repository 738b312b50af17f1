"""Many blocks of one linear system: a recurrence, and all their steps in one matrix product."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fvi_cli.integrator.engine.law import Linear
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.engine.tables import on_steps
from fvi_cli.integrator.memory.lag_sequences import expand
from fvi_cli.mathematics.arrays import Array

if TYPE_CHECKING:
    from fvi_cli.integrator.engine.engine import Engine

LARGEST_STATE = 300
LEAST_BLOCKS = 24
LARGE_STATE, STEPS_OF_LARGE = 200, 4
"""From so many numbers on, so many blocks for each of 4 pay for the tables."""


def pays_as_one(size: int, block: int, blocks: int, total: int) -> bool:
    """Whether blocks of a linear system with a state of `size` numbers are best one recurrence.

    Parameters
    ----------
    size, block, blocks
        J e + 2 e, steps of a block, and blocks in a row.
    total
        Equal steps of their stretch.
    """
    return (
        size <= LARGEST_STATE
        and block >= LEAST_BLOCKS // 6
        and blocks >= LEAST_BLOCKS
        and (size <= LARGE_STATE or total // block >= size // STEPS_OF_LARGE)
    )


class Recurrence:
    """w = (z, x, p) from block to block as one matrix.

    Its columns are what :meth:`Engine.solve` gives for unit vectors as members.

    Parameters
    ----------
    engine, h, count
        One linear system, and the steps of a block.
    """

    def __init__(self, engine: Engine, h: float, count: int) -> None:
        self.engine, self.h, self.count = engine, h, count
        self.frame = engine.frame(h, count)
        j, e = engine.n_states, engine.e
        self.held = j * e
        n = self.held + 2 * e
        units = np.eye(n)
        z = units[:, : self.held].reshape(n, j, e)
        found = self._solved(z, units[:, self.held : self.held + e], units[:, -e:], None)
        self._outputs = np.concatenate([found.dx, found.dp], axis=2).reshape(n, -1)
        self._inputs = found.inputs.reshape(n, -1)
        self._change = np.zeros((n, n))
        self._change[: self.held] = self._behind(found.inputs).T
        if self.frame.damping is not None:
            whole = self.frame.damping.kernels.change_of_all(count)
            self._change[: self.held, : self.held] += np.kron(whole, np.eye(e))
        self._change[self.held : self.held + e] = found.dx[:, -1].T
        self._change[self.held + e :] = found.dp[:, -1].T

    @staticmethod
    def pays(engine: Engine, block: int, blocks: int, total: int) -> bool:
        """Whether so many blocks, of `total` steps in their stretch, are quicker so."""
        is_one = isinstance(engine.law, Linear) and engine.q == 1 and not engine.is_batch
        return is_one and pays_as_one((engine.n_states + 2) * engine.e, block, blocks, total)

    def _solved(self, z: Array, x: Array, p: Array, loads: Array | None) -> Steps:
        """Steps from many states without a start velocity."""
        n, zero = len(x), np.zeros(x.shape)
        state = State(
            t=0.0,
            x=x,
            p=p,
            x_lost=zero,
            p_lost=zero,
            z=z,
            column=np.zeros((1, self.engine.n_states, 1)),
            live=np.ones(n, dtype=bool),
            longest=np.zeros(n, dtype=np.int64),
            wait=np.zeros(n, dtype=np.int64),
            excess=np.zeros(n, dtype=np.int64),
            stale=np.zeros(n, dtype=bool),
            taken=np.zeros(n, dtype=np.int64),
        )
        return self.engine.solve(state, self.h, self.count, loads, starts_at_rest=True)

    def _behind(self, inputs: Array) -> Array:
        """States behind a block that begins without a past, ``(n, J e)``."""
        engine = self.engine
        if self.frame.damping is None:
            return np.zeros((len(inputs), 0))
        zero = np.zeros((len(inputs), engine.n_states, engine.e))
        found = self.frame.damping.kernels.push(zero, inputs, self.count)
        return found.reshape(len(inputs), -1)

    @cached_property
    def _by_load(self) -> tuple[Array, Array, Array]:
        """Load vectors to outputs, inputs and changes: those of the first step, and shifts."""
        engine, count = self.engine, self.count
        rows, e = engine.tables.degree + 1, engine.e
        n = rows * e
        loads = np.zeros((n, count, rows, e))
        loads[:, 0] = np.eye(n).reshape(n, rows, e)
        zero = np.zeros((n, e))
        found = self._solved(np.zeros((n, engine.n_states, e)), zero, zero, loads)
        ends = expand(np.concatenate([found.dx, found.dp], axis=2).transpose(1, 2, 0))
        inputs = expand(found.inputs.reshape(n, count, -1).transpose(1, 2, 0))
        changes = np.zeros((self.held + 2 * e, count * n))
        changes[: self.held] = self._behind(inputs.T.reshape(count * n, -1, e)).T
        changes[self.held :] = ends[-2 * e :]
        return tuple(np.ascontiguousarray(one.T) for one in (ends, inputs, changes))  # type: ignore[return-value]

    def run(
        self, state: State, blocks: int, loads: Array | None, *, with_inputs: bool = False
    ) -> tuple[Array, Array, Array | None]:
        """Take `blocks` blocks; the state moves on.

        Returns
        -------
        tuple
            x and p after every step, ``(1, n, e)``, and the inputs of the memory
            ``(blocks, B i e)`` if they are wanted.
        """
        e, held = self.engine.e, self.held
        known = self._known(state, blocks, loads)
        value = np.concatenate([state.z.ravel(), state.x[0], state.p[0]])
        lost = np.concatenate([np.zeros(held), state.x_lost[0], state.p_lost[0]])
        path = np.empty((blocks, value.size))
        kicks = None if known is None else known @ self._by_load[2]
        for index in range(blocks):
            path[index] = value
            change = self._change @ value
            if kicks is not None:
                change += kicks[index if len(kicks) > 1 else 0]
            change -= lost
            total = value + change
            lost = (total - value) - change
            value = total
        ends, inputs = path @ self._outputs, path @ self._inputs if with_inputs else None
        if known is not None:
            ends += known @ self._by_load[0]
            if inputs is not None:
                inputs += known @ self._by_load[1]
        ends = ends.reshape(blocks, self.count, 2 * e) + path[:, None, held:]
        state.z = value[:held].reshape(state.z.shape)
        state.x, state.p = value[None, held : held + e], value[None, held + e :]
        state.x_lost, state.p_lost = lost[None, held : held + e], lost[None, held + e :]
        state.unknowns, state.h = None, self.h
        ends = ends.reshape(1, -1, 2 * e)
        return ends[..., :e], ends[..., e:], inputs

    def _known(self, state: State, blocks: int, loads: Array | None) -> Array | None:
        """Load vectors of all blocks with those of a start velocity, ``(blocks, B (s + 1) e)``."""
        engine, count, damping = self.engine, self.count, self.engine.damping
        tables = self.frame.damping
        is_relative = damping is not None and any(one.is_relative for one in damping.directions)
        if loads is None and not is_relative:
            return None
        # a constant force of the past is the same in all blocks
        is_constant = loads is None and damping is not None and not damping.has_column
        rows = 1 if is_constant else blocks
        flat = np.zeros((rows, count, engine.tables.degree + 1, engine.e))
        if loads is not None:
            flat += loads[0].reshape(flat.shape)
        if damping is not None and tables is not None and is_relative:
            columns, state.column = damping.columns(tables, state.column, rows)
            nothing = np.zeros((rows, engine.n_states, engine.e))
            force = damping.past(tables, nothing, columns, count)
            flat -= on_steps(self.frame.to_loads, force.reshape(rows, count, -1, engine.e))
        return flat.reshape(rows, -1)
