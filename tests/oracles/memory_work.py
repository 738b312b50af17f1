r"""Work of a fractional force along a motion that is known on a grid, by splines.

It does not use the integrators' own convolution quadrature, so that an energy balance drawn up
with it is a check from outside.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import fftconvolve
from scipy.special import beta, gamma

Array = NDArray[np.float64]
SPLINE_DEGREE = 5
FINE_POINTS = 24  # Gauss points for the moments of a step


def fractional_integral(order: float, step_size: float, values: Array) -> Array:
    r"""Riemann-Liouville integral of a function that is given on a uniform grid.

    .. math:: (J^a f)(t_n) = \frac{1}{\Gamma(a)} \int_0^{t_n} (t_n - s)^{a-1} f(s)\, ds

    of the quintic spline through f at t_k = k h, shape ``(N + 1, d)`` with N >= 5, exactly but for
    round-off: on every step the spline is a sum of powers, whose moments with the kernel are known.
    The error is O(h^6) for a smooth function.
    """
    n_steps = values.shape[0] - 1
    grid = np.arange(n_steps + 1, dtype=float)
    spline = make_interp_spline(grid, values, k=SPLINE_DEGREE)
    left = grid[:-1]
    total = np.zeros_like(values)
    factorial = 1.0
    for power in range(SPLINE_DEGREE + 1):
        factorial *= max(power, 1)
        # derivatives from the right, at the beginning of each step: the fifth jumps at grid points
        coefficients = spline(left, nu=power) / factorial
        weights = _moments(order, power, n_steps)
        total[1:] += fftconvolve(coefficients, weights[:, None], axes=0)[:n_steps]
    return np.asarray(total * (step_size**order / gamma(order)))


def work_along(force: Array, velocity: Array, step_size: float) -> Array:
    r"""Work :math:`\int_0^{t_n} F \cdot v\, dt` up to every grid point, by a quintic spline.

    Force and velocity of shape ``(N + 1, d)`` to ``(N + 1,)``.
    """
    power = (force * velocity).sum(axis=1)
    grid = step_size * np.arange(power.size, dtype=float)
    return np.asarray(make_interp_spline(grid, power, k=SPLINE_DEGREE).antiderivative()(grid))


def _moments(order: float, power: int, n_steps: int) -> Array:
    r"""Integral of :math:`(m - \tau)^{a-1} \tau^j` over the step, for m = 1..N."""
    nodes, weights = np.polynomial.legendre.leggauss(FINE_POINTS)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    distance = np.arange(1, n_steps + 1, dtype=float)
    kernel = (distance[:, None] - nodes) ** (order - 1.0)
    moments = kernel @ (weights * nodes**power)
    # the kernel is singular at the near end of the last step
    moments[0] = beta(power + 1.0, order)
    return np.asarray(moments)
