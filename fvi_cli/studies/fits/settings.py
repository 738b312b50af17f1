"""What an experiment asks of ``fvi fit``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A measured coordinate or velocity.

    Parameters
    ----------
    name
        The coordinate, or ``v`` and its name for a velocity.
    column
        Where it stands in the file.
    component
        Number of the coordinate, from 0.
    is_velocity
        Whether it is a velocity.
    times, values
        Shape ``(n,)``, times increasing.
    """

    name: str
    column: str
    component: int
    is_velocity: bool
    times: Array
    values: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSet:
    """What was measured in one motion.

    Parameters
    ----------
    name
        Of the motion.
    series
        The columns.
    changes
        What is different from the problem of the experiment, by key path.
    """

    name: str
    series: tuple[Series, ...]
    changes: Mapping[str, float] = field(default_factory=dict)

    @property
    def last_time(self) -> float:
        """The latest time of a measurement."""
        return max(float(one.times[-1]) for one in self.series)

    @property
    def size(self) -> int:
        """Number of measured values."""
        return sum(one.values.size for one in self.series)

    def until(self, time: float) -> DataSet:
        """The data up to a time; every series keeps one value at least."""
        kept = []
        for one in self.series:
            count = max(1, int(np.searchsorted(one.times, time, side="right")))
            kept.append(
                Series(
                    name=one.name,
                    column=one.column,
                    component=one.component,
                    is_velocity=one.is_velocity,
                    times=one.times[:count],
                    values=one.values[:count],
                )
            )
        return DataSet(name=self.name, series=tuple(kept), changes=self.changes)


@dataclass(frozen=True, kw_only=True)
class FitParameter:
    """A number of the problem that is fitted, or follows one that is.

    Parameters
    ----------
    key
        Its key path, such as ``problem.damping.0.order``.
    start
        Where the search begins.
    low, high
        Its bounds.
    is_own
        Whether every data set has its own value.
    tied_to, factor
        It is `factor` times this parameter; empty: it is free.
    place
        Where it stands in the configuration, for complaints.
    """

    key: str
    start: float
    low: float = -math.inf
    high: float = math.inf
    is_own: bool = False
    tied_to: str = ""
    factor: float = 1.0
    place: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class FitModel:
    """One description that is fitted.

    Parameters
    ----------
    name
        Of a model among several; empty: the only one.
    specification
        The resolved ``problem`` mapping.
    parameters
        What is fitted.
    """

    name: str
    specification: Mapping[str, Any]
    parameters: tuple[FitParameter, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FitSettings:
    """What is fitted to what.

    Parameters
    ----------
    data
        The motions.
    models
        The descriptions, one or several to be compared.
    deviations
        Standard deviation of the noise by column; empty: it is estimated from what is left.
    """

    data: tuple[DataSet, ...]
    models: tuple[FitModel, ...]
    deviations: Mapping[str, float] = field(default_factory=dict)
