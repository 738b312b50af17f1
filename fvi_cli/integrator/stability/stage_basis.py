r"""Legendre coefficients in place of stage values, for the symbol of Runge-Kutta methods.

The parts of the powers of :math:`\Delta(z)` that join the mean of the stages and those that join
their differences are of different sizes near z = 1. With Legendre coefficients :math:`T V`
(Hairer, Wanner, *Solving Ordinary Differential Equations II*, section IV.5, "W-transformation")
each is rounded on its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class StageBasis:
    """Matrices between values at the stages and Legendre coefficients, shape ``(m, m)``."""

    to_coefficients: Array
    to_values: Array


def legendre_stages(nodes: Array) -> StageBasis:
    """Orthonormal Legendre polynomials on [0, 1] at the `nodes`: the first one is 1."""
    m = nodes.size
    scales = np.sqrt(2.0 * np.arange(m) + 1.0)
    values = legendre.legvander(2.0 * nodes - 1.0, m - 1) * scales
    return StageBasis(to_coefficients=np.linalg.inv(values), to_values=values)
