r"""The damping force as a convolution of increments.

Both families are written in one form. With the samples :math:`U_k` of a step, shape ``(m, d)``,

.. math:: F_k = \sum_D \Big(\sum_{n=0}^{k} w^{(D)}_n U_{k-n}\Big) D

over the distinct directions D of the coefficient matrices.

- BDF: :math:`U_{i,k} = X_{i,k} - X_{i,k-1}` are differences of the sampled positions, and
  :math:`\sum w_n z^n = \sum_j \mu_j h^{-\gamma_j} \gamma_p(z)^{\gamma_j} / (1 - z)` are scalars.
- Runge-Kutta: :math:`U_{i,k}` are the Legendre coefficients of the velocity at the stages, and
  :math:`\sum w_n z^n = \sum_j \mu_j h^{1-\gamma_j} \Delta(z)^{\gamma_j - 1}` are m x m matrices
  (stage order m makes :math:`(\Delta/h) (X - x_0)` the derivative of the polynomial, so nothing is
  approximated by this).

So a large :math:`h^{-\gamma}` never meets a rounded position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.matrices import Form, as_csr, dense, entries, is_sparse, scaled
from fvi_cli.effects.matrix_force import MatrixForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stage_basis import (
    legendre_exponentials,
    legendre_stages,
    legendre_weights,
)
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.bdf import difference_weights

if TYPE_CHECKING:
    from fvi_cli.mathematics.runge_kutta import ButcherTableau

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One direction of the coefficient matrices with its weights.

    Parameters
    ----------
    direction
        Matrix D, shape ``(d, d)``.
    weights
        w_0 .. w_{M-1}: scalars, shape ``(M,)``, the same for every sample of a step (BDF), or
        matrices, shape ``(M, m, m)`` (Runge-Kutta); what lies beyond is zero.
    has_parity
        Whether :math:`w_n[j, i] = (-1)^{i + j} w_n[i, j]` (Gauss, in Legendre coefficients).
    """

    direction: Array
    weights: Array
    has_parity: bool = False

    @property
    def memory(self) -> int:
        """Number M of weights that are not zero by construction."""
        return int(self.weights.shape[0])

    @property
    def is_scalar(self) -> bool:
        """Whether every sample of a step is convolved on its own."""
        return self.weights.ndim == 1

    def newest(self, values: Array) -> Array:
        """w_0 applied to the samples of one step, shape ``(m, ...)`` to the same."""
        newest = self.weights[0]
        return np.asarray(newest * values if self.is_scalar else newest @ values)


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
    from_rest: bool = False,
    n_weights: int | None = None,
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
    from_rest
        The unknown starts with zero position and velocity (a start series carries them).
    n_weights
        Make no more than the first so many weights of a Runge-Kutta method and no known force;
        what remains is for the caller to sum in another way.
    source
        Where the channels of terms come from; None: their weights are made.
    """
    h = scene.final_time / n_steps
    samples = tables.sample_points.size
    zero = np.zeros((samples, scene.dimension))
    velocity = np.zeros(scene.dimension) if from_rest else scene.initial_velocity
    position = np.zeros(scene.dimension) if from_rest else scene.initial_position
    caputo = scene.derivative == "caputo"
    above_one = [term.order > 1 for term in damping]
    known = None
    subtract = zero[0]
    if source is None:
        source = partial(build_channels, method, h, n_steps + 1)
    if n_weights is None:
        channels = source(damping)
    else:
        channels = build_channels(method, h, n_weights, damping, n_steps)
    if caputo and np.any(velocity != 0) and any(above_one):
        if all(above_one):
            subtract = velocity
        elif n_weights is None:
            above = tuple(term for term in damping if term.order > 1)
            known = -_force_of_constant_velocity(
                source(above),
                tables,
                method,
                h,
                n_steps + 1,
                velocity,
            )
    if method.is_runge_kutta:
        basis = legendre_stages(tables.sample_points)
        # a constant has no Legendre coefficients but the first
        constant = zero.copy()
        constant[0] -= subtract
        return Memory(
            channels=channels,
            sample_matrix=tables.slopes[1:] @ basis.to_coefficients.T / h,
            carry_matrix=np.zeros((tables.degree, samples)),
            first_offset=constant,
            offset=constant,
            force_weights=tables.sample_test_weights @ basis.to_values,
            known_force=known,
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
    method: Method,
    h: float,
    n_weights: int,
    damping: tuple[FractionalDamping, ...],
    n_steps: int | None = None,
) -> tuple[Channel, ...]:
    """Add up the terms whose matrices have the same direction.

    With `n_steps` the first `n_weights` weights of Runge-Kutta methods are those of a run of that
    many steps, to the last digit.
    """
    channels = []
    for direction, terms in terms_by_direction(damping):
        weights: Array | None = None
        for scale, order in terms:
            own = scale * _weights(method, h, order, n_weights, n_steps)
            weights = own if weights is None else _padded_sum(weights, own)
        if weights is not None:
            channels.append(
                Channel(direction=dense(direction), weights=weights, has_parity=has_parity(method))
            )
    return tuple(channels)


def terms_by_direction(
    damping: tuple[FractionalDamping, ...],
) -> tuple[tuple[Form, tuple[tuple[float, float], ...]], ...]:
    """The distinct directions of the coefficients, each with scale and order of its terms.

    Every direction has one sequence of weights, however many terms there are.
    """
    found: list[tuple[Form, list[tuple[float, float]]]] = []
    for term in damping:
        scale, direction = scale_and_direction(term)
        for other, terms in found:
            if same_direction(other, direction):
                terms.append((scale, term.order))
                break
        else:
            found.append((direction, [(scale, term.order)]))
    return tuple((direction, tuple(terms)) for direction, terms in found)


def shared_channels(
    method: Method, h: float, n_weights: int, orders: tuple[float, ...]
) -> ChannelSource:
    """Channels by the order of the terms, so that scenes of the same orders share all weights.

    The direction of a channel is the sum of the coefficients of its order. Channels stand in
    ascending order, however the terms of a scene do: a batch pairs them by their place.
    """
    weights = {order: _weights(method, h, order, n_weights) for order in orders}

    def channels(damping: tuple[FractionalDamping, ...]) -> tuple[Channel, ...]:
        directions: dict[float, Array] = {}
        for term in damping:
            before = directions.get(term.order)
            own = term.coefficient
            directions[term.order] = own if before is None else before + own
        parity = has_parity(method)
        return tuple(
            Channel(direction=d, weights=weights[o], has_parity=parity)
            for o, d in sorted(directions.items())
        )

    return channels


def has_parity(method: Method) -> bool:
    """Whether the weights equal their transposes up to signs, see :class:`Channel`."""
    return method.cq == "gauss"


def scale_and_direction(term: MatrixForce) -> tuple[float, Form]:
    """The coefficient matrix as a number times a matrix whose largest entry is 1."""
    kept = entries(term.form)
    scale = float(kept[np.abs(kept).argmax()])
    if isinstance(term.form, np.ndarray):
        return scale, term.form / scale
    return scale, scaled(term.form, 1.0 / scale)


def same_direction(a: Form, b: Form) -> bool:
    """Whether two matrices from `scale_and_direction` are one."""
    if a.shape != b.shape or is_sparse(a) != is_sparse(b):
        return False
    if not isinstance(a, np.ndarray):
        one, other = as_csr(a), as_csr(b)
        if not (
            np.array_equal(one.indptr, other.indptr) and np.array_equal(one.indices, other.indices)
        ):
            return False
    return bool(np.allclose(entries(a), entries(b), rtol=1e-14, atol=0))


def _weights(
    method: Method, h: float, order: float, n_weights: int, n_steps: int | None = None
) -> Array:
    """Weights on differences (BDF, shape ``(M,)``) or velocities (Runge-Kutta, ``(M, m, m)``)."""
    if method.is_runge_kutta:
        if order == 1.0:
            # Delta(z)**0: the derivative of the polynomial itself, no memory at all
            return np.eye(method.stages)[None]
        tableau, theta = runge_kutta_tableau(method), order - 1.0
        if n_steps is None:
            weights = legendre_weights(tableau, theta, n_weights)
        else:
            weights = legendre_exponentials(tableau, theta, n_steps).weights(n_weights)
        return np.asarray(h ** (1.0 - order) * weights)
    n_weights = memory_length(method, order, n_weights)
    return np.asarray(h ** (-order) * difference_weights(method.bdf_order, order, n_weights))


def memory_length(method: Method, order: float, n_weights: int) -> int:
    """How many of the first `n_weights` weights are not zero by construction."""
    if order != 1.0:
        return n_weights
    return 1 if method.is_runge_kutta else min(n_weights, method.bdf_order)


def runge_kutta_tableau(method: Method) -> ButcherTableau:
    """The Runge-Kutta method of `method`'s convolution quadrature."""
    from fvi_cli.mathematics.runge_kutta import tableau

    return tableau(method.cq, method.stages)


def _padded_sum(a: Array, b: Array) -> Array:
    if a.shape[0] < b.shape[0]:
        a, b = b, a
    result = a.copy()
    result[: b.shape[0]] += b
    return result


def _force_of_constant_velocity(
    channels: tuple[Channel, ...],
    tables: StepTables,
    method: Method,
    h: float,
    n_steps: int,
    velocity: Array,
) -> Array:
    """Damping force of the motion v0 t, shape ``(n_steps, m, d)``."""
    samples = tables.sample_points.size
    force = np.zeros((n_steps, samples, velocity.size))
    for channel in channels:
        count = min(n_steps, channel.memory)
        weights = np.zeros((n_steps, *channel.weights.shape[1:]))
        weights[:count] = channel.weights[:count]
        total = np.cumsum(weights, axis=0)
        if method.is_runge_kutta:
            response = total[:, :, 0]
        else:
            # the first difference is chi h v0, every later one h v0
            response = h * ((total - weights)[:, None] + np.outer(weights, tables.sample_points))
        force += response[:, :, None] * (velocity @ channel.direction)
    return force
