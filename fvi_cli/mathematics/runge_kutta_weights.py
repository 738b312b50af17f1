"""Runge-Kutta convolution quadrature of fractional powers: weights and discrete operators."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvi_cli.mathematics.runge_kutta import ButcherTableau
from fvi_cli.mathematics.runge_kutta_symbol import log_stability

Array = NDArray[np.float64]

# The integrands are analytic in |Im u| < pi/2, u = log x, so the trapezoidal rule with this step
# errs by exp(-2 pi (pi/2) / 0.2), about 1e-21.
_STEP = 0.2
# exp(-40): relative size of what the closed tails leave out.
_MARGIN = 40.0
# Powers of R are taken as R^(BLOCK q) R^r, r < BLOCK, and several q at once.
_BLOCK = 256
_BATCH = 128
# A state that has decayed to exp(-100) contributes nothing to any weight.
_NEGLIGIBLE = 100.0
# Below this exponent A^{-theta} is the identity to rounding.
_LEAST_THETA = 1e-20


@dataclass(frozen=True, kw_only=True, eq=False)
class ExponentialSum:
    """Convolution quadrature weights as a sum of exponentials.

    ``w_0 = instantaneous`` and ``w_n = sum_j r_j^(n-1) columns_j rows_j^T`` for
    ``1 <= n <= n_steps``, with ``0^0 = 1``: a history that needs no past values but J scalar
    states per component, ``state_j <- r_j state_j + rows_j . v``.

    Parameters
    ----------
    tableau
        The method, m stages.
    theta
        The exponent.
    n_steps
        Largest n for which the sum holds.
    instantaneous
        The weight ``w_0 = A^{-theta}``, shape ``(m, m)``.
    nodes
        The nodes x_j of the real-axis integral, with 0 and infinity for its two tails,
        shape ``(J,)``; empty for theta = 0.
    signs, log_magnitudes
        Sign and ``log|r_j|`` of the ratios ``r_j = R(-x_j)``, shape ``(J,)``.
    columns, rows
        The vectors of the rank-one terms, the integration weights in the columns,
        shape ``(J, m)``.

    Raises
    ------
    ValueError
        For shapes that do not fit each other.
    """

    tableau: ButcherTableau
    theta: float
    n_steps: int
    instantaneous: Array
    nodes: Array
    signs: Array
    log_magnitudes: Array
    columns: Array
    rows: Array

    def __post_init__(self) -> None:
        m, n_states = self.tableau.n_stages, self.nodes.size
        shapes = {
            "instantaneous": (m, m),
            "nodes": (n_states,),
            "signs": (n_states,),
            "log_magnitudes": (n_states,),
            "columns": (n_states, m),
            "rows": (n_states, m),
        }
        for name, shape in shapes.items():
            array: Array = getattr(self, name)
            if array.shape != shape:
                raise ValueError(f"{name}: shape {array.shape} is not allowed; it must be {shape}")
            array.setflags(write=False)

    @property
    def n_states(self) -> int:
        """Number J of exponentials."""
        return int(self.nodes.size)

    @property
    def ratios(self) -> Array:
        """The ratios r_j, shape ``(J,)``, rounded: for powers of them use `powers`."""
        return np.asarray(self.signs * np.exp(self.log_magnitudes))

    def powers(self, exponents: ArrayLike) -> Array:
        """Return ``r_j^n`` for integers n >= 0, shape ``(n, J)``, good for n up to `n_steps`."""
        n = np.asarray(exponents, dtype=np.int64)[:, None]
        magnitudes = np.exp(n * self.log_magnitudes)
        return np.asarray(np.where(n % 2 == 1, self.signs, 1.0) * magnitudes)

    def weights(self, n_weights: int) -> Array:
        """Return ``w_0, ..., w_{n_weights - 1}``, shape ``(n_weights, m, m)``.

        The array is contiguous along n within every matrix entry, as transforms over n want it.

        Raises
        ------
        ValueError
            For a number of weights outside 1 to ``n_steps + 1``.
        """
        if not 1 <= n_weights <= self.n_steps + 1:
            raise ValueError(
                f"n_weights: {n_weights} is not allowed; permitted are 1 to {self.n_steps + 1}"
            )
        # together both factors are fewest where they are equally many; an even block has no sign
        block = min(_BLOCK, 2 * math.ceil(math.sqrt(self.n_steps) / 2))
        m, n_blocks = self.tableau.n_stages, -(-(n_weights - 1) // block)
        memory = np.zeros((m * m, n_blocks * block))
        products = (self.columns[:, :, None] * self.rows[:, None, :]).reshape(-1, m * m)
        within = self.powers(np.arange(block))
        for first in range(0, n_blocks, _BATCH):
            blocks = np.arange(first, min(first + _BATCH, n_blocks))
            alive = -self.log_magnitudes * (first * block) < _NEGLIGIBLE
            scales = np.exp((blocks * block)[:, None] * self.log_magnitudes[alive])
            steps = within[:, alive].T
            begin, end = first * block, (int(blocks[-1]) + 1) * block
            for entry in range(m * m):
                values = (scales * products[alive, entry]) @ steps
                memory[entry, begin:end] = values.reshape(-1)
        weights = np.empty((m, m, n_weights))
        weights[:, :, 0] = self.instantaneous
        weights[:, :, 1:] = memory.reshape(m, m, -1)[:, :, : n_weights - 1]
        return np.moveaxis(weights, 2, 0)


Vectors = Callable[[Array], tuple[Array, Array]]
"""From the nodes x of a real-axis integral, 0 and infinity with them, to columns and rows."""


def exponential_sum(
    tableau: ButcherTableau, theta: float, n_steps: int, vectors: Vectors | None = None
) -> ExponentialSum:
    r"""Return the weights of ``Delta(z)^theta`` as a sum of exponentials.

    Parameters
    ----------
    tableau
        Gauss, Radau IIA or Lobatto IIIC, m stages.
    theta
        Exponent in (-1, 1): positive for derivatives, negative for integrals.
    n_steps
        Largest n for which the sum is to hold, at least 1.
    vectors
        Where columns and rows come from, without the integration weights; None: from the matrix
        of the method.

    Raises
    ------
    ValueError
        For an exponent outside (-1, 1), fewer than one step, and a tableau of another family.

    Notes
    -----
    The weights are

    .. math:: w_n = -\frac{\sin \pi\theta}{\pi} \int_0^\infty x^\theta R(-x)^{n-1}
              (I + xA)^{-1} 1 \, b^T (I + xA)^{-1} \, dx, \qquad n \ge 1,

    a representation of the kind used by Banjai and López-Fernández, *Efficient high order
    algorithms for fractional integrals and fractional differential equations*, Numer. Math. 141,
    2019. The trapezoidal rule in log x is cut where ``n x`` respectively ``n / x`` is below
    rounding; what lies beyond is a geometric series.
    """
    _check_theta(theta)
    if n_steps < 1:
        raise ValueError(f"n_steps: {n_steps} is not allowed; it must be at least 1")
    m = tableau.n_stages
    first = _first_weight(tableau, theta)
    if theta == 0:
        return ExponentialSum(
            tableau=tableau,
            theta=0.0,
            n_steps=n_steps,
            instantaneous=first,
            nodes=np.empty(0),
            signs=np.empty(0),
            log_magnitudes=np.empty(0),
            columns=np.empty((0, m)),
            rows=np.empty((0, m)),
        )
    nodes, factors = real_axis_rule(theta, n_steps)
    columns, rows = _resolvent_vectors(tableau, nodes) if vectors is None else vectors(nodes)
    signs, log_magnitudes = log_stability(tableau, nodes)
    return ExponentialSum(
        tableau=tableau,
        theta=float(theta),
        n_steps=n_steps,
        instantaneous=first,
        nodes=nodes,
        signs=signs,
        log_magnitudes=log_magnitudes,
        columns=factors[:, None] * columns,
        rows=rows,
    )


def real_axis_rule(theta: float, n_steps: int) -> tuple[Array, Array]:
    r"""Nodes and weights of :math:`-\frac{\sin \pi\theta}{\pi} \int_0^\infty x^\theta g(x) dx`.

    Parameters
    ----------
    theta
        Exponent in (-1, 1).
    n_steps
        Largest n for which g may decay like ``R(-x)^(n - 1)``.

    Returns
    -------
    tuple
        Nodes x_j from 0 to infinity, and weights; the one at infinity belongs to the limit of
        ``x^2 g(x)``, each shape ``(J,)``.
    """
    u = _grid(np.log(n_steps + 1.0) + _MARGIN)
    nodes = np.concatenate([[0.0], np.exp(u), [np.inf]])
    factors = np.concatenate(
        [
            [np.exp((theta + 1) * u[0]) / np.expm1(_STEP * (theta + 1))],
            np.exp((theta + 1) * u),
            [np.exp((theta - 1) * u[-1]) / np.expm1(_STEP * (1 - theta))],
        ]
    )
    return nodes, factors * (-_STEP * _sine_of_pi(theta) / np.pi)


def runge_kutta_weights(tableau: ButcherTableau, theta: float, n_weights: int) -> Array:
    """Return the weights w_n of ``Delta(z)^theta = sum_n w_n z^n``, step size 1.

    Parameters
    ----------
    tableau
        Gauss, Radau IIA or Lobatto IIIC, m stages.
    theta
        Exponent in (-1, 1).
    n_weights
        Number of weights, at least 1.

    Returns
    -------
    Array
        Shape ``(n_weights, m, m)``; for theta = 0 the identity and then zeros.

    Raises
    ------
    ValueError
        For an exponent outside (-1, 1), fewer than one weight, and a tableau of another family.

    See Also
    --------
    exponential_sum : the same weights without the table, and the formula.
    """
    if n_weights < 1:
        raise ValueError(f"n_weights: {n_weights} is not allowed; it must be at least 1")
    return exponential_sum(tableau, theta, max(n_weights - 1, 1)).weights(n_weights)


def left_operator_rk(
    tableau: ButcherTableau, exponent: float, step_size: float, values: ArrayLike
) -> Array:
    """Return the retarded fractional operator of order `exponent` on stage values.

    ``(J_- X)_k = h^(-exponent) sum_{n=0..k} w_n X_{k-n}``.

    Parameters
    ----------
    tableau
        The method, m stages.
    exponent
        Order in (-1, 1): positive for derivatives, negative for integrals.
    step_size
        Step size h > 0.
    values
        Stage values X_{k,i}, shape ``(n, m, ...)``.

    Returns
    -------
    Array
        Shape of `values`.

    Raises
    ------
    ValueError
        For an exponent outside (-1, 1), a step size that is not positive, and wrong shapes.
    """
    values = _stage_values(tableau, step_size, values)
    weights = runge_kutta_weights(tableau, exponent, values.shape[0])
    return np.asarray(_causal_convolution(weights, values) / step_size**exponent, dtype=np.float64)


def right_operator_rk(
    tableau: ButcherTableau, exponent: float, step_size: float, values: ArrayLike
) -> Array:
    """Return the advanced fractional operator, the adjoint of `left_operator_rk`.

    ``(J_+ Y)_k = h^(-exponent) sum_{n>=0} B^{-1} w_n^T B Y_{k+n}`` with ``B = diag(b)``, so that
    ``<J_- X, Y> = <X, J_+ Y>`` in ``<X, Y> = h sum_k sum_i b_i X_{k,i} Y_{k,i}``. For Gauss and
    Lobatto IIIC it is also `left_operator_rk` with steps and stages in reversed order.

    Parameters
    ----------
    tableau
        The method, m stages.
    exponent
        Order in (-1, 1).
    step_size
        Step size h > 0.
    values
        Stage values Y_{k,i}, shape ``(n, m, ...)``.

    Returns
    -------
    Array
        Shape of `values`.

    Raises
    ------
    ValueError
        For an exponent outside (-1, 1), a step size that is not positive, and wrong shapes.
    """
    values = _stage_values(tableau, step_size, values)
    weights = runge_kutta_weights(tableau, exponent, values.shape[0])
    adjoint = np.swapaxes(weights, 1, 2) * (tableau.b / tableau.b[:, None])
    result = _causal_convolution(adjoint, values[::-1])[::-1] / step_size**exponent
    return np.asarray(result, dtype=np.float64)


def _check_theta(theta: float) -> None:
    # Written as a negation so that NaN is refused as well.
    if not -1 < theta < 1:
        raise ValueError(f"theta: {theta} is not allowed; it must lie in (-1, 1)")


def _stage_values(tableau: ButcherTableau, step_size: float, values: ArrayLike) -> Array:
    if not 0 < step_size < np.inf:
        raise ValueError(f"step_size: {step_size} is not allowed; it must be positive")
    array = np.asarray(values, dtype=np.float64)
    m = tableau.n_stages
    if array.ndim < 2 or array.shape[0] == 0 or array.shape[1] != m:
        raise ValueError(
            f"values: shape {array.shape} is not allowed; it must be (n, {m}, ...) with n >= 1"
        )
    return array


def _causal_convolution(weights: Array, values: Array) -> Array:
    """Return ``sum_{n<=k} w_n X_{k-n}`` for weights (n, m, m) and values (n, m, ...)."""
    n_steps, m = values.shape[:2]
    length = 1 << (2 * n_steps - 1).bit_length()
    flat = values.reshape(n_steps, m, -1)
    product = np.fft.rfft(weights, length, axis=0) @ np.fft.rfft(flat, length, axis=0)
    result = np.fft.irfft(product, length, axis=0)[:n_steps].reshape(values.shape)
    return np.asarray(result, dtype=np.float64)


def _grid(reach: float) -> Array:
    """The points u = log x of the trapezoidal rule, symmetric about 0."""
    half = int(np.ceil(reach / _STEP))
    return np.asarray(np.arange(-half, half + 1) * _STEP, dtype=np.float64)


def _sine_of_pi(theta: float) -> float:
    """Return ``sin(pi theta)`` with full relative accuracy up to theta = -1 and 1."""
    # 1 - |theta| is exact for |theta| >= 1/2, and the sine is symmetric about 1/2.
    distance = min(abs(theta), 1 - abs(theta))
    return float(np.copysign(np.sin(np.pi * distance), theta))


def _resolvent_vectors(tableau: ButcherTableau, nodes: Array) -> tuple[Array, Array]:
    """Return ``(I + xA)^{-1} 1`` and ``b^T (I + xA)^{-1}``, both of shape (J, m).

    The first of the nodes x is 0, the last one infinity; there it is x times the vectors.
    """
    m, x = tableau.n_stages, nodes[1:-1]
    matrices = np.eye(m) + x[:, None, None] * tableau.A
    columns = np.linalg.solve(matrices, np.ones((x.size, m, 1)))[..., 0]
    right = np.broadcast_to(tableau.b[:, None], (x.size, m, 1))
    rows = np.linalg.solve(np.swapaxes(matrices, 1, 2), right)[..., 0]
    inverse = np.linalg.inv(tableau.A)
    return (
        np.concatenate([np.ones((1, m)), columns, [inverse.sum(axis=1)]]),
        np.concatenate([[tableau.b], rows, [tableau.b @ inverse]]),
    )


def _first_weight(tableau: ButcherTableau, theta: float) -> Array:
    r"""Return ``A^{-theta}``.

    ``A^{-s} = (sin(pi s) / pi) int_0^inf x^(s-1) (I + xA)^{-1} dx`` for 0 < s < 1 (Higham,
    *Functions of Matrices*, section 7), with one factor A more for negative theta. Unlike the
    eigenvectors of A the resolvents are well conditioned.
    """
    m = tableau.n_stages
    if abs(theta) < _LEAST_THETA:
        return np.eye(m)
    s, complement = (theta, 1 - theta) if theta > 0 else (1 + theta, -theta)
    u = _grid(_MARGIN)
    resolvents = np.linalg.inv(np.eye(m) + np.exp(u)[:, None, None] * tableau.A)
    total = np.tensordot(np.exp(s * u), resolvents, axes=1)
    total += np.exp(s * u[0]) / np.expm1(_STEP * s) * np.eye(m)
    total += np.exp(-complement * u[-1]) / np.expm1(_STEP * complement) * np.linalg.inv(tableau.A)
    power = total * (_STEP * abs(_sine_of_pi(theta)) / np.pi)
    return np.asarray(power if theta > 0 else tableau.A @ power, dtype=np.float64)


__all__ = [
    "ExponentialSum",
    "exponential_sum",
    "left_operator_rk",
    "real_axis_rule",
    "right_operator_rk",
    "runge_kutta_weights",
]
