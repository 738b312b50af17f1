r"""Stability of a method over the plane of :math:`h^2 k / m` and :math:`\mu h^{2-\gamma} / m`.

A method has one stability region for each order :math:`\gamma` in this plane, as a method for
:math:`x' = \lambda x` has one in the plane of :math:`h \lambda`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.stability.determinants import LinearSystems, step_determinants
from fvi_cli.mathematics.arrays import Array, Integers
from fvi_cli.mathematics.zeros import UNDECIDED, count_zeros

GROWTH_LEVELS = (1e-3, 1e-2, 1e-1, 1.0)
"""Growth per step, as logarithms, between which a map distinguishes points of the plane."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityMap:
    """Which points of the plane a method is stable at, for one order of the damping."""

    method: AnyMethod
    order: float
    stiffness: Array  # values of h^2 k / m
    damping: Array  # and of mu h^(2 - gamma) / m
    # number of GROWTH_LEVELS that the worst mode exceeds, 0 where the method is stable, -1 where
    # that is not decided, (damping, stiffness)
    level: Integers

    @property
    def share_stable(self) -> float:
        """Share of the points that are stable."""
        return float((self.level == 0).mean())


def stability_map(
    method: AnyMethod, order: float, stiffness: Array, damping: Array
) -> StabilityMap:
    """Growth of the worst mode over the plane, for any method with a determinant."""
    across, up = (axis.ravel() for axis in np.meshgrid(stiffness, damping))
    forms = np.stack([np.ones_like(across), across, up], axis=1)[..., None, None]
    plane = step_determinants(LinearSystems(orders=(order,), forms=forms), method, 1.0)
    level, left = np.zeros(across.size, dtype=np.int64), np.arange(across.size)
    for number, growth in enumerate(GROWTH_LEVELS):
        counts = count_zeros(plane[left], math.exp(-growth))
        level[left[counts == UNDECIDED]] = UNDECIDED if number == 0 else number
        left = left[counts > 0]
        level[left] = number + 1
    return StabilityMap(
        method=method,
        order=order,
        stiffness=stiffness,
        damping=damping,
        level=level.reshape(damping.size, stiffness.size),
    )
