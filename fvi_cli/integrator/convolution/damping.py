r"""The damping force of a step on any mesh: a local block, and states that stand for the past.

With :math:`\theta = 1 - \gamma` the force of a damping term at the stages of step n is

.. math:: F_n = \mu h_n^{\theta} A^{\theta} U_n + \mu \sum_j r_j(h_n) z_{n,j},
          \qquad U = V - \sigma v_0,

where :math:`\sigma = 1` for Caputo derivatives of order above 1 and 0 otherwise. All terms share
the states z. A derivative of a constant is zero: so :math:`v_0` need not be subtracted from the
velocities if the states begin with :math:`v_0`, up to a constant force, which stands for the rates
that are too small to forget anything in the time of the run; it is what the response to a constant
velocity lacks, so that none is left to the last digit. Where some terms subtract and others do
not, the states begin with zero and have one more column, which begins with 1, is driven by
nothing, and carries :math:`v_0` for those that do.

A relaxation law is one more term: its local block is :math:`\hat k((h_n A)^{-1})`, its states are
the same with weights of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.laws.law import Law
from fvi_cli.effects.matrices import Form, form, scaled, times
from fvi_cli.effects.matrix_force import is_same_direction as same_direction
from fvi_cli.effects.matrix_force import scale_and_direction
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.kernel import Kernel, Term, power_kernel
from fvi_cli.integrator.convolution.reach import Reach
from fvi_cli.integrator.convolution.stages import StageOperator, StepHistory
from fvi_cli.mathematics.arrays import Array

LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
"""For orders so small that 1 minus the order is 1."""
LONGEST_BLOCK = 128
COLUMNS = 256
"""Components whose states are worked on together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    r"""Damping terms and laws that act along one matrix.

    Parameters
    ----------
    matrix
        D, shape ``(d, d)``, as it is best kept.
    inner
        The same on the components that are remembered, shape ``(r, r)``.
    terms, factors
        :math:`1 - \gamma`, or the kernel of a law, and the coefficient of everything with memory.
    rate
        Coefficient of the terms of order 1, which act on the velocity itself.
    is_relative
        Whether the start velocity is subtracted: Caputo derivatives of order above 1.
    start_force
        What the column of ones carries: the start velocity, remembered, times `inner`, ``(r,)``;
        None where it carries nothing.
    """

    matrix: Form
    inner: Form
    terms: tuple[Term, ...]
    factors: tuple[float, ...]
    rate: float
    is_relative: bool = False
    start_force: Array | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingTables:
    """Numbers of one step size.

    Parameters
    ----------
    local
        For every direction the local block, shape ``(m, inputs)``; inputs are the stages of a
        Runge-Kutta method.
    response
        For every direction the force of the states at the stages, shape ``(m, J)``.
    decay, intake
        What a step of a Runge-Kutta method makes of the states: ``decay * z + intake @ U``, shapes
        ``(J,)``, ``(J, m)``.
    constant_force
        Force that is the same on all stages of all steps but for its last digits, ``(m, d)``.
    step
        The same states and responses as the operator has them, for blocks; None without memory.
    """

    local: tuple[Array, ...]
    response: tuple[Array, ...]
    decay: Array
    intake: Array
    constant_force: Array
    step: StepHistory | None


def no_damping(stages: int, dimension: int) -> DampingTables:
    """Tables of a scene without damping."""
    return DampingTables(
        local=(),
        response=(),
        decay=np.zeros(0),
        intake=np.zeros((0, stages)),
        constant_force=np.zeros((stages, dimension)),
        step=None,
    )


class Damping:
    """What remembers in a scene, fractional damping and laws, on meshes of certain steps.

    Parameters
    ----------
    scene
        Its active damping terms and laws are taken.
    operator
        The Runge-Kutta method.
    shortest_step
        Least step size that the states are made for, in the unit of time.
    n_steps
        Number of steps of the mesh, or less where most are longer than the shortest; None: not
        known beforehand.
    accuracy
        Relative accuracy of the sum of exponentials.
    reach
        Linear forms of the velocity for which states are kept; None: for every component.
    """

    def __init__(
        self,
        scene: Scene,
        operator: StageOperator,
        *,
        shortest_step: float,
        n_steps: float | None = None,
        accuracy: float = 1e-14,
        reach: Reach | None = None,
    ) -> None:
        self._operator = operator
        self.start_velocity = scene.initial_velocity
        self._stages = operator.n_stages
        self.column_driving = np.zeros(self._stages)
        groups = directions_of(scene, reach)
        is_relative = any(one.is_relative for one in groups)
        self.has_column = is_relative and any(one.terms and not one.is_relative for one in groups)
        self.dimension = scene.dimension
        self.reach = reach
        self.n_remembered = scene.dimension if reach is None else reach.count
        self._columns = self.n_remembered + (1 if self.has_column else 0)
        start = self.remembered(scene.initial_velocity)
        self._first_state = np.zeros_like(start)
        if is_relative and not self.has_column:
            self._first_state = start
        if self.has_column:
            groups = [
                replace(one, start_force=times(start, one.inner)) if one.is_relative else one
                for one in groups
            ]
        self.directions = tuple(groups)
        kernels = [term for one in groups for term in one.terms if not isinstance(term, float)]
        exponents = sorted({e for one in groups for e in one.terms if isinstance(e, float)})
        every: list[Term] = [*exponents, *dict.fromkeys(kernels)]
        self._index = {term: index for index, term in enumerate(every)}
        self._powers = {e: operator.local_block(e) for e in exponents}
        self.kernel: Kernel | None = None
        if every:
            self.kernel = power_kernel(
                every,
                shortest_step=shortest_step,
                final_time=scene.final_time,
                stages=self._stages,
                steps=n_steps,
                accuracy=accuracy,
            )

    @property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory in a step: force on it, and what it adds to the states."""
        if self.kernel is None:
            return 0
        remembering = sum(1 for one in self.directions if one.terms)
        return (remembering + 1) * self._stages * self.kernel.n_states * self._columns

    @property
    def has_memory(self) -> bool:
        """Whether any term remembers the past."""
        return self.kernel is not None

    @property
    def n_points(self) -> int:
        """Number m of points of a step where the force acts."""
        return self._stages

    @property
    def longest_block(self) -> int:
        """Steps that are best taken at once, at most."""
        return LONGEST_BLOCK

    @property
    def n_states(self) -> int:
        """Number of states that stand for the past."""
        return 0 if self.kernel is None else self.kernel.n_states

    @property
    def n_lags(self) -> int:
        """Number of steps of the past that are remembered one by one, in states of their own."""
        return 0

    def initial_states(self) -> Array:
        """The states at the start, shape ``(J, columns)``."""
        states = np.zeros((self.n_states, self._columns))
        states[:, : self.n_remembered] = self._first_state
        if self.has_column:
            states[:, -1] = 1.0
        return states

    def tables(self, step_size: float) -> DampingTables:
        """Numbers of a step of size `step_size`."""
        m = self._stages
        blocks = {term: self._local_block(term, step_size) for term in self._index}
        step = None
        if self.kernel is not None:
            step = self._operator.step_tables(self.kernel, step_size)
        local = []
        for one in self.directions:
            total = one.rate * np.eye(m)
            for term, factor in zip(one.terms, one.factors, strict=True):
                total = total + factor * blocks[term]
            local.append(total)
        if step is None:
            return DampingTables(
                local=tuple(local),
                response=tuple(np.zeros((m, 0)) for _ in self.directions),
                decay=np.zeros(0),
                intake=np.zeros((0, m)),
                constant_force=np.zeros((m, self.dimension)),
                step=None,
            )
        response = [self.combined(one, step.response) for one in self.directions]
        constant = np.zeros((m, self.dimension))
        for block, own, one in zip(local, response, self.directions, strict=True):
            if one.is_relative:
                left = block.sum(axis=1) + own.sum(axis=1)
                constant -= left[:, None] * times(self.start_velocity, one.matrix)
        return DampingTables(
            local=tuple(local),
            response=tuple(response),
            decay=step.decay,
            intake=step.intake,
            constant_force=constant,
            step=step,
        )

    def _local_block(self, term: Term, step_size: float) -> Array:
        if isinstance(term, float):
            return np.asarray(step_size**term * self._powers[term])
        return self._operator.law_block(term, step_size)

    def combined(self, one: Direction, by_term: Array) -> Array:
        """Sum over the terms of a direction of what is given for every term, first axis."""
        total = np.zeros(by_term.shape[1:])
        for term, factor in zip(one.terms, one.factors, strict=True):
            total += factor * by_term[self._index[term]]
        return total

    def energy_weights(self) -> tuple[Array, ...] | None:
        """For every direction the weights of the stored energy, ``(J,)``; None: none is known."""
        if self.kernel is None:
            return tuple(np.zeros(0) for _ in self.directions)
        weights = self.kernel.energy_weights
        return tuple(self.combined(one, weights) for one in self.directions)

    def remembered(self, values: Array) -> Array:
        """What is remembered of velocities ``(..., d)``, shape ``(..., r)``."""
        return values if self.reach is None else self.reach.along(values)

    def input_of(self, velocity: Array) -> Array:
        """What drives the states for stage velocities ``(..., d)``, shape ``(..., columns)``."""
        remembered = self.remembered(velocity)
        if self.has_column:
            column = np.broadcast_to(self.column_driving[:, None], (*remembered.shape[:-1], 1))
            return np.concatenate([remembered, column], axis=-1)
        return remembered

    def force_of_states(self, one: Direction, carried: Array) -> Array:
        """Force of states that a response has combined, ``(..., columns)`` to ``(..., r)``."""
        force = times(carried[..., : self.n_remembered], one.inner)
        if one.start_force is not None:
            force = force + carried[..., -1:] * one.start_force
        return force

    def history_force(self, tables: DampingTables, states: Array) -> Array:
        """Force of the past at the stages, shape ``(m, d)``."""
        total = np.zeros((self._stages, self.n_remembered))
        for response, one in zip(tables.response, self.directions, strict=True):
            if one.terms:
                total += self.force_of_states(one, response @ states)
        return self.spread(total)

    def local_force(self, tables: DampingTables, velocity: Array) -> Array:
        """Force of the step's own velocities, shape ``(m, d)`` to the same."""
        remembered = self.remembered(velocity)
        total = np.zeros((self._stages, self.n_remembered))
        for local, one in zip(tables.local, self.directions, strict=True):
            total += times(local @ remembered, one.inner)
        return self.spread(total)

    def spread(self, force: Array) -> Array:
        """From what is remembered, last axis, to all components."""
        return force if self.reach is None else self.reach.spread(force)

    def advance(self, tables: DampingTables, states: Array, driving: Array) -> None:
        """Take the states to the end of a step."""
        # some columns at a time, which stay at hand for both
        for first in range(0, states.shape[1], COLUMNS):
            own = states[:, first : first + COLUMNS]
            own *= tables.decay[:, None]
            own += tables.intake @ driving[:, first : first + COLUMNS]


def directions_of(scene: Scene, reach: Reach | None = None) -> list[Direction]:
    """Damping terms and laws of a scene by direction; relative ones come last and stand apart."""
    caputo = scene.derivative == "caputo" and bool(np.any(scene.initial_velocity != 0))
    above = tuple(term for term in scene.active_damping if caputo and term.order > 1)
    below = tuple(term for term in scene.active_damping if term not in above)
    relative = [replace(one, is_relative=True) for one in _directions(above, reach)]
    return _directions((*below, *scene.active_laws), reach) + relative


def _directions(
    forces: tuple[FractionalDamping | Law, ...], reach: Reach | None
) -> list[Direction]:
    """One direction for all terms whose matrices are multiples of each other."""
    groups: list[Direction] = []
    for force in forces:
        scale, matrix = scale_and_direction(force)
        known = next((i for i, o in enumerate(groups) if same_direction(o.matrix, matrix)), None)
        if known is None:
            matrix = form(matrix)
            inner = matrix if reach is None else scaled(reach.inner(force), 1.0 / scale)
            groups.append(Direction(matrix=matrix, inner=inner, terms=(), factors=(), rate=0.0))
            known = -1
        one = groups[known]
        if isinstance(force, FractionalDamping) and force.order == 1:
            groups[known] = replace(one, rate=one.rate + scale)
            continue
        term: Term
        if isinstance(force, FractionalDamping):
            term = min(1.0 - force.order, LARGEST_EXPONENT)
        else:
            term, scale = force.kernel, force.size * scale
        groups[known] = replace(one, terms=(*one.terms, term), factors=(*one.factors, scale))
    return groups
