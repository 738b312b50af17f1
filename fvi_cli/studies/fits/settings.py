"""The settings of an experiment for ``fvi fit``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

INSIDE = 1e-6
"""Distance from a bound at which a parameter counts as lying there, relative to the range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Amplitude:
    """A part of the complex amplitude of a response to harmonic forces."""

    row: Array
    """The linear form of the coordinates that was measured, shape ``(d,)``."""
    rate: int  # 0: the form itself; 1: its velocity; 2: its acceleration
    part: str
    """``magnitude``, ``phase`` in degrees, ``real`` or ``imaginary``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A measured column."""

    name: str
    """What was measured: a coordinate, its name after ``v`` for a velocity, a quantity or an
    expression; for a response also the part."""
    column: str  # its column in the file
    times: Array
    values: Array
    """Shape ``(n,)``; times (for a response frequencies) increase."""
    formula: Expression | None = None  # measured in a motion; by default what the name says
    quality: str = ""  # key of ``units`` that has its unit
    amplitude: Amplitude | None = None  # measured in a response


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSet:
    """Measurements of one motion, or of one response to harmonic forces."""

    name: str
    series: tuple[Series, ...]
    changes: Mapping[str, float] = field(default_factory=dict)
    """Values that differ from the problem of the experiment, by key path."""
    forces: tuple[str, ...] = ()
    """Harmonic forces of a response, as for ``fvi response``; empty: a motion was measured."""
    coordinates: tuple[str, ...] = ()  # names of the coordinates in formulas and forces

    @property
    def last_time(self) -> float:
        """The latest time of a measurement."""
        return max(float(one.times[-1]) for one in self.series)

    @property
    def size(self) -> int:
        """Number of measured values."""
        return sum(one.values.size for one in self.series)

    def beginning(self, share: float) -> DataSet:
        """The first part of the values of a motion, every series with one at least."""
        if self.forces:
            return self
        times = np.sort(np.concatenate([one.times for one in self.series]))
        last = times[min(self.size, max(1, math.ceil(share * self.size))) - 1]
        kept = []
        for one in self.series:
            count = max(1, int(np.searchsorted(one.times, last, side="right")))
            kept.append(replace(one, times=one.times[:count], values=one.values[:count]))
        return replace(self, series=tuple(kept))


@dataclass(frozen=True, kw_only=True)
class FitParameter:
    """A number of the problem that is fitted."""

    key: str
    """Its key path, such as ``problem.damping.0.order``."""
    start: float  # where the search begins
    low: float = -math.inf
    high: float = math.inf

    @property
    def limits(self) -> tuple[float, float]:
        """Where the search ends: a little inside of the bounds, where numbers are not yet 0."""
        width = self.high - self.low
        share = INSIDE * (width if width < math.inf else abs(self.start) or 1.0)
        return self.low + share, self.high - share


@dataclass(frozen=True, kw_only=True, eq=False)
class FitModel:
    """One model of the problem that is fitted."""

    name: str  # name of the model; empty: it is the only one
    specification: Mapping[str, Any]
    """The resolved ``problem`` mapping."""
    parameters: tuple[FitParameter, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class FitSettings:
    """The models, the data to which they are fitted, and the noise."""

    data: tuple[DataSet, ...]
    models: tuple[FitModel, ...]  # one model, or several to be compared
    # standard deviation of the noise, or that of each value relative to it; without both those of
    # the columns are estimated from the residuals
    deviation: float | None = None
    relative: float | None = None

    @property
    def is_known(self) -> bool:
        """Whether the noise is given."""
        return self.deviation is not None or self.relative is not None

    def deviations(self, series: Series) -> Array | float:
        """Those of the values of a series; where none is given, the size of the values."""
        if self.relative is not None:
            return self.relative * np.abs(series.values)
        return self.deviation or float(np.sqrt(np.mean(series.values**2))) or 1.0
