r"""The damping of backward differences on equal steps, on the states of one step solver.

With the unknowns :math:`U_k` of a step (its increments over h) the sampled differences are
:math:`h (E^T U_k + C^T U_{k-1})`, so that the force at the sampling points is a sum over lags,

.. math:: F_k = \sum_{n=0}^{k} K_n U_{k-n} D, \qquad K_n = h\,(w_n E^T + w_{n-1} C^T),

with the weights w on differences. Near lags are remembered one by one, and behind them the weights
are exponentials (:mod:`fvi_cli.integrator.convolution.backward_differences`), each with one state
for every unknown of a step: :math:`S_j = \sum_{n \geq 1} e^{-n y_j} U_{k-n}`. Where every sum is
to be written out all lags are near.

A Caputo derivative of order above 1 acts on U less the start velocity. One more column is
driven by the constant velocity -1 and stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.backward_differences import (
    LagExponentials,
    lag_exponentials,
)
from fvi_cli.integrator.convolution.damping import (
    LONGEST_BLOCK,
    Damping,
    DampingTables,
    Direction,
    directions_of,
)
from fvi_cli.integrator.convolution.reach import Reach
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.bdf import difference_weights

MANY_STATES = 300
ORDER_ONE = 0.0
"""1 minus the order of a term of order 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LagStep:
    """What a step of backward differences is to the memory.

    States are the unknowns of the last L steps, in the order of time, and J sums over all of them,
    each for the s unknowns of a step: ``(L + J) s`` in all.

    Parameters
    ----------
    kernels
        :math:`K_n` for n = 0 .. L, shape ``(n_terms, L + 1, m, s)``.
    near
        The same less what the exponentials give; nothing at n = 0.
    rates
        y_j, shape ``(J,)``.
    far
        Factors of the sums in the force on the next step, shape ``(n_terms, J, m, s)``.
    """

    kernels: Array
    near: Array
    rates: Array
    far: Array

    @property
    def n_lags(self) -> int:
        """Number L of steps that are remembered one by one."""
        return int(self.kernels.shape[1]) - 1

    @property
    def n_states(self) -> int:
        """Number (L + J) s of states."""
        return (self.n_lags + self.rates.size) * int(self.kernels.shape[3])

    @cached_property
    def response(self) -> Array:
        """Force at the sampling points by unit states, shape ``(n_terms, m, (L + J) s)``."""
        return self.over(1).response

    def kernel_at(self, lags: NDArray[np.int64]) -> Array:
        """:math:`K_n` at any lags n >= 1, shape ``(n_terms, n, m, s)``."""
        found = np.zeros((self.kernels.shape[0], lags.size, *self.kernels.shape[2:]))
        inside = lags <= self.n_lags
        found[:, inside] = self.kernels[:, lags[inside]]
        if self.rates.size and not inside.all():
            decay = np.exp(-np.outer(lags[~inside], self.rates))
            found[:, ~inside] = np.einsum("nj,tjms->tnms", decay, self.far)
        return found

    def over(self, steps: int) -> LagBlock:
        """History over `steps` steps."""
        return LagBlock(steps=steps, step=self)


@dataclass(frozen=True, kw_only=True, eq=False)
class LagBlock:
    """The same for B steps that are taken at once.

    Parameters
    ----------
    steps
        Number B of steps.
    step
        One of them.
    """

    steps: int
    step: LagStep

    @cached_property
    def response(self) -> Array:
        """Force on the block by the states at its beginning, ``(n_terms, B m, (L + J) s)``."""
        step, count = self.step, self.steps
        n_terms, _, m, _ = step.kernels.shape
        lags = step.n_lags - np.arange(step.n_lags) + np.arange(count)[:, None]
        inside = np.minimum(lags, step.n_lags)
        near = step.near[:, inside] * (lags <= step.n_lags)[..., None, None]
        decay = np.exp(-np.outer(np.arange(count), step.rates))
        far = decay[None, :, :, None, None] * step.far[:, None]
        both = np.concatenate([near, far], axis=2)
        return np.ascontiguousarray(both.transpose(0, 1, 3, 2, 4)).reshape(n_terms, count * m, -1)

    @cached_property
    def lags(self) -> Array:
        """:math:`K_n` for n = 1 .. B - 1, shape ``(n_terms, B - 1, m, s)``."""
        return self.step.kernel_at(np.arange(1, self.steps))

    @cached_property
    def _decay(self) -> Array:
        """``exp(-n y)`` for n = B .. 1, shape ``(J, B)``."""
        return np.asarray(np.exp(-np.outer(self.step.rates, np.arange(self.steps, 0, -1))))

    def after(self, states: Array, driving: Array) -> Array:
        """States ``((L + J) s, columns)`` behind the block, driven by ``(B s, columns)``."""
        s = self.step.kernels.shape[3]
        last, own = self.step.n_lags * s, self.steps * s
        found = np.empty_like(states)
        kept = max(last - own, 0)
        found[:kept] = states[last - kept : last]
        found[kept:last] = driving[own - (last - kept) :]
        if self.step.rates.size:
            sums = states[last:].reshape(-1, s, states.shape[1])
            fresh = self._decay @ driving.reshape(self.steps, -1)
            after = self._decay[:, 0, None, None] * sums + fresh.reshape(sums.shape)
            found[last:] = after.reshape(-1, states.shape[1])
        return found

    @cached_property
    def intake(self) -> Array:
        """From what drives the block to the states behind it, shape ``((L + J) s, B s)``."""
        size = self.steps * self.step.kernels.shape[3]
        return self.after(np.zeros((self.response.shape[2], size)), np.eye(size))

    def change_of_all(self) -> Array:
        """The matrix that turns all states into their change over the block."""
        s = self.step.kernels.shape[3]
        last, n_states = self.step.n_lags * s, self.response.shape[2]
        nothing = np.zeros((self.steps * s, n_states))
        matrix = self.after(np.eye(n_states), nothing) - np.eye(n_states)
        sums = np.repeat(np.expm1(-self.steps * self.step.rates), s)
        matrix[last:, last:] = np.diag(sums)
        return matrix


def lag_tail(
    bdf_order: int, orders: tuple[float, ...], n_steps: int, *, writes_out: bool = False
) -> LagExponentials:
    """Exponentials behind the lags that are remembered one by one, for N steps and one more."""
    found = lag_exponentials(bdf_order, orders, n_steps + 1)
    if writes_out or not found.rates.size:
        near = bdf_order if orders == (1.0,) else n_steps
        found = LagExponentials(near=near, rates=np.zeros(0), factors=np.zeros((len(orders), 0)))
    return replace(found, near=min(found.near, n_steps))


def lag_step(
    bdf_order: int,
    tables: StepTables,
    orders: tuple[float, ...],
    tail: LagExponentials,
    step_size: float,
) -> LagStep:
    """Kernels of all orders for steps of length h.

    Parameters
    ----------
    bdf_order, tables
        The order p of the method, and its numbers.
    orders
        Orders of the derivatives, each once.
    tail
        What :func:`lag_tail` gives for them.
    step_size
        h.
    """
    p, h, n_lags = bdf_order, step_size, tail.near
    weights = np.zeros((len(orders), n_lags + 1))
    units = np.array([h ** (1.0 - order) for order in orders])
    for row, unit, order in zip(weights, units, orders, strict=True):
        row[:] = unit * difference_weights(p, order, n_lags + 1)
    sample = tables.sample_basis[1:].T
    carry = np.eye(tables.degree)[-1:] - sample
    kernels = weights[..., None, None] * sample
    kernels[:, 1:] += weights[:, :-1, None, None] * carry
    factors = units[:, None] * tail.factors
    far = factors[..., None, None] * (sample + np.exp(tail.rates)[:, None, None] * carry)
    near = kernels.copy()
    near[:, 0] = 0.0
    if tail.rates.size:
        decay = np.exp(-np.outer(np.arange(1, n_lags + 1), tail.rates))
        near[:, 1:] -= np.einsum("nj,tjms->tnms", decay, far)
    # what the sums of the next step give: the newest of them is one step behind
    return LagStep(kernels=kernels, near=near, rates=tail.rates, far=far)


class LagDamping(Damping):
    """Fractional damping by backward differences on N equal steps.

    Parameters
    ----------
    scene, method, tables
        What is integrated, and how.
    n_steps
        Number N of steps.
    writes_out
        Whether every sum over the past is written out.
    reach
        As for :class:`fvi_cli.integrator.convolution.damping.Damping`.
    """

    def __init__(
        self,
        scene: Scene,
        method: Method,
        tables: StepTables,
        n_steps: int,
        *,
        writes_out: bool = False,
        reach: Reach | None = None,
    ) -> None:
        self.start_velocity, self.dimension = scene.initial_velocity, scene.dimension
        self._method, self._tables = method, tables
        self._h = scene.final_time / n_steps
        self._stages = tables.sample_points.size
        # order 1 is one like the others
        groups = [_with_order_one(one) for one in directions_of(scene, reach)]
        self.has_column = any(one.is_relative for one in groups)
        self.reach = reach
        self.n_remembered = scene.dimension if reach is None else reach.count
        self._columns = self.n_remembered + (1 if self.has_column else 0)
        self.column_driving = -tables.control_points[1:]
        start = self.remembered(scene.initial_velocity)
        self.directions = tuple(
            replace(one, start_force=times(start, one.inner)) if one.is_relative else one
            for one in groups
        )
        exponents = sorted({e for one in groups for e in one.terms if isinstance(e, float)})
        self._index = {term: index for index, term in enumerate(exponents)}
        orders = tuple(1.0 - e for e in exponents)
        self._tail = lag_tail(method.bdf_order, orders, n_steps, writes_out=writes_out)
        self.kernel = None
        self._at: DampingTables | None = None
        self._first = np.zeros((tables.degree, self.n_remembered))
        if scene.derivative == "riemann-liouville" and method.sampling == "nodes":
            # plain convolution quadrature of q itself, as in the paper: a step from 0 to the start
            self._first[-1] = self.remembered(scene.initial_position) / self._h

    @cached_property
    def _step(self) -> LagStep:
        """Kernels of all orders; plans need none."""
        orders = tuple(1.0 - e for e in self._index if isinstance(e, float))
        return lag_step(self._method.bdf_order, self._tables, orders, self._tail, self._h)

    @property
    def operations_per_step(self) -> int:
        """Multiply-adds of the memory in a step."""
        sums = self._tail.rates.size * self._tables.degree
        return (len(self.directions) * self._stages * self.n_states + sums) * self._columns

    @property
    def longest_block(self) -> int:
        """Half as many where that many states and their tables would not stay in the cache."""
        return LONGEST_BLOCK if self.n_states <= MANY_STATES else LONGEST_BLOCK // 2

    def energy_weights(self) -> None:
        """None: the weights are no positive sum of squares."""
        return

    @property
    def n_states(self) -> int:
        """Number of states that stand for the past."""
        return (self.n_lags + self._tail.rates.size) * self._tables.degree

    @property
    def n_lags(self) -> int:
        """Number L of steps that are remembered one by one."""
        return self._tail.near if self.has_memory else 0

    @property
    def has_memory(self) -> bool:
        """Whether any term remembers the past."""
        return bool(self._index)

    def initial_states(self) -> Array:
        """The states at the start, shape ``((L + J) s, columns)``."""
        states = np.zeros((self.n_states, self._columns))
        if self._first.any():
            nothing = np.zeros((self._first.shape[0], self._columns - self.n_remembered))
            first = np.concatenate([self._first, nothing], axis=1)
            states = self._step.over(1).after(states, first)
        return states

    def force_of_jump(self) -> Array:
        """Force of the jump to the initial position that is left out, ``(n, m, d)``.

        That of the first point, as in the paper. A derivative of order 1 of a jump is zero behind
        it: its backward differences, which come to an end, are left out at all points.
        """
        if not self._first.any():
            return np.zeros((0, self._stages, self.dimension))
        kernels = self._step.kernel_at(np.arange(1, self._method.bdf_order + 2))
        total = np.zeros((*kernels.shape[1:3], self.n_remembered))
        for one in self.directions:
            for term, factor in zip(one.terms, one.factors, strict=True):
                if term == ORDER_ONE:
                    total += factor * times(kernels[self._index[term]] @ self._first, one.inner)
        force = self.spread(total)
        force[0, 0] = self.history_force(self.tables(self._h), self.initial_states())[0]
        return force

    def tables(self, step_size: float) -> DampingTables:
        """Numbers of a step; all are equal."""
        if self._at is not None:
            return self._at
        newest = self._step.kernels[:, 0]
        local = [self.combined(one, newest) for one in self.directions]
        constant = np.zeros((self._stages, self.dimension))
        for block, one in zip(local, self.directions, strict=True):
            if one.is_relative:
                moved = block @ self.column_driving
                constant += moved[:, None] * times(self.start_velocity, one.matrix)
        self._at = DampingTables(
            local=tuple(local),
            response=tuple(self.combined(one, self._step.response) for one in self.directions),
            decay=np.zeros(0),
            intake=np.zeros((0, self._tables.degree)),
            constant_force=constant,
            step=self._step,
        )
        return self._at

    def advance(self, tables: DampingTables, states: Array, driving: Array) -> None:
        """Take the states to the end of a step."""
        states[:] = self._block.after(states, driving)

    @cached_property
    def _block(self) -> LagBlock:
        return self._step.over(1)


def _with_order_one(one: Direction) -> Direction:
    if one.rate == 0.0:
        return one
    return replace(one, terms=(*one.terms, ORDER_ONE), factors=(*one.factors, one.rate), rate=0.0)
