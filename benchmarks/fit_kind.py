"""What data of one kind are: a problem, its true numbers, and measurements without noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvi_cli.studies.fits.settings import DataSet, FitModel, FitParameter, Series

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind:
    """Data of one kind with the true numbers.

    Parameters
    ----------
    problem
        The ``problem`` mapping of the truth.
    free
        Key paths below ``problem`` with their true values; with ``@`` those of one data set.
    data
        What is measured without noise.
    deviations
        Of the noise of every series.
    name
        Of the kind.
    """

    problem: Mapping[str, Any]
    free: Mapping[str, float]
    data: tuple[DataSet, ...]
    deviations: tuple[float, ...]
    name: str = ""

    @property
    def series(self) -> list[Series]:
        """All series."""
        return [one for each in self.data for one in each.series]

    @property
    def truth(self) -> Array:
        """The true numbers."""
        return np.array(list(self.free.values()))

    @property
    def model(self) -> FitModel:
        """What is fitted, from near the truth."""
        found: dict[str, FitParameter] = {}
        for name, value in self.free.items():
            key = f"problem.{name.partition('@')[0]}"
            is_order = key.endswith("order")
            found[key] = FitParameter(
                key=key,
                start=value if value else 0.1,
                low=0.05 if is_order else 0.0,
                high=(0.99 if "law" in str(self.problem) else 1.95) if is_order else np.inf,
                is_own="@" in name,
            )
        return FitModel(name="", specification=self.problem, parameters=tuple(found.values()))
