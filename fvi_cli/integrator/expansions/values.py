"""A vector series in fractional powers of time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.mathematics.series.power_series import PowerSeries

Array = NDArray[np.float64]

MOST_EXPONENTS: Final = 128


@dataclass(frozen=True, kw_only=True, eq=False)
class Expansion:
    r"""The vector series :math:`\sum_i a_i t^{\sigma_i} + O(t^Q)`.

    Parameters
    ----------
    exponents
        Increasing powers, shape ``(n,)``.
    coefficients
        The :math:`a_i`, shape ``(n, d)``.
    cutoff
        Q.
    """

    exponents: Array
    coefficients: Array
    cutoff: float

    @property
    def components(self) -> tuple[PowerSeries, ...]:
        """One scalar series for every component."""
        return tuple(
            PowerSeries(exponents=self.exponents, coefficients=column, cutoff=self.cutoff)
            for column in self.coefficients.T
        )
