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
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.effects.damping import FractionalDamping, is_same_direction
from fvi_cli.effects.laws import Law
from fvi_cli.effects.matrices import LEAST_SPARSE, Form, as_csr, dense, form, touched
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import Direction, Kernels, along
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Term
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.mathematics.arrays import Array, Places

Pattern = tuple[tuple[tuple[int, ...], bool], ...]
"""Of each direction the places of its terms in the active forces of a scene, and if it is relative.

Relative terms subtract the start velocity: Caputo derivatives of order above 1.
"""


class Damping:
    """The damping of the members of a batch.

    Start velocities are ``(q, e)``. Of a large structure the memory stores the components that
    dampers act on, the `reach`: states, inputs and matrices are those of its r components.
    """

    def __init__(
        self,
        directions: Sequence[Direction],
        memory: Exponentials | Lags,
        velocity: Array,
        reach: Places | None = None,
    ) -> None:
        self.directions, self.memory = tuple(directions), memory
        self._reach, self._components = reach, velocity.shape[1]
        self.start_velocity = self.within(velocity)[:, None]  # (q, 1, e)
        relative = [one.is_relative for one in directions]
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

    def within(self, values: Array) -> Array:
        """Values ``(..., e)`` of the components that the memory stores, ``(..., r)``."""
        return values if self._reach is None else values[..., self._reach]

    def _on_all(self, forces: Array) -> Array:
        """Forces on the components that the memory stores as those on all components."""
        if self._reach is None:
            return forces
        whole = np.zeros((*forces.shape[:-1], self._components))
        whole[..., self._reach] = forces
        return whole

    def matrix_of(self, one: Direction) -> Form:
        """The matrix of a direction on all components, ``(e, e)``, of one large structure."""
        from scipy.sparse import coo_array, csr_array

        assert self._reach is not None
        if self._reach.size == self._components:
            return one.matrix
        given: Any = coo_array(cast(Any, one.matrix))
        places = self._reach[given.row], self._reach[given.col]
        shape = (self._components, self._components)
        return cast(Form, csr_array((given.data, places), shape=shape))

    def tables(self, h: float, count: int) -> Kernels:
        """Tables of `count` steps of length h."""
        return self.memory.kernels(h, count, self.directions)

    @property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory of a member in a step: for the force and the new states."""
        columns = self.start_velocity.shape[2] + (1 if self.has_column else 0)
        force, states = self.memory.operations_per_step
        return int(columns * (len(self.directions) * force + states))

    def start(self) -> tuple[Array, Array]:
        """States at t = 0, of the members ``(q, J, e)`` and of the column ``(1, J, 1)``."""
        q, _, e = self.start_velocity.shape
        states, column = np.zeros((q, self.n_states, e)), np.zeros((1, self.n_states, 1))
        if self._begins_moving:
            return states + self.start_velocity, column - 1.0
        return states, column

    def past(self, tables: Kernels, states: Array, column: Array, count: int) -> Array:
        """Force of the past on the first `count` steps of a block, ``(q, count m, e)``.

        Many blocks have a leading axis.
        """
        force = tables.past(self._acted_on(states, column), count)
        for index, one in enumerate(self.directions):
            if one.is_relative:
                offset = tables.offsets[index][:, : force.shape[-2], None]
                force = force + offset * along(self.start_velocity, one.matrix)
        return self._on_all(force)

    def present(self, tables: Kernels, inputs: Array, count: int) -> Array:
        """Force of the inputs ``(q, count i, r)`` of the first steps on these steps."""
        return self._on_all(tables.present(inputs, count))

    def _acted_on(self, states: Array, column: Array) -> list[Array]:
        """For every direction the states on which it acts."""
        moved = states + column * self.start_velocity if self.is_relative else states
        return [moved if one.is_relative else states for one in self.directions]

    def energy(self, states: Array, column: Array) -> Array | None:
        r"""Energy that every direction stores, ``(n_directions, ..., q)``.

        .. math:: E = \tfrac12 \sum_j e_j\, s_j \cdot D s_j

        with the states ``(..., q, J, e)`` of a relative term less the start velocity. None for
        backward differences: their weights are no positive sum of squares.
        """
        if not isinstance(self.memory, Exponentials):
            return None
        by_term, energies = self.memory.kernel.energy_weights, []
        for acted, one in zip(self._acted_on(states, column), self.directions, strict=True):
            squares = (acted * along(acted, one.matrix)).sum(axis=-1)
            energies.append(0.5 * (one.combine(by_term) * squares).sum(axis=-1))
        return np.array(energies)

    def push_column(self, tables: Kernels, column: Array, count: int) -> Array:
        """States of the column after the first `count` steps, ``(1, J, 1)``."""
        if not self.has_column:
            return column
        return tables.push(column, np.tile(tables.column, count)[None, :, None], count)

    def columns(self, tables: Kernels, column: Array, blocks: int) -> tuple[Array, Array]:
        """States of the column before each block, ``(blocks, J, 1)``, and after all."""
        path = [column]
        for _ in range(blocks):
            path.append(self.push_column(tables, path[-1], tables.count))
        return np.concatenate(path[:-1]), path[-1]

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
    in_reach: bool = False,
) -> Damping | None:
    """The damping of scenes of one pattern; None if they have none.

    `shortest_step` and `steps` as for :func:`fvi_cli.integrator.memory.kernel.power_kernel`;
    `n_steps` for backward differences. `modes` are the coordinates in which each scene is decoupled
    into systems, which are members. `in_reach`: the memory of one scene stores the components that
    its dampers act on.

    Raises
    ------
    ValueError
        For backward differences without a number of steps.
    """
    pattern, forces = pattern_of(scenes[0]), [one.active_forces for one in scenes]
    if not pattern:
        return None
    terms = tuple(dict.fromkeys(_term(one) for every in forces for one in every))
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
    reach = None
    if in_reach:
        reach = np.flatnonzero(np.any([touched(one.form) for one in forces[0]], axis=0))
    width = 1 if modes is None else scenes[0].dimension  # members of a scene
    place_of, directions = {term: place for place, term in enumerate(terms)}, []
    for places, is_relative in pattern:
        matrix: Form
        if reach is None:
            whole = [dense(_matrix(one[places[0]])) for one in forces]
            if modes is not None:
                pairs = zip(modes, whole, strict=True)
                whole = [m for mode, one in pairs for m in mode.matrices(one)]
            matrix = np.array(whole)
        else:
            matrix = _matrix(forces[0][places[0]])
            inner = cast(Form, as_csr(matrix)[reach][:, reach])
            is_dense = isinstance(matrix, np.ndarray) or reach.size < LEAST_SPARSE
            matrix = form(dense(inner) if is_dense else inner)
        numbers = [[place_of[_term(one[k])] for k in places] for one in forces]
        scales = np.array([[_scale(one[k]) for k in places] for one in forces])
        directions.append(
            Direction(
                places=_shared(numbers, width),
                factors=_shared(scales / scales[:, :1], width),
                matrix=matrix,
                is_relative=is_relative,
            )
        )
    velocity = np.array([one.initial_velocity for one in scenes])
    if modes is not None:
        velocity = np.concatenate([m.positions(v) for m, v in zip(modes, velocity, strict=True)])
    return Damping(directions, memory, velocity, reach)


def _shared(rows: ArrayLike, width: int) -> NDArray[Any]:
    """Rows of scenes as rows of members; one row if all are equal."""
    every = np.asarray(rows)
    return every[:1] if (every == every[0]).all() else np.repeat(every, width, axis=0)


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


def _matrix(force: FractionalDamping | Law) -> Form:
    return force.size * force.form if isinstance(force, Law) else force.form


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
