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
    at_bound: str = ""
    """Ends of the interval that are bounds: ``low``, ``high``, ``both``, or empty."""
    reached: tuple[float, float] = (math.nan, math.nan)
    """The least and the largest value that are known to lie in the interval."""
    profile: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Values that were tried and signed roots of the increase of the misfit, ``(n, 2)``."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the interval."""
        found = []
        if self.at_bound:
            found.append(f"{self.name}: the interval ends at a bound ({self.at_bound})")
        sides = zip((self.low, self.high), ("below", "above"), self.reached, strict=True)
        for end, word, reached in sides:
            if math.isinf(end):
                found.append(f"{self.name}: the data do not bound it {word}")
            elif math.isnan(end):
                is_known = not math.isnan(reached) and reached != self.value
                known = f"; it reaches to {reached:.6g} at least" if is_known else ""
                found.append(f"{self.name}: the end of the interval {word} was not found{known}")
        return tuple(found)


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
    correlations: Array
    """Correlations of the estimates, ``(p, p)``."""
    evaluations: int
    message: str
    """Why the fit failed, or which parameters the data do not determine."""
    assignments: tuple[dict[str, float], ...]
    """For every data set the fitted values by key path."""
    series: tuple[SeriesFit, ...] = ()
    """The data and the residuals."""
    misfit: float = math.inf
    """Sum of squares over the variance of the noise."""
    criterion: float = math.inf
    """AICc: smaller is better."""
    whiteness: float = 1.0
    """Probability (Ljung and Box) of residuals as correlated as these if they were noise."""
    steps: int = 0
    discretisation: float = math.inf
    """Error of the runs, relative to the residuals."""
    others: tuple[tuple[float, ...], ...] = ()
    """Other minima that fit alike: values of the parameters."""
    is_converged: bool = False

    @property
    def n_values(self) -> int:
        """Number of measured values."""
        return sum(one.series.values.size for one in self.series)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the result, or the reason why there is none."""
        found = self._inseparable()
        if not self.is_converged:
            return tuple(found)
        for one in self.estimates:
            found += one.warnings
        for values in self.others:
            shown = ", ".join(
                f"{one.name} = {value:.6g}"
                for one, value in zip(self.estimates, values, strict=True)
            )
            found.append(f"another minimum fits as well: {shown}")
        found += self._of_noise()
        if self.whiteness < 0.001:
            found.append(
                f"the residuals are not noise (probability {self.whiteness:.1e}): the model is "
                "incomplete"
            )
        return tuple(found)

    def _inseparable(self) -> list[str]:
        """Pairs of parameters that the data hardly distinguish."""
        advice = "" if self.is_converged else "; if one of them is known, write it into the problem"
        found = []
        for i, one in enumerate(self.estimates):
            for j in range(i):
                value = self.correlations[i, j]
                if abs(value) > ALIKE:
                    gain = 1.0 / np.sqrt(max(1.0 - value**2, 1e-16))
                    found.append(
                        f"{self.estimates[j].name} and {one.name} can hardly be separated by "
                        f"these data: correlation {value:+.4f}; were one of them known, the error "
                        f"of the other would be {gain:.0f} times smaller"
                        f"{advice}"
                    )
        return found

    def _of_noise(self) -> list[str]:
        """Warnings where residuals contradict the noise that the configuration gives."""
        from scipy.special import chdtr, chdtrc

        freedom = self.n_values - len(self.estimates)
        # with estimated noise the misfit equals the degrees of freedom: it shows nothing
        if freedom < 1 or not math.isfinite(self.misfit) or self.misfit == freedom:
            return []
        ratio = math.sqrt(self.misfit / freedom)
        if chdtrc(freedom, self.misfit) < 0.001:
            return [
                f"the residuals are {ratio:.3g} times as large as the given noise: the "
                "intervals are too short; write noise: auto, or another model"
            ]
        if chdtr(freedom, self.misfit) < 0.001:
            return [
                f"the residuals are {ratio:.3g} times the given noise: the intervals are "
                "too long; write noise: auto"
            ]
        return []


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
