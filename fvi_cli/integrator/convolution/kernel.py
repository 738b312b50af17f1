r"""Powers of integration as integrals over rates: one set of rates for all exponents.

For an operator I with :math:`(x + I^{-1})^{-1}` bounded for every x > 0, as integration in time
and its discretisation by a Runge-Kutta method on any mesh,

.. math:: I^\theta = \frac{\sin \pi\theta}{\pi} \int_0^\infty x^{-\theta} (x + I^{-1})^{-1} dx,
          \qquad 0 < \theta < 1

(Balakrishnan; Higham, *Functions of Matrices*, section 7), where
:math:`z = (x + I^{-1})^{-1} V` solves z' = -x z + V, z(0) = 0. For -1 < theta < 0 there is the
same integral over :math:`z - V/x`. Behind a step all V is past, and its effect on that step is
:math:`\frac{\sin \pi\theta}{\pi} \int x^{-\theta} \ldots z\, dx` for both signs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CACHED_KERNELS = 256
# With log x = u - exp(first - u) + exp(u - last) the ends begin where x T respectively its
# counterpart K N / (h x) is this; the integrand grows by exp(this) beside the real axis.
_ONSET = 1.0
_END_ERROR = 20.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernel:
    r"""Rates and weights of one or several powers of integration.

    The states are the weighted means :math:`s_j = x_j z_j`, :math:`s_j' = x_j (v - s_j)`,
    :math:`s_j(0) = 0`, of the velocity v: none is larger than v has been, all have its unit,
    and all exponents share them.

    Parameters
    ----------
    exponents
        The exponents theta in (-1, 1): integrals where positive, derivatives where negative.
    rates
        Rates x_j > 0, ascending, 1/time, shape ``(J,)``.
    weights
        Factors :math:`w_{kj}` with which the states enter the force of exponent k,
        time^theta, shape ``(n_terms, J)``: quadrature weights of
        :math:`\frac{\sin \pi\theta}{\pi} x^{-\theta - 1} dx`, of the sign of theta.

    Raises
    ------
    ValueError
        For shapes that do not fit, rates out of order and weights of the wrong sign.

    Notes
    -----
    Discretised by a Runge-Kutta method with matrix A and weights b,

    .. math:: (I^\theta V)_n = h_n^\theta A^\theta V_n + \sum_j w_j (1 + h_n x_j A)^{-1} 1 s_{n,j},
              \quad
              s_{n+1,j} = R(-h_n x_j) s_{n,j} + h_n x_j b^T (1 + h_n x_j A)^{-1} V_n.

    If all s and all V grow by the same constant, a derivative (theta < 0) does not change.
    """

    exponents: tuple[float, ...]
    rates: Array
    weights: Array

    def __post_init__(self) -> None:
        shape = (len(self.exponents), self.rates.size)
        if self.rates.ndim != 1 or self.weights.shape != shape:
            raise ValueError(
                f"kernel: rates of shape {self.rates.shape} and weights of shape "
                f"{self.weights.shape} are not allowed for {shape[0]} exponents"
            )
        if not (np.all(np.diff(self.rates) > 0) and np.all(self.rates > 0)):
            raise ValueError("kernel: rates must be positive and increase strictly")
        signs = np.sign(self.exponents)[:, None]
        if not np.all(self.weights * signs >= 0):
            raise ValueError("kernel: weights must have the signs of their exponents")
        self.rates.setflags(write=False)
        self.weights.setflags(write=False)

    @property
    def n_states(self) -> int:
        """Number J of rates."""
        return int(self.rates.size)

    @property
    def energy_weights(self) -> Array:
        r"""Weights :math:`e_{kj} = |w_{kj}| / x_j` of the stored energy, shape ``(n_terms, J)``.

        The energy in the memory of ``mu I^theta v`` is :math:`\mu/2 \sum_j e_j s_j^2`. In a step
        of a Gauss method the work of the damping force is its increase and the dissipation,

        .. math:: \mu h \sum_j |w_j| \sum_i b_i S_{ij}^2 \;(\theta > 0), \qquad
                  \mu h \sum_j |w_j| \sum_i b_i (V_i - S_{ij})^2 \;(\theta < 0),

        with the stages :math:`S_j = (1 + h x_j A)^{-1} (1 s_j + h x_j A V)` of the states; the
        difference is :math:`V - S_j = (1 + h x_j A)^{-1} (V - 1 s_j)`, to be taken in this form.
        """
        return np.asarray(np.abs(self.weights) / self.rates)


def power_kernel(
    exponents: Sequence[float],
    *,
    shortest_step: float,
    final_time: float,
    stages: int,
    steps: float | None = None,
    accuracy: float = 1e-13,
) -> Kernel:
    r"""Rates and weights of powers of integration, for all meshes of certain steps.

    Parameters
    ----------
    exponents
        The exponents in (-1, 1), none of them zero.
    shortest_step, final_time
        Shortest step and length of the mesh, time.
    stages
        Number of stages of the Gauss method; those of Radau IIA and Lobatto IIIC need less.
    steps
        Number of steps, or ``shortest_step * sum(1 / h_n)`` where that is known to be less;
        None: as many as there is room for.
    accuracy
        Permitted error of the weights of the history, relative to their size, 1e-15 to 0.1.

    Returns
    -------
    Kernel
        Kept and shared for the powers of 2 next to the arguments.

    Raises
    ------
    ValueError
        For arguments out of range.

    Notes
    -----
    The trapezoidal rule in u with :math:`\log x = u - e^{u_0 - u} + e^{u - u_1}` (for the lower
    end: McLean, *Exponential sum approximations for t^{-beta}*, 2018). Below 1/T the integrand is
    :math:`x^{-\theta}` times an analytic function of x, above K N / h it is
    :math:`x^{-\theta - 2}` times an analytic function of 1/x, because
    :math:`R(-z) = \pm \exp(-K/z + \ldots)`, K = 2 m (m + 1); there the substitution makes it
    fall doubly exponentially, and nodes at which x no longer differs from its limit are merged.
    """
    if not exponents or not all(0 < abs(theta) < 1 for theta in exponents):
        raise ValueError(f"exponents: {list(exponents)}; each must lie in (-1, 1) and not be 0")
    if not 0 < shortest_step <= final_time < math.inf:
        raise ValueError(
            f"shortest_step: {shortest_step} is not allowed; it must be positive and at most the "
            f"final time {final_time}"
        )
    if stages < 1:
        raise ValueError(f"stages: {stages} is not allowed; it must be at least 1")
    if not 1e-15 <= accuracy <= 0.1:
        raise ValueError(f"accuracy: {accuracy} is not allowed; permitted are 1e-15 to 0.1")
    room = final_time / shortest_step
    if steps is not None and not steps >= 1:
        raise ValueError(f"steps: {steps} is not allowed; it must be at least 1")
    most = room if steps is None else float(steps)
    return _kernel(
        tuple(map(float, exponents)),
        math.floor(math.log2(shortest_step)),
        math.ceil(math.log2(final_time)),
        math.ceil(math.log2(most)),
        stages,
        accuracy,
    )


def power_kernel_slopes(
    exponents: Sequence[float],
    *,
    shortest_step: float,
    final_time: float,
    stages: int,
    steps: float,
    accuracy: float = 1e-14,
) -> tuple[Array, Array, Array]:
    """Rates, weights of powers of integration, and their derivatives by the exponents.

    Parameters
    ----------
    exponents
        In (-1, 1); 0, the identity, has weights of zero and the derivative of the logarithm.
    shortest_step, final_time, stages, steps, accuracy
        As for :func:`power_kernel`, whose rates and weights these are where no exponent is 0.

    Returns
    -------
    tuple of Array
        Rates ``(J,)``, weights and derivatives ``(n_terms, J)``; not checked and not kept.
    """
    rule = _rule(
        tuple(map(float, exponents)),
        math.floor(math.log2(shortest_step)),
        math.ceil(math.log2(final_time)),
        math.ceil(math.log2(steps)),
        stages,
        accuracy,
    )
    theta = np.array(exponents)[:, None]
    by_angle = np.cos(np.pi * theta) * rule.density
    slopes = rule.merged(theta, by_angle - _sine(theta) * rule.density * rule.logs)
    return rule.rates, rule.merged(theta, _sine(theta) * rule.density), slopes


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rule:
    """The trapezoidal rule for all exponents, with the nodes that are merged at its ends.

    Parameters
    ----------
    logs, density
        Logarithms of the nodes and their weights, of the merged ones as well.
    n_below, n_kept
        Nodes that are merged into the first one, and nodes that are kept.
    """

    logs: Array
    density: Array
    n_below: int
    n_kept: int

    @property
    def rates(self) -> Array:
        """The nodes that are kept, shape ``(J,)``."""
        return np.exp(self.logs[self.n_below : self.n_below + self.n_kept])

    def merged(self, theta: Array, factors: Array) -> Array:
        """Weights of the states, ``factors * x^-theta`` with the ends merged, ``(n_terms, J)``."""
        logs, end = self.logs, self.n_below + self.n_kept
        kept = logs[self.n_below : end]
        weights = factors[:, self.n_below : end] * np.exp(-theta * kept)
        below, above = slice(0, self.n_below), slice(end, None)
        weights[:, 0] += (factors[:, below] * np.exp((1 - theta) * logs[below] - kept[0])).sum(
            axis=1
        )
        weights[:, -1] += (factors[:, above] * np.exp(-(1 + theta) * logs[above] + kept[-1])).sum(
            axis=1
        )
        return np.asarray(weights)


def _sine(theta: Array) -> Array:
    """``sin(pi theta) / pi`` in full relative accuracy up to -1 and 1."""
    sine = np.sin(np.pi * np.minimum(np.abs(theta), 1 - np.abs(theta)))
    return np.asarray(np.copysign(sine, theta) / np.pi)


@lru_cache(maxsize=_CACHED_KERNELS)
def _kernel(
    exponents: tuple[float, ...], step: int, time: int, steps: int, stages: int, accuracy: float
) -> Kernel:
    """The kernel for powers of 2: shortest step, final time and number of steps."""
    rule, theta = (
        _rule(exponents, step, time, steps, stages, accuracy),
        np.array(exponents)[:, None],
    )
    weights = rule.merged(theta, _sine(theta) * rule.density)
    return Kernel(exponents=exponents, rates=rule.rates, weights=weights)


def _rule(
    exponents: tuple[float, ...], step: int, time: int, steps: int, stages: int, accuracy: float
) -> _Rule:
    """The nodes for powers of 2: shortest step, final time and number of steps."""
    first = math.log(_ONSET) - time * math.log(2)
    stiffness = 2 * stages * (stages + 1)
    last = math.log(stiffness / _ONSET) + (steps - step) * math.log(2)
    width = _width(exponents, accuracy)
    # an end has no effect left at exp(-cut), in the units of x and of the integrand
    cut = -math.log(accuracy) + 3.0
    tail = math.log(cut) + 0.5
    # the same for x to the power 1 - theta and 1 / x to the power 1 + theta, merged
    below = math.log(cut / (1 - max(exponents))) + 0.5
    above = math.log(cut / (1 + min(exponents))) + 0.5
    n_middle = math.ceil((last - first + 2 * tail) / width)
    n_below = math.ceil(max(below - tail, 0) / width)
    n_above = math.ceil(max(above - tail, 0) / width)
    u = first - tail + width * np.arange(-n_below, n_middle + n_above + 1)
    left, right = np.exp(first - u), np.exp(u - last)
    return _Rule(
        logs=u - left + right,
        density=width * (1 + left + right),
        n_below=n_below,
        n_kept=n_middle + 1,
    )


def _width(exponents: tuple[float, ...], accuracy: float) -> float:
    r"""Width of the trapezoidal rule for :math:`\int e^{(1 - \theta) u - e^u} du`.

    Its relative error is :math:`2 |\Gamma(1 - \theta + i \omega)| / \Gamma(1 - \theta)` at
    :math:`\omega = 2 \pi / width`, with Stirling's formula; near theta = 1 that of the lower end
    is larger.
    """
    width = math.inf
    for theta in exponents:
        omega = 10.0
        for _ in range(20):
            size = 2 * math.sqrt(2 * math.pi) * omega ** (0.5 - theta) / math.gamma(1 - theta)
            size = max(size, _END_ERROR)
            omega = max(2 / math.pi * math.log(size / accuracy), 1.0)
        width = min(width, 2 * math.pi / omega)
    return width


__all__ = ["Kernel", "power_kernel", "power_kernel_slopes"]
