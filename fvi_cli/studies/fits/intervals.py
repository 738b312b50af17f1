"""Estimates with their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fvi_cli.studies.fits.profile import (
    BETTER,
    BetterMinimumError,
    Minimum,
    Side,
    descend,
    profile_side,
    quantile,
)
from fvi_cli.studies.fits.result import Estimate
from fvi_cli.studies.fits.statistics import covariance, freedoms


def estimates(
    best: Minimum,
    variance: float,
    *,
    is_known: bool,
    is_clean: bool,
    is_sought: bool,
) -> tuple[Estimate, ...]:
    """Every parameter with its interval.

    Raises
    ------
    BetterMinimumError
        If the first point is no minimum.
    """
    model = best.model
    _, errors, _ = covariance(best.evaluation, variance)
    ranks = freedoms(best.evaluation, model.sizes)
    if is_sought and not is_clean:
        _check_minimum(best, variance)
    found = []
    for index in range(len(model.free)):
        threshold = quantile(float(ranks[index]), is_known=is_known)
        sides = []
        for sign in (-1.0, 1.0):
            step = sign * threshold * errors[index]
            if is_clean:
                side = _by_curvature(best, index, step)
            elif not is_sought:
                side = Side(end=math.nan, reached=float(best.point[index]))
            else:
                side = profile_side(best, index, step, variance=variance, threshold=threshold)
            sides.append(side)
        found.append(_estimate(best, index, sides, float(errors[index])))
    return tuple(found)


def _check_minimum(best: Minimum, variance: float) -> None:
    """Look for less misfit near a minimum: a search in logarithms may stop short of a zero.

    Raises
    ------
    BetterMinimumError
        If there is a point with less misfit.
    """
    cost = best.evaluation.cost
    found = descend(best, best.point, best.evaluation, -1, cost)
    if found.cost < cost - BETTER * variance:
        raise BetterMinimumError(found.point)


def _by_curvature(best: Minimum, index: int, step: float) -> Side:
    bound = float(best.bounds[int(step > 0)][index])
    end = float(best.point[index] + step)
    is_bound = math.copysign(1.0, step) * (end - bound) >= 0
    return Side(end=bound if is_bound else end, is_bound=is_bound)


def _estimate(best: Minimum, index: int, sides: Sequence[Side], error: float) -> Estimate:
    one = best.model.free[index]
    ends, bounds = [], []
    for side, name in zip(sides, ("low", "high"), strict=True):
        end = math.nan if math.isnan(side.end) else one.outer(side.end)
        if side.is_bound:
            # infinite: there is no limit
            end = one.low if name == "low" else one.high
            if math.isfinite(end):
                bounds.append(name)
        ends.append(end)
    tried = np.concatenate([sides[0].points, [[best.point[index], 0.0]], sides[1].points])
    tried = tried[np.argsort(tried[:, 0])]
    return Estimate(
        name=one.key,
        value=float(best.model.values(best.point)[index]),
        standard_error=error * float(best.model.slopes(best.point)[index]),
        low=ends[0],
        high=ends[1],
        at_bound="both" if len(bounds) == 2 else "".join(bounds),
        reached=(one.outer(sides[0].reached), one.outer(sides[1].reached)),
        profile=np.column_stack([[one.outer(u) for u in tried[:, 0]], tried[:, 1]]),
    )
