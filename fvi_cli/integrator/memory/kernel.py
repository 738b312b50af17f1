r"""Powers of integration and relaxation laws as integrals over rates: one set of rates for all.

For an operator I with :math:`(x + I^{-1})^{-1}` bounded for every x > 0, as integration in time
and its discretisation by a Runge-Kutta method on any mesh,

.. math:: I^\theta = \frac{\sin \pi\theta}{\pi} \int_0^\infty x^{-\theta} (x + I^{-1})^{-1} dx,
          \qquad 0 < \theta < 1

(Balakrishnan; Higham, *Functions of Matrices*, section 7), where
:math:`z = (x + I^{-1})^{-1} V` solves z' = -x z + V, z(0) = 0. For -1 < theta < 0 there is the
same integral over :math:`z - V/x`. All V before a step is its past, and the effect on the step is
:math:`\frac{\sin \pi\theta}{\pi} \int x^{-\theta} \ldots z\, dx` for both signs. For theta = 0 it
vanishes, and its derivative by theta is that of :math:`I^\theta \log I`.

The rates depend on the mesh and on relaxation laws with narrow spectra, never on exponents: terms
of all orders, their derivatives by the order and the members of a batch share their states.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeGuard

import numpy as np

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.integrator.memory.rates import RateRule, rate_rule
from fvi_cli.mathematics.arrays import Array

_CACHED_KERNELS = 256  # number of kernels that are kept in a process
LARGEST_EXPONENT = math.nextafter(1.0, 0.0)
"""Exponent of orders so small that 1 minus the order is 1; rates serve all exponents up to it."""


@dataclass(frozen=True)
class Slope:
    r"""The derivative :math:`I^\theta \log I` of a power of integration by its exponent."""

    exponent: float


Term = float | Slope | RelaxationKernel
"""An exponent in (-1, 1), the derivative by an exponent, or the kernel of a relaxation law."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernel:
    r"""Rates and weights of one or several terms.

    The states are the weighted means :math:`s_j = x_j z_j`, :math:`s_j' = x_j (v - s_j)`,
    :math:`s_j(0) = 0`, of the velocity v: none is larger than v has been, all have its unit,
    and all terms share them. The weights :math:`w_{kj}` with which they enter the force of term k
    are those of quadratures of :math:`\frac{\sin \pi\theta}{\pi} x^{-\theta - 1} dx` (time^theta,
    of the sign of theta), of the derivative of this by theta for a slope, of
    :math:`\rho(x) dx / x` for a law.

    Discretised by a Runge-Kutta method with matrix A and weights b,

    .. math:: (I^\theta V)_n = h_n^\theta A^\theta V_n + \sum_j w_j (1 + h_n x_j A)^{-1} 1 s_{n,j},
              \quad
              s_{n+1,j} = R(-h_n x_j) s_{n,j} + h_n x_j b^T (1 + h_n x_j A)^{-1} V_n.

    If all s and all V grow by the same constant, a derivative (theta < 0) does not change.
    """

    rates: Array  # x_j > 0, ascending, 1/time, shape (J,)
    weights: Array  # shape (n_terms, J)

    def __post_init__(self) -> None:
        self.rates.setflags(write=False)
        self.weights.setflags(write=False)

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
    accuracy: float = 1e-14,
) -> Kernel:
    r"""Rates and weights of terms, for all meshes of certain steps.

    The stages are those of the Gauss method; Lobatto IIIC needs less. `steps` is
    ``shortest_step * sum(1 / h_n)``, if that is known; None: ``final_time / shortest_step``, which
    is not less. The accuracy, 1e-15 to 0.1, is that of the weights of the history, relative to
    their size. Kernels are shared for the powers of 2 next to the arguments.

    Notes
    -----
    The trapezoidal rule in u with :math:`\log x = u - e^{u_0 - u} + e^{u - u_1}` (for the lower
    end: McLean, *Exponential sum approximations for t^{-beta}*, 2018). Below 1/T the integrand is
    :math:`x^{-\theta}` times an analytic function of x, above K N / h it is
    :math:`x^{-\theta - 2}` times an analytic function of 1/x, because
    :math:`R(-z) = \pm \exp(-K/z + \ldots)`, K = 2 m (m + 1); there the substitution makes it
    fall doubly exponentially, and nodes at which x no longer differs from its limit are merged.
    Rates that serve all exponents are up to a tenth more than rates for one exponent.

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
        accuracy,
    )


@lru_cache(maxsize=_CACHED_KERNELS)
def _kernel(
    terms: tuple[Term, ...], step: int, time: int, steps: int, stages: int, accuracy: float
) -> Kernel:
    """The kernel for powers of 2: shortest step, final time and number of steps."""
    # logarithms of rates between which the integrand is not a power of the rate
    first = -time * math.log(2)
    last = math.log(2 * stages * (stages + 1)) + (steps - step) * math.log(2)
    found = []
    chosen = [i for i, one in enumerate(terms) if _ends(one)]
    if chosen:
        own = [terms[i] for i in chosen]
        rule = rate_rule(
            sorted({end for term in own for end in _ends(term)}),
            first=first,
            last=last,
            accuracy=accuracy,
            peaks=[one.peak for one in own if _is_law(one) and one.peak is not None],
        )
        columns = np.zeros((len(terms), rule.n_kept))
        columns[chosen] = [_weights(one, rule) for one in own]
        found.append((rule.rates, columns))
    for index, one in enumerate(terms):
        for rate, mass in one.masses if _is_law(one) else ():
            column = np.zeros((len(terms), 1))
            column[index] = mass / rate
            found.append((np.array([rate]), column))
    rates, place = np.unique(np.concatenate([one for one, _ in found]), return_inverse=True)
    weights = np.zeros((len(terms), rates.size))
    np.add.at(weights.T, place, np.concatenate([columns for _, columns in found], axis=1).T)
    return Kernel(rates=rates, weights=weights)


def _is_law(term: Term) -> TypeGuard[RelaxationKernel]:
    return not isinstance(term, float | Slope)


def _ends(term: Term) -> tuple[tuple[float, float], ...]:
    """Powers of a density per logarithm at both ends: for all exponents, or for a law."""
    if not _is_law(term):
        return ((1 - LARGEST_EXPONENT,) * 2, (math.nextafter(2.0, 0.0),) * 2)
    return () if term.ends is None else (term.ends,)


def _weights(term: Term, rule: RateRule) -> Array:
    """Weights of the states in the force of a term, ``(J,)``."""
    if not isinstance(term, float | Slope):
        return rule.of_density(term.log_density)
    theta = term.exponent if isinstance(term, Slope) else term
    # sin(pi theta) / pi in full relative accuracy up to -1 and 1
    sine = math.copysign(math.sin(math.pi * min(abs(theta), 1 - abs(theta))), theta) / math.pi
    factors = np.full_like(rule.logs, sine)
    if isinstance(term, Slope):
        factors = math.cos(math.pi * theta) - sine * rule.logs
    return rule.of_power(theta, factors)
