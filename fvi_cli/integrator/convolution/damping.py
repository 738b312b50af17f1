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
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.kernel import Kernel, power_kernel
from fvi_cli.integrator.convolution.stages import StageOperator, StepKernel
from fvi_cli.integrator.memory import terms_by_direction
from fvi_cli.integrator.steps.algebra import Form, form, times

Array = NDArray[np.float64]

LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
"""For orders so small that 1 minus the order is 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    r"""Damping terms that act along one matrix.

    Parameters
    ----------
    matrix
        D, shape ``(d, d)``, or ``(d + 1, d)`` where the last row carries the start velocity.
    exponents, factors
        :math:`1 - \gamma` and the coefficient of every term with memory.
    rate
        Coefficient of the terms of order 1, which act on the velocity itself.
    is_relative
        Whether the start velocity is subtracted: Caputo derivatives of order above 1.
    """

    matrix: Array
    exponents: tuple[float, ...]
    factors: tuple[float, ...]
    rate: float
    is_relative: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class DampingTables:
    """Numbers of one step size.

    Parameters
    ----------
    local
        For every direction the local block, shape ``(m, m)``.
    response
        For every direction the force of the states at the stages, shape ``(m, J)``.
    decay, intake
        What a step makes of the states: ``decay * z + intake @ U``, shapes ``(J,)``, ``(J, m)``.
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
    step: StepKernel | None


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
    """The fractional damping of a scene on meshes with steps from `shortest_step` on.

    Parameters
    ----------
    scene
        Its active damping terms are taken.
    operator
        The Runge-Kutta method.
    shortest_step
        Least step size that the states are made for, in the unit of time.
    n_steps
        Number of steps of the mesh, or less where most are longer than the shortest; None: not
        known beforehand.
    accuracy
        Relative accuracy of the sum of exponentials.
    support
        Components that are damped at all, where the states are to be kept for these only; None:
        for all.

    Attributes
    ----------
    forms
        Matrix of every direction, shape ``(d, d)``, sparse where that is worth while.
    matrices
        The same for the components that are remembered, with the row of the start velocity.
    """

    def __init__(
        self,
        scene: Scene,
        operator: StageOperator,
        *,
        shortest_step: float,
        n_steps: float | None = None,
        accuracy: float = 1e-14,
        support: NDArray[np.intp] | None = None,
    ) -> None:
        self._operator = operator
        self.start_velocity = scene.initial_velocity
        self._stages = operator.n_stages
        terms = scene.active_damping
        velocity = scene.initial_velocity
        caputo = scene.derivative == "caputo" and bool(np.any(velocity != 0))
        above = [term for term in terms if caputo and term.order > 1]
        below = [term for term in terms if term not in above]
        self.has_column = bool(above) and any(term.order != 1 for term in below)
        self._first_state = np.zeros_like(velocity)
        if above and not self.has_column:
            self._first_state = velocity
        groups = _directions(tuple(below))
        for direction in _directions(tuple(above)):
            one = replace(direction, is_relative=True)
            groups.append(_carrying(one, velocity) if self.has_column else one)
        if self.has_column:
            groups = [_widened(one, scene.dimension) for one in groups]
        self.directions = tuple(groups)
        self.dimension = scene.dimension
        self.forms = tuple(form(one.matrix[: scene.dimension]) for one in groups)
        self.support = support
        self._remembered = scene.dimension if support is None else support.size
        self._columns = self._remembered + (1 if self.has_column else 0)
        matrices = [one.matrix for one in groups]
        if support is not None:
            rows = np.append(support, scene.dimension) if self.has_column else support
            matrices = [one.matrix[np.ix_(rows, support)] for one in groups]
        self.matrices = tuple(
            form(one) if one.shape[0] == one.shape[1] else one for one in matrices
        )
        exponents = sorted({e for one in groups for e in one.exponents})
        self._index = {exponent: index for index, exponent in enumerate(exponents)}
        self._blocks = {e: operator.local_block(e) for e in exponents}
        self.kernel: Kernel | None = None
        if exponents:
            self.kernel = power_kernel(
                exponents,
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
        remembering = sum(1 for one in self.directions if one.exponents)
        return (remembering + 1) * self._stages * self.kernel.n_states * self._columns

    @property
    def has_memory(self) -> bool:
        """Whether any term remembers the past."""
        return self.kernel is not None

    def initial_states(self) -> Array:
        """The states at the start, shape ``(J, columns)``."""
        rates = 0 if self.kernel is None else self.kernel.n_states
        states = np.zeros((rates, self._columns))
        first = self._first_state
        states[:, : self._remembered] = first if self.support is None else first[self.support]
        if self.has_column:
            states[:, -1] = 1.0
        return states

    def tables(self, step_size: float) -> DampingTables:
        """Numbers of a step of size `step_size`."""
        m = self._stages
        blocks = {e: step_size**e * block for e, block in self._blocks.items()}
        step = None
        if self.kernel is not None:
            step = self._operator.step_tables(self.kernel, step_size)
        local = []
        for one in self.directions:
            total = one.rate * np.eye(m)
            for exponent, factor in zip(one.exponents, one.factors, strict=True):
                total = total + factor * blocks[exponent]
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
        for block, own, one, own_form in zip(
            local, response, self.directions, self.forms, strict=True
        ):
            if one.is_relative:
                left = block.sum(axis=1) + own.sum(axis=1)
                constant -= left[:, None] * times(self.start_velocity, own_form)
        return DampingTables(
            local=tuple(local),
            response=tuple(response),
            decay=step.decay,
            intake=step.intake,
            constant_force=constant,
            step=step,
        )

    def combined(self, one: Direction, by_exponent: Array) -> Array:
        """Sum over the terms of a direction of what is given for every exponent, first axis."""
        total = np.zeros(by_exponent.shape[1:])
        for exponent, factor in zip(one.exponents, one.factors, strict=True):
            total += factor * by_exponent[self._index[exponent]]
        return total

    def energy_weights(self) -> tuple[Array, ...]:
        """For every direction the weights of the stored energy, shape ``(J,)``."""
        if self.kernel is None:
            return tuple(np.zeros(0) for _ in self.directions)
        weights = self.kernel.energy_weights
        return tuple(self.combined(one, weights) for one in self.directions)

    def input_of(self, velocity: Array) -> Array:
        """What drives the states for stage velocities ``(m, d)``, shape ``(m, columns)``."""
        remembered = velocity if self.support is None else velocity[:, self.support]
        if self.has_column:
            return np.concatenate([remembered, np.zeros((velocity.shape[0], 1))], axis=1)
        return remembered

    def history_force(self, tables: DampingTables, states: Array) -> Array:
        """Force of the past at the stages, shape ``(m, d)``."""
        total = np.zeros((self._stages, self._remembered))
        for response, matrix in zip(tables.response, self.matrices, strict=True):
            total += _along(response @ states, matrix)
        return self.spread(total)

    def local_force(self, tables: DampingTables, velocity: Array) -> Array:
        """Force of the step's own velocities, shape ``(m, d)`` to the same."""
        remembered = velocity if self.support is None else velocity[:, self.support]
        total = np.zeros((self._stages, self._remembered))
        for local, matrix in zip(tables.local, self.matrices, strict=True):
            own = matrix
            if isinstance(matrix, np.ndarray):
                own = matrix[: self._remembered]
            total += _along(local @ remembered, own)
        return self.spread(total)

    def spread(self, force: Array) -> Array:
        """From the remembered components, last axis, to all."""
        if self.support is None:
            return force
        total = np.zeros((*force.shape[:-1], self.dimension))
        total[..., self.support] = force
        return total

    def advance(self, tables: DampingTables, states: Array, driving: Array) -> Array:
        """The states after a step."""
        return tables.decay[:, None] * states + tables.intake @ driving


def _along(values: Array, matrix: Form) -> Array:
    """Rows of values times a matrix, which is square where it is sparse."""
    return np.asarray(values @ matrix) if isinstance(matrix, np.ndarray) else times(values, matrix)


def _directions(terms: tuple[FractionalDamping, ...]) -> list[Direction]:
    groups = []
    for matrix, members in terms_by_direction(terms):
        fractional = [
            (min(1.0 - order, LARGEST_EXPONENT), scale) for scale, order in members if order != 1
        ]
        groups.append(
            Direction(
                matrix=matrix,
                exponents=tuple(e for e, _ in fractional),
                factors=tuple(scale for _, scale in fractional),
                rate=sum(scale for scale, order in members if order == 1),
            )
        )
    return groups


def _widened(one: Direction, dimension: int) -> Direction:
    """The same with a row for the column of ones."""
    if one.matrix.shape[0] > dimension:
        return one
    matrix = np.concatenate([one.matrix, np.zeros((1, dimension))])
    return replace(one, matrix=matrix)


def _carrying(one: Direction, velocity: Array) -> Direction:
    matrix = np.concatenate([one.matrix, (velocity @ one.matrix)[None]])
    return replace(one, matrix=matrix)
