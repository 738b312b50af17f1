r"""The memory of backward differences on equal steps: lags, and sums of exponentials beyond them.

With the unknowns :math:`U_k` of a step (its increments over h) and the basis :math:`E^T` at the
samples, differences from a step to the next are :math:`h (E^T U_k + C^T U_{k-1})`, where
:math:`C^T U = U_s - E^T U`. So the force at the sampling points is a sum over lags,

.. math:: F_k = \sum_{n=0}^{k} K_n U_{k-n} D, \qquad K_n = h\,(w_n E^T + w_{n-1} C^T),

with the weights w on differences. Near lags are stored one by one, and beyond them the weights
are sums of exponentials (:func:`lag_exponentials`), each with a state for every unknown of a step:
:math:`S_j = \sum_{n \geq 1} e^{-n y_j} U_{k-n}`. Order 1, whose weights end, is a term too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.integrator.memory.interface import Direction, Kernels, along
from fvi_cli.integrator.memory.kernel import Term, power_kernel
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array, Integers
from fvi_cli.mathematics.bdf import difference_weights

NEAR_LAGS = {1: 64, 2: 64, 3: 64, 4: 64, 5: 128, 6: 256}
"""From this lag n on the weights are exponentials, by the order p. Zeros of the symbol other than 1
are at |z| >= 3, 2.3, 1.8 (p = 2, 3, 4), 1.41 and 1.158: |z|^-n is below the unit round-off."""
_GONE = 45.0
"""An exponential that has fallen by exp(-45) = 3e-20 at that lag is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LagExponentials:
    r"""Weights :math:`w_n = \sum_j c_j e^{-n y_j}` for lags :math:`n \geq` `near`."""

    near: int  # first lag from which they hold
    rates: Array  # y_j per step, ascending, shape (J,), the same for all orders
    factors: Array  # c_j for every order of differentiation, shape (n_orders, J)


def lag_exponentials(bdf_order: int, orders: Sequence[float], n_steps: int) -> LagExponentials:
    r"""Number of lags to store one by one on N equal steps, and exponentials beyond them.

    The weights on differences are the coefficients of :math:`\gamma_p(z)^\gamma / (1 - z)`.
    Cauchy's integral around the cuts of that function is one over the cut from its branch point
    z = 1 and others from the zeros of :math:`\gamma_p(z) / (1 - z)`, whose part falls like
    :math:`|z_j|^{-n}` with the lag n. So beyond some lags

    .. math:: w_n = \frac{\sin \pi\gamma}{\pi} \int_0^\infty
              \frac{|\gamma_p(e^y)|^\gamma}{e^y - 1} e^{-n y} \, dy

    to round-off. At small y the density is that of the fractional integral,
    :math:`y^{\gamma - 1}` times an analytic function, and the rates of
    :mod:`fvi_cli.integrator.memory.kernel` serve.

    The orders are in (0, 2); order 1 is included, its weights end. N + 1 weights of steps of length
    1 are right to 1e-13 of each. There are no rates if all lags are near.
    """
    near, is_fractional = NEAR_LAGS[bdf_order], np.array(orders) != 1.0
    if not is_fractional.any() or n_steps <= near:
        # the weights of order 1 end
        near = n_steps if is_fractional.any() else min(bdf_order, n_steps)
        return LagExponentials(near=near, rates=np.zeros(0), factors=np.zeros((len(orders), 0)))
    # the weights of the power 0, order 1, are zero
    kernel = power_kernel(
        [1.0 - order for order in orders],
        shortest_step=1.0,
        final_time=float(n_steps + 1),
        stages=1,
        steps=1.0,
    )
    count = int(np.searchsorted(kernel.rates, _GONE / near, side="right"))
    rates = kernel.rates[:count]
    z_less_1 = np.expm1(rates)
    symbol = -sum((-z_less_1) ** k / k for k in range(1, bdf_order + 1))
    # the weights of the kernel are those of y**(gamma - 2)
    powers = (symbol / rates) ** np.array(orders)[:, None]
    factors = kernel.weights[:, :count] * rates**2 / z_less_1 * powers
    return LagExponentials(near=near, rates=rates, factors=factors)


@dataclass(frozen=True, kw_only=True, eq=False)
class LagKernels(Kernels):
    """Tables of lags, and of sums beyond them, for B equal steps."""

    # for every direction, force on the block by unit states at its beginning, (q or 1, B m, J)
    responses: tuple[Array, ...]
    n_lags: int  # number L of steps that are stored one by one
    rates: Array  # y of the sums, and exp(-n y) for n = B .. 1, (sums, B)
    decay: Array

    def past(self, states: Sequence[Array], count: int) -> Array:
        """Force of the past on the first `count` steps: one product for every direction."""
        size = count * self.n_samples
        forces = [
            along(np.matmul(response[:, :size], acted), one.matrix)
            for response, acted, one in zip(self.responses, states, self.directions, strict=True)
        ]
        return np.asarray(sum(forces[1:], start=forces[0]))

    def push(self, states: Array, inputs: Array, count: int) -> Array:
        """States after the first `count` steps."""
        s, (q, _, e) = self.n_inputs, states.shape
        last = self.n_lags * s
        after = np.empty_like(states)
        after[:, :last] = np.concatenate([states[:, :last], inputs], axis=1)[:, -last:]
        if len(self.decay):
            decay = self.decay[:, self.count - count :]
            sums = states[:, last:].reshape(q, -1, s * e)
            new = np.matmul(decay, inputs.reshape(q, count, s * e))
            after[:, last:] = (decay[:, :1] * sums + new).reshape(q, -1, e)
        return after

    def change_of_all(self, count: int) -> Array:
        """The matrix by which undriven states change over `count` steps, ``(J, J)``."""
        s, unit = self.n_inputs, np.eye(self.responses[0].shape[2])
        zero = np.zeros((1, count * s, len(unit)))
        matrix = self.push(unit[None], zero, count)[0] - unit
        last = self.n_lags * s
        matrix[last:, last:] = np.diag(np.repeat(np.expm1(-count * self.rates), s))
        return np.asarray(matrix)


class Lags:
    """Powers of backward differences on N equal steps.

    The states are the unknowns of the last L steps, in the order of time, and sums over all of
    them, each for the s unknowns of a step: J is ``(L + sums) s``. Terms are exponents, 1 minus
    the orders, each once.
    """

    def __init__(
        self, method: Method, terms: Sequence[Term], *, n_steps: int, final_time: float
    ) -> None:
        self._exponents = [term for term in terms if isinstance(term, float)]
        if len(self._exponents) < len(terms):
            raise ValueError("terms: backward differences take powers only")
        self.terms, self._tables = tuple(terms), step_tables(method)
        self._h, self._bdf_order = final_time / n_steps, method.bdf_order
        orders = [1.0 - term for term in self._exponents]
        self._tail = lag_exponentials(method.bdf_order, orders, n_steps)
        self.n_lags = self._tail.near
        self.n_states = (self.n_lags + self._tail.rates.size) * self._tables.degree
        # inputs of a start velocity of -1 in every step, (i,), which relative terms add
        self.column = -self._tables.control_points[1:]

    @cached_property
    def _weights(self) -> tuple[Array, Array]:
        """:math:`K_n`, ``(K, L + 1, m, s)``, and factors of sums in the next ``(K, sums, m, s)``.

        They are computed on first use: plans need counts only.
        """
        tail = self._tail
        units = np.array([self._h**exponent for exponent in self._exponents])
        weights = np.array(
            [
                unit * difference_weights(self._bdf_order, 1.0 - exponent, tail.near + 1)
                for unit, exponent in zip(units, self._exponents, strict=True)
            ]
        )
        sample = self._tables.sample_basis[1:].T
        carry = np.eye(self._tables.degree)[-1:] - sample
        kernels = weights[..., None, None] * sample
        kernels[:, 1:] += weights[:, :-1, None, None] * carry
        factors = (units[:, None] * tail.factors)[..., None, None]
        return kernels, factors * (sample + np.exp(tail.rates)[:, None, None] * carry)

    def _beyond(self, lags: Integers) -> Array:
        """The sums at lags n >= 1, ``(K, n, m, s)``."""
        decay = np.exp(-np.outer(lags, self._tail.rates))
        return np.asarray(np.einsum("nj,tjms->tnms", decay, self._weights[1]))

    @property
    def operations_per_step(self) -> tuple[int, int]:
        """Multiply-adds for one component in a step: for the force of a direction, and states."""
        force = self._tables.sample_points.size * self.n_states
        return force, self._tail.rates.size * self._tables.degree

    def kernels(self, h: float, count: int, directions: tuple[Direction, ...]) -> LagKernels:
        """Tables of `count` steps; all are of one length."""
        kernels, far = self._weights
        rates, before = self._tail.rates, np.arange(1, self.n_lags + 1)
        # the sums are over all lags n >= 1: their share is subtracted from near lags
        near = kernels.copy()
        near[:, 1:] -= self._beyond(before)
        later = np.arange(self.n_lags + 1, max(count, self.n_lags + 1))
        sequence = np.concatenate([kernels[:, :count], self._beyond(later)], axis=1)
        lags = before[::-1] + np.arange(count)[:, None]
        by_lags = near[:, np.minimum(lags, self.n_lags)] * (lags <= self.n_lags)[..., None, None]
        decay = np.exp(-np.outer(np.arange(count), rates))[None, :, :, None, None]
        by_states = np.concatenate([by_lags, decay * far[:, None]], axis=2)
        response = np.ascontiguousarray(by_states.transpose(0, 1, 3, 2, 4))
        response = response.reshape(len(kernels), -1, self.n_states)
        return LagKernels(
            count=count,
            directions=directions,
            sequences=tuple(one.combine(sequence) for one in directions),
            column=self.column,
            responses=tuple(one.combine(response) for one in directions),
            n_lags=self.n_lags,
            rates=rates,
            decay=np.exp(-np.outer(rates, np.arange(count, 0, -1))),
        )
