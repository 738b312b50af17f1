r"""The damping force of backward differences as a convolution of increments.

With the samples :math:`U_k` of a step, shape ``(m, d)``,

.. math:: F_k = \sum_D \Big(\sum_{n=0}^{k} w^{(D)}_n U_{k-n}\Big) D

over the distinct directions D of the coefficient matrices. Here
:math:`U_{i,k} = X_{i,k} - X_{i,k-1}` are differences of the sampled positions, and
:math:`\sum w_n z^n = \sum_j \mu_j h^{-\gamma_j} \gamma_p(z)^{\gamma_j} / (1 - z)` are numbers. So a
large :math:`h^{-\gamma}` never meets a rounded position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.convolution.backward_differences import (
    LagExponentials,
    lag_exponentials,
)
from fvi_cli.integrator.convolution.directions import terms_by_direction
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.bdf import difference_weights

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One direction of the coefficient matrices with its weights.

    Parameters
    ----------
    direction
        Matrix D, shape ``(d, d)``.
    weights
        w_0 .. w_{M-1}, shape ``(M,)``, the same for every sample of a step; what lies beyond is
        zero.
    tail
        The same weights from a lag on as exponentials, with one row of factors.
    """

    direction: Array
    weights: Array
    tail: LagExponentials

    @property
    def memory(self) -> int:
        """Number M of weights that are not zero by construction."""
        return int(self.weights.shape[0])

    def newest(self, values: Array) -> Array:
        """w_0 times the samples of one step, shape ``(m, ...)`` to the same."""
        return np.asarray(self.weights[0] * values)


ChannelSource = Callable[[tuple[FractionalDamping, ...]], tuple[Channel, ...]]
"""From damping terms to their channels."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    r"""Weights of every direction and how samples follow from the increments of a step.

    .. math:: U_k = E^T \delta_k + C^T \delta_{k-1} + \text{offset}_k

    Parameters
    ----------
    channels
        One per distinct direction; none without damping.
    sample_matrix
        E, shape ``(s, m)``.
    carry_matrix
        C, shape ``(s, m)``.
    first_offset, offset
        Offset of the first and of every later step, shape ``(m, d)``.
    force_weights
        Weights of the force samples in the row of each basis function,
        :math:`\beta_i l_\nu(\chi_i)` where they are values at points, shape ``(s + 1, m)``.
    known_force
        Force that is known in advance, because a velocity is subtracted for some orders only,
        shape ``(n_steps + 1, m, d)``; None when there is none.
    """

    channels: tuple[Channel, ...]
    sample_matrix: Array
    carry_matrix: Array
    first_offset: Array
    offset: Array
    force_weights: Array
    known_force: Array | None = None

    @property
    def momentum_weights(self) -> Array:
        """Weights of the force samples in the momentum increment, shape ``(m,)``."""
        return np.asarray(self.force_weights.sum(axis=0))


def build_memory(
    scene: Scene,
    method: Method,
    tables: StepTables,
    n_steps: int,
    damping: tuple[FractionalDamping, ...],
    *,
    source: ChannelSource | None = None,
) -> Memory:
    """Weights and sample matrices for `n_steps` steps.

    Parameters
    ----------
    scene, method, tables
        What is integrated and how.
    n_steps
        Number N of steps; one weight more is made, for the force at the end of the last step.
    damping
        The terms that act.
    source
        Where the channels of terms come from; None: their weights are made.
    """
    h = scene.final_time / n_steps
    samples = tables.sample_points.size
    zero = np.zeros((samples, scene.dimension))
    velocity, position = scene.initial_velocity, scene.initial_position
    caputo = scene.derivative == "caputo"
    above_one = [term.order > 1 for term in damping]
    known = None
    subtract = zero[0]
    if source is None:
        source = partial(build_channels, method, h, n_steps + 1)
    channels = source(damping)
    if caputo and np.any(velocity != 0) and any(above_one):
        if all(above_one):
            subtract = velocity
        else:
            above = tuple(term for term in damping if term.order > 1)
            known = -_force_of_constant_velocity(
                source(above),
                tables,
                h,
                n_steps + 1,
                velocity,
            )
    sample = tables.sample_basis[1:]
    first = zero - h * np.outer(tables.sample_points, subtract)
    if not caputo and method.sampling == "nodes":
        # plain convolution quadrature of q itself, as in the paper; elsewhere the force of the
        # jump at 0 is known exactly and belongs to the forcing
        first = first + position
    return Memory(
        channels=channels,
        sample_matrix=sample,
        carry_matrix=np.eye(tables.degree)[:, -1:] - sample,
        first_offset=first,
        offset=zero - h * subtract,
        force_weights=tables.sample_test_weights,
        known_force=known,
    )


def build_channels(
    method: Method, h: float, n_weights: int, damping: tuple[FractionalDamping, ...]
) -> tuple[Channel, ...]:
    """Add up the terms whose matrices have the same direction."""
    groups = terms_by_direction(damping)
    orders = tuple(dict.fromkeys(order for _, terms in groups for _, order in terms))
    if not orders:
        return ()
    single = _by_order(method, h, n_weights, orders)
    channels = []
    for direction, terms in groups:
        weights = np.zeros(max(single[order].memory for _, order in terms))
        tail = single[orders[0]].tail
        factors = np.zeros((1, tail.rates.size))
        for scale, order in terms:
            weights[: single[order].memory] += scale * single[order].weights
            factors += scale * single[order].tail.factors
        channels.append(
            Channel(
                direction=dense(direction), weights=weights, tail=replace(tail, factors=factors)
            )
        )
    return tuple(channels)


def shared_channels(
    method: Method, h: float, n_weights: int, orders: tuple[float, ...]
) -> ChannelSource:
    """Channels by the order of the terms, so that scenes of the same orders share all weights.

    The direction of a channel is the sum of the coefficients of its order. Channels stand in
    ascending order, however the terms of a scene do: a batch pairs them by their place.
    """
    single = _by_order(method, h, n_weights, orders)

    def channels(damping: tuple[FractionalDamping, ...]) -> tuple[Channel, ...]:
        directions: dict[float, Array] = {}
        for term in damping:
            before = directions.get(term.order)
            own = term.coefficient
            directions[term.order] = own if before is None else before + own
        return tuple(replace(single[o], direction=d) for o, d in sorted(directions.items()))

    return channels


def _by_order(
    method: Method, h: float, n_weights: int, orders: tuple[float, ...]
) -> dict[float, Channel]:
    """A channel of one component for every order; all have the same exponentials."""
    tail = lag_exponentials(method.bdf_order, orders, n_weights)
    found = {}
    for order, factors in zip(orders, tail.factors, strict=True):
        unit = h ** (-order)
        weights = difference_weights(
            method.bdf_order, order, memory_length(method, order, n_weights)
        )
        found[order] = Channel(
            direction=np.eye(1),
            weights=np.asarray(unit * weights),
            tail=replace(tail, factors=unit * factors[None]),
        )
    return found


def memory_length(method: Method, order: float, n_weights: int) -> int:
    """How many of the first `n_weights` weights are not zero by construction."""
    if order != 1.0:
        return n_weights
    return 1 if method.is_runge_kutta else min(n_weights, method.bdf_order)


def memories_of(
    method: Method, n_weights: int, damping: tuple[FractionalDamping, ...]
) -> tuple[int, ...]:
    """How many weights `build_channels` makes for each direction of `damping`."""
    return tuple(
        max(memory_length(method, order, n_weights) for _, order in terms)
        for _, terms in terms_by_direction(damping)
    )


def shared_memories(
    method: Method, n_weights: int, damping: tuple[FractionalDamping, ...]
) -> tuple[int, ...]:
    """How many `shared_channels` makes for each order."""
    orders = sorted({term.order for term in damping})
    return tuple(memory_length(method, order, n_weights) for order in orders)


def _force_of_constant_velocity(
    channels: tuple[Channel, ...],
    tables: StepTables,
    h: float,
    n_steps: int,
    velocity: Array,
) -> Array:
    """Damping force of the motion v0 t, shape ``(n_steps, m, d)``."""
    samples = tables.sample_points.size
    force = np.zeros((n_steps, samples, velocity.size))
    for channel in channels:
        count = min(n_steps, channel.memory)
        weights = np.zeros(n_steps)
        weights[:count] = channel.weights[:count]
        total = np.cumsum(weights, axis=0)
        # the first difference is chi h v0, every later one h v0
        response = h * ((total - weights)[:, None] + np.outer(weights, tables.sample_points))
        force += response[:, :, None] * (velocity @ channel.direction)
    return force
