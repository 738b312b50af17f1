r"""Numerical inversion of Laplace transforms in many digits, to check faster routes against."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import mpmath
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_DEGREE = 60
POINTS_PER_RADIAN = 2.0
"""At this many nodes for every unit of t |Im s| the contour passes round a pole s by far."""


def talbot_inverse(
    transform: Callable[[mpmath.mpc], mpmath.mpc],
    times: Sequence[float],
    *,
    largest_frequency: float,
) -> Array:
    r"""Function whose Laplace transform is given, by the fixed contour of Talbot.

    .. math:: x(t) \approx \frac{r}{M} \Bigl[\tfrac12 e^{r t} X(r) + \sum_{k=1}^{M-1}
              \mathrm{Re}\, e^{t s_k} X(s_k) (1 + i \sigma_k)\Bigr], \qquad
              s_k = r \theta_k (\cot\theta_k + i), \quad \theta_k = k \pi / M, \quad r = 2 M / 5 t

    with :math:`\sigma = \theta + (\theta \cot\theta - 1) \cot\theta`, computed with M digits. The
    number of nodes grows with t, so that all poles stay on the left of the contour.

    No pole has an imaginary part above `largest_frequency`. J. Abate, P.P. Valko,
    *Multi-precision Laplace transform inversion*, Int. J. Numer. Meth. Engng 60 (2004), section 4.
    """
    return np.array([_value(transform, float(t), largest_frequency) for t in times])


def _value(
    transform: Callable[[mpmath.mpc], mpmath.mpc], time: float, largest_frequency: float
) -> float:
    if not 0 < time < math.inf:
        raise ValueError(f"times: {time!r} is not allowed; times must be positive")
    degree = LEAST_DEGREE + math.ceil(POINTS_PER_RADIAN * largest_frequency * time)
    with mpmath.workdps(degree):
        t = mpmath.mpf(time)
        radius = 2 * mpmath.mpf(degree) / (5 * t)
        total = mpmath.exp(radius * t) * transform(mpmath.mpc(radius)).real / 2
        for k in range(1, degree):
            angle = k * mpmath.pi / degree
            cotangent = mpmath.cot(angle)
            node = radius * angle * mpmath.mpc(cotangent, 1)
            slope = mpmath.mpc(1, angle + (angle * cotangent - 1) * cotangent)
            total += (mpmath.exp(t * node) * transform(node) * slope).real
        return float(total * radius / degree)
