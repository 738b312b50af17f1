"""Many blocks of linear systems: a recurrence, and all their steps in one matrix product."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fvi_cli.integrator.engine.law import Linear
from fvi_cli.integrator.engine.state import State
from fvi_cli.integrator.engine.tables import on_steps
from fvi_cli.mathematics.arrays import Array

if TYPE_CHECKING:
    from fvi_cli.integrator.engine.engine import Engine

LARGEST_STATE = 300
LEAST_BLOCKS = 24
LARGE_STATE, STEPS_OF_LARGE = 200, 4
"""From so many numbers on, so many blocks for each of 4 pay for the tables."""
HALVINGS = 3
"""Levels of pairs of blocks, pairs of these, and so on."""


def pays_as_one(size: int, block: int, blocks: int, total: int) -> bool:
    """Whether so many blocks of a linear system are best one recurrence.

    With a state of `size` numbers, J e + 2 e, and `total` equal steps in their stretch.
    """
    return (
        size <= LARGEST_STATE
        and block >= LEAST_BLOCKS // 6
        and blocks >= LEAST_BLOCKS
        and (size <= LARGE_STATE or total // block >= size // STEPS_OF_LARGE)
    )


class Recurrence:
    """w = (z, x, p) of one linear system from block to block as one matrix, ``(n, n)``."""

    def __init__(self, engine: Engine, h: float, count: int) -> None:
        self.engine, self.h, self.count = engine, h, count
        self._op = engine.operator(h, count)
        self.frame = self._op.frame
        self._held = held = engine.n_states * engine.e
        (whole,), two = self._op.outputs, 2 * engine.e
        outputs = np.empty((len(whole), held + two))
        outputs[:, held:] = whole[:, :two]
        if held:
            outputs[:, :held] = whole[:, two:] @ self._past()
        self._ends, self._inputs, self._change = self._split(outputs)
        if self.frame.damping is not None:
            undriven = self.frame.damping.kernels.change_of_all(count)
            self._change[:held, :held] += np.kron(undriven, np.eye(engine.e))

    @staticmethod
    def pays(engine: Engine, block: int, blocks: int, total: int) -> bool:
        """Whether so many blocks, of `total` steps in their stretch, are quicker so."""
        is_one = isinstance(engine.law, Linear) and engine.q == 1 and not engine.is_batch
        return is_one and pays_as_one((engine.n_states + 2) * engine.e, block, blocks, total)

    def _past(self) -> Array:
        """States to the force of the past on a block, ``(B m e, J e)``."""
        engine, tables = self.engine, self.frame.damping
        if engine.damping is None or tables is None:
            raise ValueError("damping: the scene has no damping")
        units = np.eye(self._held).reshape(self._held, engine.n_states, engine.e)
        zero = np.zeros((1, engine.n_states, 1))
        force = engine.damping.at_rest().past(tables, units, zero, self.count)
        return force.reshape(self._held, -1).T

    def _split(self, outputs: Array) -> tuple[Array, Array, Array]:
        """Ends of steps, components first, inputs, and what is added to the state of a block.

        Of inputs, positions and momenta ``(B (i + 2) e, c)``: ends ``(c, 2 e B)`` and inputs
        ``(c, B i e)``, changes ``(J e + 2 e, c)``.
        """
        engine, e, columns = self.engine, self.engine.e, outputs.shape[1]
        n = len(outputs) - 2 * self.count * e
        ends = outputs[n:].reshape(2, self.count, e, columns)
        inputs = np.ascontiguousarray(outputs[:n].T)
        change = np.zeros((self._held + 2 * e, columns))
        if self.frame.damping is not None and self._held:
            zero = np.zeros((columns, engine.n_states, e))
            driven = inputs.reshape(columns, -1, e)
            behind = self.frame.damping.kernels.push(zero, driven, self.count)
            change[: self._held] = behind.reshape(columns, -1).T
        change[self._held :] = ends[:, -1].reshape(2 * e, columns)
        by_rows = ends.transpose(3, 0, 2, 1).reshape(columns, -1)
        return np.ascontiguousarray(by_rows), inputs, change

    @cached_property
    def _changes(self) -> list[Array]:
        """Changes of a state without loads over 1, 2, 4, ... blocks."""
        found = [self._change]
        for _ in range(HALVINGS):
            found.append(2 * found[-1] + found[-1] @ found[-1])
        return found

    @cached_property
    def _by_load(self) -> tuple[Array, Array, Array]:
        """Load vectors to ends, inputs and changes."""
        ends, inputs, change = self._split(self._op.outputs_of_loads[0])
        return ends, inputs, np.ascontiguousarray(change.T)

    def _path(
        self, value: Array, lost: Array, blocks: int, kicks: Array | None, halvings: int
    ) -> tuple[Array, Array, Array]:
        """States before blocks, and that behind them with what round-off took too much.

        One after the other for groups of ``2^halvings`` blocks, for those inside of them by halves.
        """
        changes = self._changes[: halvings + 1]
        levels = [kicks]
        for one in changes[:-1]:
            if kicks is not None:
                kicks = kicks[1::2] + kicks[::2] + kicks[::2] @ one.T
            levels.append(kicks)
        path = np.empty((blocks >> halvings, value.size))
        for index in range(len(path)):
            path[index] = value
            change = changes[-1] @ value
            if kicks is not None:
                change += kicks[index]
            change -= lost
            total = value + change
            lost = (total - value) - change
            value = total
        for one, kicks in zip(changes[-2::-1], levels[-2::-1], strict=True):
            halves = np.empty((len(path), 2, value.size))
            halves[:, 0], halves[:, 1] = path, path + path @ one.T
            if kicks is not None:
                halves[:, 1] += kicks[::2]
            path = halves.reshape(-1, value.size)
        return path, value, lost

    def run(
        self, state: State, blocks: int, loads: Array | None, *, with_inputs: bool = False
    ) -> tuple[Array, Array, Array | None]:
        """Take `blocks` blocks; the state moves on.

        To x and p after every step, ``(1, n, e)``, and the inputs of the memory
        ``(blocks, B i e)`` if they are wanted.
        """
        e, held = self.engine.e, self._held
        known = self._known(state, blocks, loads)
        value = np.concatenate([state.z.ravel(), state.x[0], state.p[0]])
        lost = np.concatenate([np.zeros(held), state.x_lost[0], state.p_lost[0]])
        kicks = None if known is None else known @ self._by_load[2]
        if kicks is not None and len(kicks) < blocks:
            kicks = np.repeat(kicks, blocks, axis=0)
        span = 1 << HALVINGS
        whole = blocks - blocks % span
        paths = []
        for first, last, halvings in ((0, whole, HALVINGS), (whole, blocks, 0)):
            own = None if kicks is None else kicks[first:last]
            path, value, lost = self._path(value, lost, last - first, own, halvings)
            paths.append(path)
        path = np.concatenate(paths) if blocks % span else paths[0]
        ends, inputs = path @ self._ends, path @ self._inputs if with_inputs else None
        if known is not None:
            ends += known @ self._by_load[0]
            if inputs is not None:
                inputs += known @ self._by_load[1]
        ends = ends.reshape(blocks, 2 * e, self.count)
        ends += path[:, held:, None]
        state.z = value[:held].reshape(state.z.shape)
        state.x, state.p = value[None, held : held + e], value[None, held + e :]
        state.x_lost, state.p_lost = lost[None, held : held + e], lost[None, held + e :]
        state.unknowns, state.h = None, self.h
        x, p = (one.swapaxes(1, 2).reshape(1, -1, e) for one in (ends[:, :e], ends[:, e:]))
        return x, p, inputs

    def _known(self, state: State, blocks: int, loads: Array | None) -> Array | None:
        """Load vectors of all blocks with those of a start velocity, ``(blocks, B (s + 1) e)``."""
        engine, count, damping = self.engine, self.count, self.engine.damping
        tables = self.frame.damping
        is_relative = damping is not None and damping.subtracts
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
            zero = np.zeros((rows, engine.n_states, engine.e))
            force = damping.past(tables, zero, columns, count)
            flat -= on_steps(self.frame.to_loads, force.reshape(rows, count, -1, engine.e))
        return flat.reshape(rows, -1)
