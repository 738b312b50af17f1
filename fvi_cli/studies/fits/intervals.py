"""Intervals by profile likelihood: how far a parameter can move if all others are adjusted."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import MotionModel
from fvi_cli.studies.fits.result import Estimate
from fvi_cli.studies.fits.search import Found, least_squares_from
from fvi_cli.studies.fits.statistics import covariance, freedoms

CONFIDENCE = 0.95
CLOSE = 0.01
"""Relative accuracy of the ends of intervals, and of the increase of the misfit there."""
REST = 0.1
"""Share of that increase which the linear model may take from the misfit that was computed."""
BETTER = 0.01
"""A misfit counts as another minimum if it is less by more than this share of the variance."""
LONGEST = 3.0
"""Longest first step of a logarithm, whose parameter may have no influence where it begins."""
MOST_STEPS = 12
"""Most steps, each 1.6 times as long as the last, by which an end is sought; .3 after a failure."""


class BetterMinimumError(ValueError):
    """A `point`, in inner parameters, has less misfit than the minimum."""

    def __init__(self, point: Array) -> None:
        super().__init__("another minimum has less misfit")
        self.point = point


def quantile(freedom: float, *, is_known: bool) -> float:
    """Quantile of the normal distribution where the noise is known, otherwise of Student's t."""
    from scipy.special import ndtri, stdtrit

    share = 0.5 + 0.5 * CONFIDENCE
    return float(ndtri(share) if is_known else stdtrit(freedom, share))


def estimates(
    model: MotionModel, best: Found, variance: float, *, is_known: bool, is_profiled: bool
) -> tuple[Estimate, ...]:
    """Every parameter with its interval, by the curvature of the misfit or by its profile.

    Raises
    ------
    BetterMinimumError
        If the first point is no minimum.
    """
    _, errors, is_regular = covariance(best.at, variance)
    ranks, found = freedoms(best.at, model.sizes), []
    values, slopes = model.values(best.point), model.slopes(best.point)
    for index, one in enumerate(model.free):
        threshold = quantile(float(ranks[index]), is_known=is_known)
        profile = Profile(model, best, index, variance, threshold)
        ends, bounds = [], []
        for name, sign, limits in zip(("low", "high"), (-1, 1), model.bounds, strict=True):
            step, limit = sign * threshold * float(errors[index]), float(limits[index])
            end = profile.end(step, limit) if is_profiled else profile.centre + step
            end = end if is_regular else math.nan
            if sign * (end - limit) >= 0:
                end = float(getattr(one, name))
                bounds += [name] if math.isfinite(end) else []
            else:
                end = one.outer(end)
            ends.append(end)
        found.append(
            Estimate(
                name=one.key,
                value=float(values[index]),
                standard_error=float(errors[index] * slopes[index]),
                low=ends[0],
                high=ends[1],
                at_bound="both" if len(bounds) == 2 else "".join(bounds),
                profile=np.array([[one.outer(at), root] for at, root in profile.points()]),
            )
        )
    return tuple(found)


class Profile:
    """The increase of the misfit along one parameter, all others fitted anew."""

    def __init__(
        self, model: MotionModel, best: Found, index: int, variance: float, threshold: float
    ) -> None:
        self._model, self._best, self._index = model, best, index
        self._variance, self._threshold = variance, threshold
        self._found = {float(best.point[index]): best}  # minima by values of the parameter
        self.centre = float(best.point[index])

    def points(self) -> list[tuple[float, float]]:
        """Values that were tried and signed roots of the increase there."""
        every = sorted(self._found.items())
        return [(at, math.copysign(self._root(one), at - self.centre)) for at, one in every]

    def excess(self, value: float) -> float:
        """How far the root of the increase exceeds its threshold; 0: close enough.

        Raises
        ------
        RunFailedError
            If the misfit cannot be computed there.
        BetterMinimumError
            If it is less than at the minimum.
        """
        if value not in self._found:
            self._found[value] = self._minimum(value)
        root = self._root(self._found[value])
        return 0.0 if abs(root / self._threshold - 1.0) <= CLOSE else root - self._threshold

    def _root(self, found: Found) -> float:
        rise = found.cost - found.rest - self._best.cost
        return math.sqrt(max(rise, 0.0) / self._variance)

    def _minimum(self, value: float) -> Found:
        near = self._found[min(self._found, key=lambda one: abs(one - value))]
        fit = partial(
            least_squares_from,
            self._model,
            most=30,
            tolerance=1e-8,
            gain=REST * self._threshold**2 * self._variance,
            fixed=self._index,
        )
        try:
            found = fit(self._expected(near, value))
        except RunFailedError:
            start = near.point.copy()
            start[self._index] = value
            found = fit(start)
        if found.message:
            raise RunFailedError(found.message)
        if found.cost < self._best.cost - BETTER * self._variance:
            raise BetterMinimumError(found.point)
        return found

    def _expected(self, near: Found, value: float) -> Array:
        """Where the minimum for a value may lie: between two others, or to first order."""
        index, place = self._index, float(near.point[self._index])
        beyond = [one for one in self._found if (one - value) * (place - value) < 0]
        if beyond:
            other = self._found[min(beyond, key=lambda one: abs(one - value))].point
            start = near.point + (value - place) / (other[index] - place) * (other - near.point)
        else:
            others = np.delete(np.arange(near.point.size), index)
            jacobian, start = near.at.jacobian, near.point.copy()
            pushed = near.at.residuals + jacobian[:, index] * (value - place)
            start[others] -= np.linalg.lstsq(jacobian[:, others], pushed, rcond=1e-7)[0]
            start = np.clip(start, *self._model.bounds)
        start[index] = value
        return np.asarray(start)

    def end(self, step: float, limit: float) -> float:
        """The end of the interval in the direction of a first step; nan where it was not found."""
        from scipy.optimize import brentq

        if not math.isfinite(step) or self._model.free[self._index].is_positive:
            step = math.copysign(min(abs(step), LONGEST), step)
        inside = self.centre
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
                inside, step = value, 1.6 * step
            except RunFailedError:
                # neither inside nor outside: nearer values may tell
                step *= 0.3
        return math.nan
