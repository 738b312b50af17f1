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
        ends, reached = [math.nan] * 2, [float(best.point[index])] * 2
        points, bounds = [(float(best.point[index]), 0.0)], []
        for side, name in enumerate(("low", "high")):
            step = (2 * side - 1) * threshold * float(errors[index])
            limit = float(model.bounds[side][index])
            if is_profiled:
                profile = Profile(model, best, index, variance, threshold)
                ends[side] = profile.end(step, limit)
                reached[side] = profile.reached
                points += profile.points
            elif is_regular:
                end = points[0][0] + step
                ends[side] = limit if (end - limit) * step >= 0 else end
            if ends[side] == limit:
                ends[side] = getattr(one, name)
                bounds += [name] if math.isfinite(ends[side]) else []
            elif not math.isnan(ends[side]):
                ends[side] = one.outer(ends[side])
        tried = [[one.outer(at), root] for at, root in sorted(points)]
        found.append(
            Estimate(
                name=one.key,
                value=float(values[index]),
                standard_error=float(errors[index] * slopes[index]),
                low=ends[0],
                high=ends[1],
                at_bound="both" if len(bounds) == 2 else "".join(bounds),
                reached=(one.outer(reached[0]), one.outer(reached[1])),
                profile=np.array(tried),
            )
        )
    return tuple(found)


class Profile:
    """The increase of the misfit along one parameter, all others fitted anew."""

    def __init__(
        self, model: MotionModel, best: Found, index: int, variance: float, threshold: float
    ) -> None:
        self._model, self._best, self._index = model, best, index
        self._found = [best]  # minima at some values of the parameter
        self._variance, self._threshold = variance, threshold
        self.points: list[tuple[float, float]] = []  # values and signed roots of the increase
        self.reached = float(best.point[index])  # the farthest value known to lie inside

    def excess(self, value: float) -> float:
        """How far the root of the increase exceeds its threshold; 0: close enough.

        Raises
        ------
        RunFailedError
            If the misfit cannot be computed there.
        BetterMinimumError
            If it is less than at the minimum.
        """
        best, index = self._best, self._index
        centre = float(best.point[index])
        if value == centre:
            return -self._threshold
        near = min(self._found, key=lambda one: abs(float(one.point[index]) - value))
        if near.point[index] == value:
            return self._compared(near)
        start = self._expected(near, value)
        gain = 0.1 * self._threshold**2 * self._variance
        fit = partial(
            least_squares_from, self._model, most=30, tolerance=1e-8, gain=gain, fixed=index
        )
        try:
            found = fit(start)
        except RunFailedError:
            start = near.point.copy()
            start[index] = value
            found = fit(start)
        if found.message:
            raise RunFailedError(found.message)
        if found.cost < best.cost - BETTER * self._variance:
            raise BetterMinimumError(found.point)
        self._found.append(found)
        root = self._root(found)
        self.points.append((value, math.copysign(root, value - centre)))
        if root < self._threshold and abs(value - centre) > abs(self.reached - centre):
            self.reached = value
        return self._compared(found)

    def _root(self, found: Found) -> float:
        rise = found.cost - found.rest - self._best.cost
        return math.sqrt(max(rise, 0.0) / self._variance)

    def _compared(self, found: Found) -> float:
        root = self._root(found)
        return 0.0 if abs(root / self._threshold - 1.0) <= CLOSE else root - self._threshold

    def _expected(self, near: Found, value: float) -> Array:
        """Where the minimum for a value may lie: between two others, or to first order."""
        index, (low, high) = self._index, self._model.bounds
        place = float(near.point[index])
        beyond = [one for one in self._found if (one.point[index] - value) * (place - value) < 0]
        if beyond:
            other = min(beyond, key=lambda one: abs(float(one.point[index]) - value))
            share = (value - place) / (other.point[index] - place)
            start = near.point + share * (other.point - near.point)
        else:
            others = np.delete(np.arange(near.point.size), index)
            jacobian, start = near.at.jacobian, near.point.copy()
            pushed = near.at.residuals + jacobian[:, index] * (value - place)
            start[others] -= np.linalg.lstsq(jacobian[:, others], pushed, rcond=1e-7)[0]
            start = np.clip(start, low, high)
        start[index] = value
        return np.asarray(start)

    def end(self, step: float, limit: float) -> float:
        """The end of the interval in the direction of a first step; nan where it was not found."""
        from scipy.optimize import brentq

        centre = float(self._best.point[self._index])
        if not math.isfinite(step) or self._model.free[self._index].is_positive:
            step = math.copysign(min(abs(step), LONGEST), step)
        inside = centre
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
