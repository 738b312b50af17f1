"""Intervals by profile likelihood: how far a parameter can move if all others are adjusted."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.result import Estimate
from fvi_cli.studies.fits.search import Found, least_squares_from
from fvi_cli.studies.fits.statistics import Linearised

CONFIDENCE = 0.95
CLOSE = 0.01
"""Relative accuracy of the ends of intervals, and of the increase of the misfit there."""
MOST_STEPS = 12
"""Most steps, each twice as long as the last, by which an end is sought; .3 after a failure."""


def quantile(freedom: float) -> float:
    """Quantile of Student's t; of the normal distribution without bound."""
    from scipy.special import stdtrit

    return float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))


def estimates(model: MotionModel, best: Found, linear: Linearised) -> tuple[Estimate, ...]:
    """Every parameter with its interval."""
    found = []
    for index, one in enumerate(model.free):
        is_known = model.settings.is_known
        threshold = quantile(math.inf if is_known else float(linear.freedoms[index]))
        profile, error = Profile(model, best, index, threshold), float(linear.errors[index])
        low, high = math.nan, math.nan
        if linear.is_regular and not best.message:
            ends = profile.end(-threshold * error), profile.end(threshold * error)
            low = one.low if ends[0] == one.limits[0] else ends[0]
            high = one.high if ends[1] == one.limits[1] else ends[1]
        found.append(
            Estimate(
                name=one.key,
                value=float(best.point[index]),
                standard_error=error,
                low=low,
                high=high,
                profile=profile.points(),
            )
        )
    return tuple(found)


class Profile:
    """The increase of the misfit along one parameter, all others fitted anew."""

    def __init__(self, model: MotionModel, best: Found, index: int, threshold: float) -> None:
        self._model, self._best, self._index = model, best, index
        self._threshold, self.centre = threshold, float(best.point[index])
        self._found = {self.centre: best}  # minima by values of the parameter

    def points(self) -> Array:
        """Values that were tried and signed roots of the increase there, ``(n, 2)``."""
        every = sorted(self._found.items())
        return np.array([[at, math.copysign(self._root(o), at - self.centre)] for at, o in every])

    def excess(self, value: float) -> float:
        """How far the root of the increase exceeds its threshold; 0: close enough.

        Raises
        ------
        RunFailedError
            If the misfit cannot be computed there.
        """
        if value not in self._found:
            start = self._expected(value)
            found = least_squares_from(
                self._model, start, most=30, tolerance=3e-3, fixed=self._index
            )
            if found.message:
                raise RunFailedError(found.message)
            self._found[value] = found
        root = self._root(self._found[value])
        return 0.0 if abs(root / self._threshold - 1.0) <= CLOSE else root - self._threshold

    def _root(self, found: Found) -> float:
        return math.sqrt(max(found.at.cost - self._best.at.cost, 0.0))

    def _expected(self, value: float) -> Array:
        """Where the minimum for a value may lie, to first order."""
        index = self._index
        near = self._found[min(self._found, key=lambda one: abs(one - value))]
        others = np.delete(np.arange(near.point.size), index)
        jacobian, start = near.at.jacobian, near.point.copy()
        pushed = near.at.residuals + jacobian[:, index] * (value - start[index])
        start[others] -= np.linalg.lstsq(jacobian[:, others], pushed, rcond=None)[0]
        start = np.clip(start, *self._model.bounds)
        start[index] = value
        return np.asarray(start)

    def end(self, step: float) -> float:
        """The end of the interval in the direction of a first step.

        The limit, if it comes first; infinite where the data set no limit, nan where the misfit
        cannot be computed.
        """
        from scipy.optimize import brentq

        limit = self._model.free[self._index].limits[step > 0]
        inside, end = self.centre, math.copysign(math.inf, step)
        for _ in range(MOST_STEPS):
            value = inside + step
            value = limit if (value - limit) * step >= 0 else value
            try:
                excess = self.excess(value)
                if excess == 0.0 or (excess < 0.0 and value == limit):
                    return value
                if excess > 0.0:
                    width = abs(value - inside)
                    return float(brentq(self.excess, inside, value, xtol=CLOSE * width, rtol=1e-12))
                inside, step = value, 2.0 * step
            except RunFailedError:
                # neither inside nor outside: nearer values may tell
                step, end = 0.3 * step, math.nan
        return end
