"""The settings of an experiment for ``fvi fit``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.expressions import Expression

PARTS = ("magnitude", "phase", "real", "imaginary")
"""Parts of an amplitude that can be measured; phases in degrees."""
LEAST_SHARE, LARGEST_SHARE = 1e-12, 1e12
"""Positive parameters without bounds of their own stay between these shares of their start."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Amplitude:
    """A part of the complex amplitude of a response to harmonic forces."""

    row: Array
    """The linear form of the coordinates that was measured, shape ``(d,)``."""
    rate: int  # 0: the form itself; 1: its velocity; 2: its acceleration
    part: str
    """One of :data:`PARTS`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """A measured column."""

    name: str
    """What was measured: a coordinate, its name after ``v`` for a velocity, a quantity or an
    expression; for a response also one of :data:`PARTS`."""
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

    def until(self, time: float) -> DataSet:
        """The data of a motion up to a time, every series with one value at least."""
        if self.forces:
            return self
        kept = []
        for one in self.series:
            count = max(1, int(np.searchsorted(one.times, time, side="right")))
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
    def is_positive(self) -> bool:
        """Whether the inner parameter is the logarithm of the number."""
        is_wide = self.low >= 0 and self.start > 0 and self.high > 100 * max(self.low, 0.0)
        return is_wide and not self.key.endswith(".order")

    def inner(self, value: float) -> float:
        """The inner parameter, with which the fit works: the number, or its logarithm."""
        return math.log(value) if self.is_positive else value

    def outer(self, inner: float) -> float:
        """The number of an inner parameter."""
        return math.exp(min(inner, 700.0)) if self.is_positive else inner

    @property
    def inner_bounds(self) -> tuple[float, float]:
        """Bounds of the inner parameter."""
        if not self.is_positive:
            return self.low, self.high
        low = max(self.low, LEAST_SHARE * self.start)
        high = self.high if self.high < math.inf else LARGEST_SHARE * self.start
        return math.log(low), math.log(high)


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
