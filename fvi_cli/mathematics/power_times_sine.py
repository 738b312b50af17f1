r"""The fractional derivative of :math:`t^{b-1}\sin t`, by its power series."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LATEST_TIME = 8.0
_TERMS = 26


def derivative_of_power_times_sine(b: float, order: float, time: Array) -> Array:
    r"""Caputo derivative of :math:`t^{b-1}\sin t`, the function that saturates the paper's BDF-CQ.

    .. math:: D^\gamma t^{b-1}\sin t = \sum_{n\ge0} \frac{(-1)^n}{(2n+1)!}
              \frac{\Gamma(b+2n+1)}{\Gamma(b+2n+1-\gamma)}\,t^{b+2n-\gamma}

    Caputo's and the Riemann-Liouville derivative agree here, except for b = 1 and orders above 1:
    there Caputo's subtracts the slope 1 at 0, and the term n = 0 is absent.

    Parameters
    ----------
    b
        Exponent of the leading term: positive, and at least 1 for orders above 1.
    order
        Order of the derivative, in (0, 2).
    time
        Times in [0, 8]; beyond, the alternating series would cancel.

    Returns
    -------
    Array
        The derivative at every time, to a few units in the last place of its maximum where
        ``numpy.longdouble`` is longer than a double (elsewhere up to 1e-13 of it at t = 8). At
        t = 0 it is infinite if b < `order` and there is a term n = 0.

    Raises
    ------
    ValueError
        For arguments outside these ranges.
    """
    if not 0 < order < 2:
        raise ValueError(f"order: {order!r} is not allowed; it must lie in (0, 2)")
    smallest = 1.0 if order > 1 else 0.0
    if not (smallest <= b <= 100 and b > 0):
        raise ValueError(
            f"b: {b!r} is not allowed; it must be positive, at least {smallest:g}, and at most 100"
        )
    t = np.asarray(time, dtype=float)
    if np.any(t < 0) or np.any(t > LATEST_TIME):
        raise ValueError(f"time: all times must lie in [0, {LATEST_TIME:g}]")
    first = 1 if b == 1.0 and order > 1 else 0
    top = b + 2 * first + 1
    leading = (-1.0) ** first * math.gamma(top) / math.gamma(top - order)
    leading /= math.factorial(2 * first + 1)
    # Horner in extended precision: the series alternates, and its terms reach exp(t).
    square = t.astype(np.longdouble) ** 2
    total = np.ones(t.shape, dtype=np.longdouble)
    for n in range(_TERMS, first, -1):
        upper = np.longdouble(b) + 2 * n
        lower = upper - np.longdouble(order)
        ratio = upper * (upper - 1) / (lower * (lower - 1) * (2 * n) * (2 * n + 1))
        total = 1 - ratio * square * total
    with np.errstate(divide="ignore"):
        power = t ** (b + 2 * first - order)
    return np.asarray(leading * power * total.astype(float))
