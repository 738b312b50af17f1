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
from fvi_cli.effects.matrices import Form, form, scaled, times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.kernel import Kernel, power_kernel
from fvi_cli.integrator.convolution.reach import Reach
from fvi_cli.integrator.convolution.stages import StageOperator, StepKernel
from fvi_cli.integrator.memory import same_direction, scale_and_direction

Array = NDArray[np.float64]

LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
"""For orders so small that 1 minus the order is 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Direction:
    r"""Damping terms that act along one matrix.

    Parameters
    ----------
    matrix
        D, shape ``(d, d)``, as it is best kept.
    inner
        The same on the components that are remembered, shape ``(r, r)``.
    exponents, factors
        :math:`1 - \gamma` and the coefficient of every term with memory.
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
    exponents: tuple[float, ...]
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
        terms = scene.active_damping
        velocity = scene.initial_velocity
        caputo = scene.derivative == "caputo" and bool(np.any(velocity != 0))
        above = [term for term in terms if caputo and term.order > 1]
        below = [term for term in terms if term not in above]
        self.has_column = bool(above) and any(term.order != 1 for term in below)
        self.dimension = scene.dimension
        self.reach = reach
        self.n_remembered = scene.dimension if reach is None else reach.count
        self._columns = self.n_remembered + (1 if self.has_column else 0)
        start = self.remembered(velocity)
        self._first_state = start if above and not self.has_column else np.zeros_like(start)
        groups = _directions(tuple(below), reach)
        for direction in _directions(tuple(above), reach):
            carried = times(start, direction.inner) if self.has_column else None
            groups.append(replace(direction, is_relative=True, start_force=carried))
        self.directions = tuple(groups)
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
        states[:, : self.n_remembered] = self._first_state
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

    def remembered(self, values: Array) -> Array:
        """What is remembered of velocities ``(..., d)``, shape ``(..., r)``."""
        return values if self.reach is None else self.reach.along(values)

    def input_of(self, velocity: Array) -> Array:
        """What drives the states for stage velocities ``(..., d)``, shape ``(..., columns)``."""
        remembered = self.remembered(velocity)
        if self.has_column:
            nothing = np.zeros((*remembered.shape[:-1], 1))
            return np.concatenate([remembered, nothing], axis=-1)
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
            if one.exponents:
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

    def advance(self, tables: DampingTables, states: Array, driving: Array) -> Array:
        """The states after a step."""
        return tables.decay[:, None] * states + tables.intake @ driving


def _directions(terms: tuple[FractionalDamping, ...], reach: Reach | None) -> list[Direction]:
    """One direction for all terms whose matrices are multiples of each other."""
    groups: list[Direction] = []
    for term in terms:
        scale, matrix = scale_and_direction(term)
        is_rate = term.order == 1
        known = next((i for i, o in enumerate(groups) if same_direction(o.matrix, matrix)), None)
        if known is None:
            matrix = form(matrix)
            inner = matrix if reach is None else scaled(reach.inner(term), 1.0 / scale)
            groups.append(Direction(matrix=matrix, inner=inner, exponents=(), factors=(), rate=0.0))
            known = -1
        one = groups[known]
        if is_rate:
            groups[known] = replace(one, rate=one.rate + scale)
        else:
            exponent = min(1.0 - term.order, LARGEST_EXPONENT)
            groups[known] = replace(
                one, exponents=(*one.exponents, exponent), factors=(*one.factors, scale)
            )
    return groups
