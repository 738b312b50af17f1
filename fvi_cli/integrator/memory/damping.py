r"""The damping force of q members on blocks of equal steps, from states that stand for the past.

A Caputo derivative of order above 1 acts on the velocity minus its start :math:`v_0`. So all
members share one more *column*, the states of a constant velocity of -1: terms that subtract act on
the states plus the column times :math:`v_0`. With Runge-Kutta methods whose terms all subtract the
states begin with :math:`v_0` itself, as after a long motion at this velocity: then the column is
always -1, and cancels the response to a constant velocity to the last digit.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.effects.damping import FractionalDamping, is_same_direction
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Form, dense, form, is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import (
    Combination,
    Kernels,
    along,
    toeplitz_matrix,
)
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Term
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.memory.reach import DamperForms
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.mathematics.arrays import Array

Pattern = tuple[tuple[tuple[int, ...], bool], ...]
"""Of each direction the places of its terms in the active forces of a scene, and if it is relative.

Relative terms subtract the start velocity: Caputo derivatives of order above 1.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingTables:
    """Tables of the damping for B equal steps."""

    kernels: Kernels  # tables of the memory
    # for every direction, from inputs to forces: lag sequences (q or 1, B, m, i)
    sequences: tuple[Array, ...]
    # for every direction the force that a velocity of -1 in these steps causes in them,
    # (q or 1, B m); None where no start velocity is subtracted
    offsets: tuple[Array | None, ...]

    @cached_property
    def local(self) -> tuple[Array, ...]:
        """For every direction, from inputs of the block to its forces, ``(q or 1, B m, B i)``."""
        return tuple(toeplitz_matrix(one) for one in self.sequences)


class Damping:
    """The damping of the members of a batch.

    Start velocities are ``(q, e)``, along the reach where there is one.
    """

    def __init__(
        self, combinations: Sequence[Combination], memory: Exponentials | Lags, velocity: Array
    ) -> None:
        self.combinations, self.memory = tuple(combinations), memory
        self.start_velocity = velocity[:, None]  # (q, 1, e)
        relative = [one.is_relative for one in combinations]
        self.is_relative = any(relative)
        # also if the others have no memory: a batch mixes members of order 1 and of other orders
        self._begins_moving = all(relative) and isinstance(memory, Exponentials)
        self.has_column = self.is_relative and not self._begins_moving

    @property
    def subtracts(self) -> bool:
        """Whether a start velocity that is not zero is subtracted."""
        return self.is_relative and bool(self.start_velocity.any())

    @property
    def n_states(self) -> int:
        """Number J of states of each component."""
        return self.memory.n_states

    def tables(self, h: float, count: int) -> DampingTables:
        """Tables of `count` steps of length h."""
        kernels = self.memory.kernels(h, count)
        lags_of_terms, column = kernels.sequence, self.memory.column
        sequences = tuple(one.combine(lags_of_terms) for one in self.combinations)
        offsets = tuple(
            np.cumsum(lags @ column, axis=1).reshape(len(lags), -1) if one.is_relative else None
            for lags, one in zip(sequences, self.combinations, strict=True)
        )
        return DampingTables(kernels=kernels, sequences=sequences, offsets=offsets)

    @cached_property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory of a member in a step: for the force and the new states."""
        columns = self.start_velocity.shape[2] + (1 if self.has_column else 0)
        directions = sum(self.memory.remembers(one.places) for one in self.combinations)
        return int(columns * self.memory.operations_per_step(directions))

    def start(self) -> tuple[Array, Array]:
        """States at t = 0, of the members ``(q, J, e)`` and of the column ``(1, J, 1)``."""
        q, _, e = self.start_velocity.shape
        states, column = np.zeros((q, self.n_states, e)), np.zeros((1, self.n_states, 1))
        if self._begins_moving:
            return states + self.start_velocity, column - 1.0
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
        acted = self._acted_on(states, column)[chosen]
        force = tables.kernels.past(acted, combinations, count)
        for offset, one in zip(tables.offsets[chosen], combinations, strict=True):
            if offset is not None:
                start = along(self.start_velocity, one.matrix)
                force = force + offset[:, : force.shape[-2], None] * start
        return force

    def _acted_on(self, states: Array, column: Array) -> list[Array]:
        """For every direction the states on which it acts."""
        moved = states + column * self.start_velocity if self.is_relative else states
        return [moved if one.is_relative else states for one in self.combinations]

    def present(
        self, tables: DampingTables, inputs: Array, count: int, direction: int | None = None
    ) -> Array:
        """Force of the inputs of the first `count` steps on these steps, ``(q, count m, e)``.

        Inputs are ``(q, count i, e)``; directions and many blocks as in :meth:`past`.
        """
        size = count * tables.kernels.n_samples
        chosen = range(len(self.combinations)) if direction is None else [direction]
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
        if not isinstance(self.memory, Exponentials):
            return None
        by_term, energies = self.memory.energy_weights, []
        for acted, one in zip(self._acted_on(states, column), self.combinations, strict=True):
            squares = (acted * along(acted, one.matrix)).sum(axis=-1)
            energies.append(0.5 * (one.combine(by_term) * squares).sum(axis=-1))
        return np.array(energies)

    def push_column(self, tables: DampingTables, column: Array, count: int) -> Array:
        """States of the column after the first `count` steps, ``(1, J, 1)``."""
        if not self.has_column:
            return column
        return tables.kernels.push(column, np.tile(self.memory.column, count)[None, :, None], count)

    def columns(self, tables: DampingTables, column: Array, blocks: int) -> tuple[Array, Array]:
        """States of the column before each block, ``(blocks, J, 1)``, and after all."""
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
        damping = copy.copy(self)
        damping.start_velocity = np.zeros_like(self.start_velocity)
        return damping


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
    """The damping of scenes of one pattern; None if they have none.

    `shortest_step` and `steps` as for :func:`fvi_cli.integrator.memory.kernel.power_kernel`;
    `n_steps` for backward differences. `modes` are the coordinates in which each scene is decoupled
    into systems, which are members; `reach` has the forms on which the dampers of one scene act;
    None: all components.

    Raises
    ------
    ValueError
        For backward differences without a number of steps.
    """
    pattern, forces = pattern_of(scenes[0]), [one.active_forces for one in scenes]
    if not pattern:
        return None
    # for every direction and scene its terms
    rows = [[tuple(_term(one[k]) for k in places) for one in forces] for places, _ in pattern]
    terms = tuple(dict.fromkeys(term for row in rows for one in row for term in one))
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
    combinations = []
    for terms_of_scenes, (places, is_relative) in zip(rows, pattern, strict=True):
        matrices = [_matrix(one[places[0]], reach) for one in forces]
        matrix = matrices[0]
        if reach is None and not is_sparse(forces[0][places[0]].form):
            whole = [dense(one) for one in matrices]
            if modes is not None:
                whole = [
                    m for mode, one in zip(modes, whole, strict=True) for m in mode.matrices(one)
                ]
            matrix = np.array(whole)
        scales = np.array([[_scale(one[k]) for k in places] for one in forces])
        width = 1 if modes is None else modes[0].batch  # members of a scene
        combinations.append(
            Combination.of_terms(
                memory,
                [row for row in terms_of_scenes for _ in range(width)],
                np.repeat(scales / scales[:, :1], width, axis=0),
                matrix,
                is_relative=is_relative,
            )
        )
    velocity = np.array([one.initial_velocity for one in scenes])
    if reach is not None:
        velocity = reach.along(velocity)
    elif modes is not None:
        velocity = np.concatenate([m.positions(v) for m, v in zip(modes, velocity, strict=True)])
    return Damping(combinations, memory, velocity)


def pattern_of(scene: Scene) -> Pattern:
    """Which terms of a scene share a direction: scenes of one pattern are integrated together.

    Terms whose matrices are multiples of each other share their sums.
    """
    is_moving = bool(np.any(scene.initial_velocity != 0))
    directions: list[tuple[bool, Form, list[int]]] = []
    for place, force in enumerate(scene.active_forces):
        is_relative = is_moving and isinstance(force, FractionalDamping) and force.order > 1
        _, direction = force.scale_and_direction
        for other, matrix, places in directions:
            if other == is_relative and is_same_direction(matrix, direction):
                places.append(place)
                break
        else:
            directions.append((is_relative, direction, [place]))
    return tuple((tuple(places), is_relative) for is_relative, _, places in directions)


def _matrix(force: FractionalDamping | Law, reach: DamperForms | None) -> Form:
    matrix = force.form if reach is None else reach.inner(force)
    return form(force.size * matrix if isinstance(force, Law) else matrix)


def _scale(force: FractionalDamping | Law) -> float:
    scale, _ = force.scale_and_direction
    return scale * force.size if isinstance(force, Law) else scale


def _term(force: FractionalDamping | Law) -> Term:
    if isinstance(force, Law):
        return force.kernel
    return min(1.0 - force.order, LARGEST_EXPONENT)


def law_objection(scene: Scene, method: AnyMethod) -> str:
    """Why the method cannot integrate the relaxation laws of a scene; empty if it can."""
    if not scene.active_laws or (not isinstance(method, Baseline) and method.is_runge_kutta):
        return ""
    return (
        f"{method.label} cannot integrate relaxation laws (zener, maxwell, prony); take rk: gauss"
    )
