r"""The far past of backward differences as exponentials of the lag.

The weights on differences are the coefficients of :math:`\gamma_p(z)^\gamma / (1 - z)`, with the
symbol :math:`\gamma_p` of the formula of order p. Cauchy's integral around the cuts of that
function is one over the cut from its branch point z = 1 and others from the zeros of
:math:`\gamma_p(z) / (1 - z)`, whose part falls like :math:`|z_j|^{-n}` with the lag n. So behind
some lags

.. math:: w_n = \frac{\sin \pi\gamma}{\pi} \int_0^\infty
          \frac{|\gamma_p(e^y)|^\gamma}{e^y - 1} e^{-n y} \, dy

to round-off. At small y the density is that of the fractional integral, :math:`y^{\gamma - 1}`
times an analytic function, and the rates of :mod:`fvi_cli.integrator.memory.kernel` serve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.memory.kernel import power_kernel
from fvi_cli.mathematics.arrays import Array

NEAR_LAGS = {1: 64, 2: 64, 3: 64, 4: 64, 5: 128, 6: 256}
"""From this lag on the weights are exponentials, by the order p: the zeros of the symbol beside
z = 1 are at :math:`|z_j| \\geq` 3, 2.3, 1.8 (p = 2, 3, 4), 1.41 and 1.158."""
_GONE = 45.0
"""An exponential that has fallen by this many e-folds at that lag is left out."""
_ACCURACY = 1e-15


@dataclass(frozen=True, kw_only=True, eq=False)
class LagExponentials:
    r"""Weights :math:`w_n = \sum_j c_j e^{-n y_j}` for lags :math:`n \geq` `near`."""

    near: int  # first lag from which they hold
    rates: Array  # y_j per step, ascending, shape (J,), the same for all orders
    factors: Array  # c_j for every order of differentiation, shape (n_orders, J)


def lag_exponentials(
    bdf_order: int, orders: Sequence[float], n_steps: int, *, writes_out: bool = False
) -> LagExponentials:
    """Lags to remember one by one on N equal steps, and exponentials behind them.

    For orders in (0, 2), whole ones among them, whose weights end, N + 1 weights of steps of length
    1, to 5e-14 of each; without rates where none lies behind the near ones, or every sum is written
    out.
    """
    near = NEAR_LAGS[bdf_order]
    fractional = [order for order in orders if order != 1.0]
    if writes_out or not fractional or n_steps <= near:
        # the weights of order 1 end
        near = n_steps if fractional else min(bdf_order, n_steps)
        return LagExponentials(near=near, rates=np.zeros(0), factors=np.zeros((len(orders), 0)))
    kernel = power_kernel(
        [1.0 - order for order in fractional],
        shortest_step=1.0,
        final_time=float(n_steps + 1),
        stages=1,
        steps=1.0,
        accuracy=_ACCURACY,
    )
    count = int(np.searchsorted(kernel.rates, _GONE / near, side="right"))
    rates = kernel.rates[:count]
    beyond = np.expm1(rates)
    symbol = -sum((-beyond) ** k / k for k in range(1, bdf_order + 1))
    weights = iter(kernel.weights[:, :count])
    factors = np.zeros((len(orders), count))
    for place, order in enumerate(orders):
        if order != 1.0:
            # the weights of the kernel are those of y**(gamma - 2)
            factors[place] = next(weights) * rates**2 / beyond * (symbol / rates) ** order
    return LagExponentials(near=near, rates=rates, factors=factors)


__all__ = ["LagExponentials", "lag_exponentials"]
