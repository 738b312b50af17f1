"""Works and energy balance of a run, as values."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Diagnostics:
    r"""Diagnostics on the grid of a trajectory of n points; None if they were not requested.

    Parameters
    ----------
    dissipated_work
        :math:`W_d(t) = \int_0^t v \cdot \sum_j \mu_j D^{\gamma_j} q`, shape ``(n,)``.
    forcing_work
        :math:`W_f(t) = \int_0^t v \cdot f`, less :math:`\int_0^t \partial_t L`, shape ``(n,)``.
    energy_defect
        :math:`E(t) - E(0) + W_d(t) - W_f(t)`, shape ``(n,)``.
    stored_energy
        Energy in the memory of the damping, shape ``(n,)``; methods with a sum of exponentials.
    """

    dissipated_work: Array | None = None
    forcing_work: Array | None = None
    energy_defect: Array | None = None
    stored_energy: Array | None = None

    def at(self, kept: NDArray[np.intp]) -> Diagnostics:
        """The diagnostics on some points of the grid."""
        found: dict[str, Any] = {
            name: one[kept] for name, one in vars(self).items() if isinstance(one, np.ndarray)
        }
        return replace(self, **found)


@dataclass(frozen=True, kw_only=True, eq=False)
class NewtonRecord:
    """Numbers of iterations of Newton."""

    iterations: int = 0  # total number of iterations
    largest: int = 0  # largest number of iterations in one step
