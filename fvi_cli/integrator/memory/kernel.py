r"""Powers of integration and relaxation laws as integrals over rates: one set of rates for all.

For an operator I with :math:`(x + I^{-1})^{-1}` bounded for every x > 0, as integration in time
and its discretisation by a Runge-Kutta method on any mesh,

.. math:: I^\theta = \frac{\sin \pi\theta}{\pi} \int_0^\infty x^{-\theta} (x + I^{-1})^{-1} dx,
          \qquad 0 < \theta < 1

(Balakrishnan; Higham, *Functions of Matrices*, section 7), where
:math:`z = (x + I^{-1})^{-1} V` solves z' = -x z + V, z(0) = 0. For -1 < theta < 0 there is the
same integral over :math:`z - V/x`. All V before a step is its past, and the effect on the step is
:math:`\frac{\sin \pi\theta}{\pi} \int x^{-\theta} \ldots z\, dx` for both signs. For theta = 0 it
vanishes.

The rates depend on the mesh and on relaxation laws with narrow spectra, never on exponents: terms
of all orders and the members of a batch share their states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeGuard

import numpy as np

from fvi_cli.effects.laws import RelaxationKernel
from fvi_cli.mathematics.arrays import Array

ACCURACY = 1e-14
"""Of the weights of the history, relative to their size."""
WIDTH = 0.2553305033749236
"""Steps of the trapezoidal rule: with w = 2 pi / width its relative error for x^2 exp(-x) is
2 |Gamma(2 + i w)| = 5 w^1.5 exp(-pi w / 2), the accuracy, and for lower powers it is less."""
_CACHED_KERNELS = 256  # number of kernels that are kept in a process
LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
"""Exponent of orders so small that 1 minus the order is 1; rates serve all exponents up to it."""
# nodes crowd around singularities that are nearer to the real axis than this: the rule needs pi / 2
_WIDE = 0.55 * math.pi
_PEAK_MARGIN = 3.0  # least distance of a peak from the ends, in logarithms of rates
# ends are moved for a peak in steps of this size, so that similar laws have the same rates
_ROOM = 2.0
# nodes farther than this (in logarithms) beyond the ends have the same effect
_ALIKE = 120.0


Term = float | RelaxationKernel
"""An exponent in (-1, 1), or the kernel of a relaxation law."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernel:
    r"""Rates and weights of one or several terms.

    The states are the weighted means :math:`s_j = x_j z_j`, :math:`s_j' = x_j (v - s_j)`,
    :math:`s_j(0) = 0`, of the velocity v: none is larger than v has been, all have its unit,
    and all terms share them. The weights :math:`w_{kj}` with which they enter the force of term k
    are those of quadratures of :math:`\frac{\sin \pi\theta}{\pi} x^{-\theta - 1} dx` for a power
    (unit time^theta, the sign of theta), and of :math:`\rho(x) dx / x` for a law with the density
    :math:`\rho` of its spectrum.

    Discretised by a Runge-Kutta method with matrix A and weights b,

    .. math:: (I^\theta V)_n = h_n^\theta A^\theta V_n + \sum_j w_j (1 + h_n x_j A)^{-1} 1 s_{n,j},
              \quad
              s_{n+1,j} = R(-h_n x_j) s_{n,j} + h_n x_j b^T (1 + h_n x_j A)^{-1} V_n.

    If all s and all V grow by the same constant, a derivative (theta < 0) does not change.
    """

    rates: Array  # x_j > 0, ascending, 1/time, shape (J,)
    weights: Array  # shape (n_terms, J)

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
    terms: Sequence[Term],
    *,
    shortest_step: float,
    final_time: float,
    stages: int,
    steps: float | None = None,
) -> Kernel:
    r"""Rates and weights of terms, for all meshes of certain steps.

    The stages are those of the Gauss method; Lobatto IIIC needs less. `steps` is
    ``shortest_step * sum(1 / h_n)``, if that is known; None: ``final_time / shortest_step``, which
    is not less. Kernels are shared for the powers of 2 next to the arguments.

    Notes
    -----
    The trapezoidal rule in u with :math:`\log x = u - e^{u_0 - u} + e^{u - u_1}` (for the lower
    end: McLean, *Exponential sum approximations for t^{-beta}*, 2018). Below 1/T the integrand is
    :math:`x^{-\theta}` times an analytic function of x, above K N / h (N = `steps`) it is
    :math:`x^{-\theta - 2}` times an analytic function of 1/x, because
    :math:`R(-z) = \pm \exp(-K/z + \ldots)`, K = 2 m (m + 1); there the substitution makes it
    fall doubly exponentially, and nodes at which x no longer differs from its limit are merged.

    A law whose density has a narrow peak at c, singular at a distance :math:`\delta` from the
    real axis, has equal steps of :math:`u + \sinh^{-1}((u - c) / \delta)` in place of u, in which
    that distance is more than :math:`\pi / 2`.
    """
    most = final_time / shortest_step if steps is None else float(steps)
    return _kernel(
        tuple(float(term) if isinstance(term, int | float) else term for term in terms),
        math.floor(math.log2(shortest_step)),
        math.ceil(math.log2(final_time)),
        math.ceil(math.log2(most)),
        stages,
    )


@lru_cache(maxsize=_CACHED_KERNELS)
def _kernel(terms: tuple[Term, ...], step: int, time: int, steps: int, stages: int) -> Kernel:
    """The kernel for a shortest step 2^step, a final time 2^time and a number of steps 2^steps."""
    # logarithms of rates between which the integrand is not a power of the rate
    first = -time * math.log(2)
    last = math.log(2 * stages * (stages + 1)) + (steps - step) * math.log(2)
    # a law without a peak is a sum of masses
    peaks = [one.peak for one in terms if _is_law(one) and one.peak is not None]
    smooth = [k for k, one in enumerate(terms) if not _is_law(one) or one.peak is not None]
    masses = [
        (index, rate, mass / rate)
        for index, one in enumerate(terms)
        for rate, mass in (one.masses if _is_law(one) else ())
    ]
    rule = _Rule(first, last, peaks)
    kept = rule.rates if smooth else np.zeros(0)
    rates = np.unique(np.concatenate([kept, [rate for _, rate, _ in masses]]))
    weights = np.zeros((len(terms), rates.size))
    for index in smooth:
        weights[index, np.searchsorted(rates, kept)] = _weights(terms[index], rule)
    for index, rate, weight in masses:
        weights[index, np.searchsorted(rates, rate)] += weight
    for one in (rates, weights):
        one.setflags(write=False)
    return Kernel(rates=rates, weights=weights)


def _is_law(term: Term) -> TypeGuard[RelaxationKernel]:
    return not isinstance(term, float)


class _Rule:
    """The trapezoidal rule for all terms, whose nodes far out are merged into those at its ends.

    Between the logarithms `first` and `last` densities per logarithm are no powers. At `peaks` of
    logarithms they bend, with the distance of their singularities from the real axis.
    """

    def __init__(self, first: float, last: float, peaks: Sequence[tuple[float, float]]) -> None:
        nearest, farthest = first - _ALIKE, last + _ALIKE
        below = max([0.0, *(first - place + _PEAK_MARGIN for place, _ in peaks)])
        above = max([0.0, *(place + _PEAK_MARGIN - last for place, _ in peaks)])
        first -= _ROOM * math.ceil(below / _ROOM)
        last += _ROOM * math.ceil(above / _ROOM)
        narrow = sorted({(place, size) for place, size in peaks if size < _WIDE})
        crowds = _PeakMap(tuple((_u_of(place, first, last), size) for place, size in narrow))
        # an end has no effect left at exp(-cut), in the units of x and, merged, of its least power
        cut = 3.0 - math.log(ACCURACY)
        tail = math.log(cut) + 0.5
        far = math.log(cut / (1.0 - LARGEST_EXPONENT)) + 0.5
        ends = np.array([first - far, first - tail, last + tail, last + far])
        lowest, origin, end, highest = crowds.stretched(ends)
        n_below, n_middle = math.ceil((origin - lowest) / WIDTH), math.ceil((end - origin) / WIDTH)
        n_above = math.ceil((highest - end) / WIDTH)
        nodes = origin + WIDTH * np.arange(-n_below, n_middle + n_above + 1)
        u, density = crowds.places(nodes)
        left, right = np.exp(first - u), np.exp(u - last)
        self.logs = u - left + right
        self._density = WIDTH * density * (1 + left + right)
        # peaks may lie at rates that overflow
        self._begin = max(n_below, int(np.searchsorted(self.logs, nearest)))
        self._end = min(n_below + n_middle + 1, int(np.searchsorted(self.logs, farthest)))
        self.rates = np.exp(self.split(self.logs)[1])

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """Values at merged nodes below, at kept nodes, and at merged ones above."""
        return values[: self._begin], values[self._begin : self._end], values[self._end :]

    def merge(self, below: Array, kept: Array, above: Array, factors: Array) -> Array:
        """Weights of the states, ``(J,)``, from factors of those of the three parts."""
        lower, middle, upper = self.split(factors * self._density)
        weights = middle * kept
        weights[0] += (lower * below).sum()
        weights[-1] += (upper * above).sum()
        return np.asarray(weights)


def _weights(term: Term, rule: _Rule) -> Array:
    """Weights of the states in the force of a term, ``(J,)``."""
    below, logs, above = rule.split(rule.logs)
    rates, first, last = rule.rates, rule.rates[0], rule.rates[-1]
    if not isinstance(term, float):
        return rule.merge(
            np.exp(term.log_density(below)) / first,
            np.exp(term.log_density(logs) - logs),
            np.exp(term.log_density(above) - 2 * above) * last,
            np.ones_like(rule.logs),
        )
    # sin(pi theta) / pi in full relative accuracy up to -1 and 1
    theta = term
    sine = math.copysign(math.sin(math.pi * min(abs(theta), 1 - abs(theta))), theta) / math.pi
    factors = np.full_like(rule.logs, sine)
    # powers of the rates themselves: exponentials of their logarithms would lose a digit
    return rule.merge(
        np.exp((1 - theta) * below) / first,
        rates**-theta,
        np.exp(-(1 + theta) * above) * last,
        factors,
    )


def _u_of(log_rate: float, first: float, last: float) -> float:
    """The u of a rate that lies well inside of the ends."""
    u = log_rate
    for _ in range(30):  # a fixed point: an iteration gains a factor of 10 or so
        u = log_rate + math.exp(first - u) - math.exp(u - last)
    return u


class _PeakMap:
    r"""The map :math:`w = u + \sum \sinh^{-1}((u - c) / \delta)`: equal w crowd around c."""

    def __init__(self, peaks: tuple[tuple[float, float], ...]) -> None:
        self._peaks = peaks

    def stretched(self, u: Array) -> Array:
        """The variable w of u."""
        return u + sum(np.arcsinh((u - place) / size) for place, size in self._peaks)

    def places(self, w: Array) -> tuple[Array, Array]:
        """The u of w, and du / dw."""
        if not self._peaks:
            return w, np.ones_like(w)
        reach = sum(np.arcsinh((np.abs(w) + abs(place)) / size) for place, size in self._peaks)
        low, high = w - reach, w + reach
        for _ in range(60):  # bisection: 53 halvings leave a unit round-off of the interval
            middle = 0.5 * (low + high)
            is_low = self.stretched(middle) < w
            low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
        u = 0.5 * (low + high)
        slope = 1 + sum(1 / np.hypot(u - place, size) for place, size in self._peaks)
        return u, np.asarray(1 / slope)
