"""Results of a fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.settings import FitModel, FitSettings, Series

ALIKE = 0.99
"""Parameters whose estimates are correlated like this are hard to distinguish."""
UNLIKELY = 0.001
"""Probability below which residuals are said not to be noise."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """One parameter."""

    name: str
    """Key path of the parameter."""
    value: float
    standard_error: float = math.nan
    """The estimate, and the one that follows from the curvature of the misfit."""
    low: float = math.nan
    high: float = math.nan
    """The 95 % interval by profile likelihood; infinite where the data set no limit, nan where an
    end was not found."""
    profile: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Values that were tried and signed roots of the increase of the misfit, ``(n, 2)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesFit:
    """A measured column with its residuals and the fitted curve."""

    data: str
    series: Series
    residuals: Array
    """Model minus data, in the unit of the data, shape ``(n,)``."""
    deviation: float
    """Standard deviation of the noise, given or estimated."""
    curve: Array
    """Times and the fitted motion, shape ``(2, n)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelFit:
    """One model, fitted; the defaults stand for a fit that failed."""

    model: FitModel
    estimates: tuple[Estimate, ...]
    assignments: tuple[dict[str, float], ...]  # of every data set the values by key path
    message: str = ""  # why the fit failed, or that the data do not determine all parameters
    correlations: Array = field(default_factory=lambda: np.zeros((0, 0)))  # of estimates, (p, p)
    series: tuple[SeriesFit, ...] = ()
    criterion: float = math.inf  # AICc: smaller is better
    # probability (Ljung and Box) of residuals as correlated as these if they were noise
    whiteness: float = 1.0
    steps: int = 0
    discretisation: float = math.inf  # error of the runs, relative to the residuals
    is_converged: bool = False

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return sum(one.series.values.size for one in self.series)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What cannot be separated, and residuals that are not noise."""
        return tuple(filter(None, (self._inseparable(), self._not_noise())))

    def _inseparable(self) -> str:
        """The two parameters that the data distinguish least, if they hardly do."""
        lower = np.tril(self.correlations, -1)
        if np.abs(lower).max(initial=0.0) <= ALIKE:
            return ""
        i, j = np.unravel_index(np.argmax(np.abs(lower)), lower.shape)
        return (
            f"{self.estimates[j].name} and {self.estimates[i].name} can hardly be separated by "
            f"these data: correlation {float(lower[i, j]):+.4f}"
        )

    def _not_noise(self) -> str:
        """Residuals that are correlated."""
        if self.whiteness >= UNLIKELY:
            return ""
        chance = f"probability {self.whiteness:.1e}"
        return f"the residuals are not noise ({chance}): the model is incomplete"


@dataclass(frozen=True, kw_only=True, eq=False)
class FitResult:
    """All models of an experiment, fitted to the same data."""

    name: str
    settings: FitSettings
    models: tuple[ModelFit, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    """Labels of units for figures."""

    @property
    def best(self) -> ModelFit:
        """The model with the least AICc among those that converged, or among all."""
        able = [one for one in self.models if one.is_converged] or list(self.models)
        return min(able, key=lambda one: one.criterion)

    @property
    def is_converged(self) -> bool:
        """Whether a minimum was found for every model."""
        return all(one.is_converged for one in self.models)
