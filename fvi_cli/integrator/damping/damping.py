r"""The damping force of q members on blocks of equal steps, from states that stand for the past.

A Caputo derivative of order above 1 acts on the velocity minus its start :math:`v_0`. A derivative
of a constant is zero: so with Runge-Kutta methods states that begin with :math:`v_0` need no
subtraction, up to a constant force. It stands for the rates that are too small to decay during the
run, and cancels the response to a constant velocity to the last digit. Where some terms subtract
:math:`v_0` and others do not, and with backward differences, the states begin with zero. Then all
members share one more column, the states of a start velocity of 1, from which the terms that
subtract get the part of :math:`v_0`.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.damping.directions import Direction, directions_of
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.memory.exponentials import ExponentialKernels, Exponentials
from fvi_cli.integrator.memory.interface import Combination, Kernels, along, toeplitz_matrix
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.memory.reach import DamperForms
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.mathematics.arrays import Array, Places


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingTables:
    """Tables of the damping for B equal steps."""

    kernels: Kernels  # tables of the memory
    # for every direction, from inputs to forces: lag sequences (q or 1, B, m, i)
    sequences: tuple[Array, ...]
    # for every relative direction the force that subtracting a start velocity of 1 adds in the
    # steps, (q or 1, B m); None for others
    offsets: tuple[Array | None, ...]

    @cached_property
    def local(self) -> tuple[Array, ...]:
        """For every direction, from inputs of the block to its forces, ``(q or 1, B m, B i)``."""
        return tuple(toeplitz_matrix(one) for one in self.sequences)

    def of(self, places: Places) -> DampingTables:
        """The tables of some members."""

        def own(table: Array) -> Array:
            return table if len(table) == 1 else table[places]

        return replace(
            self,
            sequences=tuple(own(one) for one in self.sequences),
            offsets=tuple(None if one is None else own(one) for one in self.offsets),
        )


class Damping:
    """The damping of the members of a batch.

    Start velocities are ``(q, e)``, along the reach where there is one.
    """

    def __init__(
        self,
        directions: Sequence[Direction],
        memory: Exponentials | Lags,
        velocity: Array,
    ) -> None:
        self.directions, self.memory = tuple(directions), memory
        self.start_velocity = velocity[:, None]  # (q, 1, e)
        self.combinations = tuple(
            Combination.made(memory, one.terms, one.factors, one.matrix) for one in self.directions
        )
        self.is_relative = relative = any(one.is_relative for one in self.directions)
        # also if the others have no memory: a batch mixes members of order 1 and of other orders
        plain = any(not one.is_relative for one in self.directions)
        self.has_column = relative and (plain or memory.column is not None)
        self._starts_relative = relative and not self.has_column

    @property
    def subtracts(self) -> bool:
        """Whether a start velocity that is not zero is subtracted."""
        return bool(self.start_velocity.any()) and any(one.is_relative for one in self.directions)

    @property
    def n_states(self) -> int:
        """Number J of states of each component."""
        return self.memory.n_states

    def tables(self, h: float, count: int) -> DampingTables:
        """Tables of `count` steps of length h."""
        kernels = self.memory.kernels(h, count)
        every = kernels.sequence
        sequences = tuple(one.combine(every) for one in self.combinations)
        offsets = tuple(
            self._offset(kernels, sequence, combination) if one.is_relative else None
            for sequence, combination, one in zip(
                sequences, self.combinations, self.directions, strict=True
            )
        )
        return DampingTables(kernels=kernels, sequences=sequences, offsets=offsets)

    def _offset(self, kernels: Kernels, sequence: Array, one: Combination) -> Array:
        count, column = kernels.count, self.memory.column
        if column is not None:
            return np.asarray(np.cumsum(sequence @ column, axis=1).reshape(len(sequence), -1))
        assert isinstance(kernels, ExponentialKernels)
        response = kernels.response[: kernels.n_samples]
        past = np.matmul(response, one.weights[:, :, None])[..., 0]
        return np.concatenate([-(np.add.reduce(sequence[:, 0], axis=2) + past)] * count, axis=1)

    @property
    def is_shared(self) -> bool:
        """Whether all members have the same tables: they differ in matrices only."""
        return all(len(one.weights) == len(one.factors) == 1 for one in self.combinations)

    @cached_property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory of a member in a step: for the force and the new states."""
        columns = self.start_velocity.shape[2] + (1 if self.has_column else 0)
        remembering = sum(
            any(self.memory.remembers(term) for row in one.terms for term in row)
            for one in self.directions
        )
        return int(columns * self.memory.operations_per_step(remembering))

    def start(self) -> tuple[Array, Array]:
        """States at t = 0 of the members, ``(q, J, e)``, and of a start velocity of 1."""
        q, _, e = self.start_velocity.shape
        column = np.zeros((1, self.n_states, 1))
        states = np.zeros((q, self.n_states, e))
        if self.has_column:
            column += self.memory.column_start
        elif self._starts_relative:
            states = states + self.start_velocity
        return states, column

    def past(
        self,
        tables: DampingTables,
        states: Array,
        column: Array,
        count: int,
        direction: int | None = None,
    ) -> Array:
        """Force of the past on the first `count` steps of a block, ``(q, count m, e)``.

        The sum over all directions, or one of them; many blocks have a leading axis.
        """
        chosen = slice(None) if direction is None else slice(direction, direction + 1)
        combinations = self.combinations[chosen]
        own = self._acted_on(states, column)[chosen]
        force = tables.kernels.past(own, combinations, count)
        for offset, one in zip(tables.offsets[chosen], combinations, strict=True):
            if offset is not None:
                start = along(self.start_velocity, one.matrix)
                force = force + offset[:, : force.shape[-2], None] * start
        return force

    def _acted_on(self, states: Array, column: Array) -> list[Array]:
        """For every direction the states on which it acts."""
        moved = states + column * self.start_velocity if self.has_column else states
        return [moved if one.is_relative else states for one in self.directions]

    def own(
        self, tables: DampingTables, inputs: Array, count: int, direction: int | None = None
    ) -> Array:
        """Force of the inputs of the first `count` steps on these steps, ``(q, count m, e)``.

        Inputs are ``(q, count i, e)``; directions and many blocks as in :meth:`past`.
        """
        size = count * tables.kernels.n_samples
        chosen = range(len(self.directions)) if direction is None else [direction]
        total = np.zeros((*inputs.shape[:-2], size, inputs.shape[-1]))
        for index in chosen:
            force = np.matmul(tables.local[index][:, :size, : inputs.shape[-2]], inputs)
            total += along(force, self.combinations[index].matrix)
        return total

    def energy(self, states: Array, column: Array) -> Array | None:
        r"""Energy that every direction stores, ``(n_directions, ..., q)``.

        .. math:: E = \tfrac12 \sum_j e_j\, s_j \cdot D s_j

        with the states ``(..., q, J, e)`` of a relative term less the start velocity. None for
        backward differences: their weights are no positive sum of squares.
        """
        memory = self.memory
        if not isinstance(memory, Exponentials):
            return None
        found = np.zeros((len(self.directions), *states.shape[:-2]))
        if memory.kernel is None:
            return found
        by_term = memory.kernel.energy_weights
        every = zip(self._acted_on(states, column), self.combinations, self.directions, strict=True)
        for index, (acted, one, direction) in enumerate(every):
            free = acted - self.start_velocity if direction.is_relative else acted
            squares = (free * along(free, one.matrix)).sum(axis=-1)
            found[index] = 0.5 * (one.combine(by_term) * squares).sum(axis=-1)
        return found

    def push_column(self, tables: DampingTables, column: Array, count: int) -> Array:
        """States of a start velocity of 1 after the first `count` steps, ``(1, J, 1)``."""
        if not self.has_column:
            return column
        inputs = np.zeros((1, count * tables.kernels.n_inputs, 1))
        if self.memory.column is not None:
            inputs[0, :, 0] = np.tile(self.memory.column, count)
        return tables.kernels.push(column, inputs, count)

    def columns(self, tables: DampingTables, column: Array, blocks: int) -> tuple[Array, Array]:
        """States of a start velocity of 1 before each block, ``(blocks, J, 1)``, and after all."""
        if not self.has_column:
            return np.broadcast_to(column, (blocks, *column.shape[1:])), column
        count = tables.kernels.count
        matrix = tables.kernels.change_of_all(count)
        driven = self.push_column(tables, np.zeros_like(column), count)[0]
        path, value = np.empty((blocks, *column.shape[1:])), column[0]
        for index in range(blocks):
            path[index] = value
            value = value + (matrix @ value + driven)
        return path, value[None]

    def at_rest(self) -> Damping:
        """The damping with a start velocity of zero."""
        part = copy.copy(self)
        part.start_velocity = np.zeros_like(self.start_velocity)
        return part

    def of(self, places: Places) -> Damping:
        """The damping of some members; for their tables see :meth:`DampingTables.of`."""
        part = copy.copy(self)
        part.start_velocity = self.start_velocity[places]
        part.combinations = tuple(one.of(places) for one in self.combinations)
        return part


def damping_of(
    scenes: Sequence[Scene],
    method: Method,
    *,
    shortest_step: float,
    steps: float | None = None,
    n_steps: int | None = None,
    modes: Sequence[Decoupling] | None = None,
    reach: DamperForms | None = None,
) -> Damping | None:
    """The damping of scenes of one kind; None if they have none.

    `shortest_step` and `steps` as for :func:`fvi_cli.integrator.memory.kernel.power_kernel`;
    `n_steps` for backward differences; `modes` and `reach` as for
    :func:`fvi_cli.integrator.damping.directions.directions_of`.

    Raises
    ------
    ValueError
        For backward differences without a number of steps.
    """
    directions = directions_of(scenes, modes, reach)
    if not directions:
        return None
    terms = tuple(dict.fromkeys(t for one in directions for row in one.terms for t in row))
    final_time = scenes[0].final_time
    memory: Exponentials | Lags
    if method.is_runge_kutta:
        memory = Exponentials(
            method, terms, shortest_step=shortest_step, final_time=final_time, steps=steps
        )
    elif n_steps is None:
        raise ValueError("n_steps: backward differences take a number of equal steps")
    else:
        memory = Lags(method, terms, n_steps=n_steps, final_time=final_time)
    return Damping(
        directions,
        memory,
        _members([one.initial_velocity for one in scenes], modes, reach),
    )


def law_objection(scene: Scene, method: AnyMethod) -> str:
    """Why the method cannot integrate the relaxation laws of a scene; empty if it can."""
    if not scene.active_laws:
        return ""
    if not isinstance(method, Baseline) and method.is_runge_kutta:
        return ""
    return (
        f"{method.label} cannot integrate relaxation laws (zener, maxwell, prony); take rk: gauss"
    )


def _members(
    values: Sequence[Array], modes: Sequence[Decoupling] | None, reach: DamperForms | None
) -> Array:
    """Values of scenes as values of members, ``(q, e)``."""
    if reach is not None:
        return np.array([reach.along(one) for one in values])
    if modes is None:
        return np.array(values)
    return np.concatenate([mode.positions(one) for mode, one in zip(modes, values, strict=True)])
