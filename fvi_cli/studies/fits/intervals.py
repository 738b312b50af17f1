"""Estimates with their 95 % intervals, over all regions in which the motion is smooth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

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

JUMP = 1.0
"""The order at which a motion with a start velocity jumps."""


def estimates(
    minima: Sequence[Minimum],
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
    best, model = minima[0], minima[0].model
    _, errors, _ = covariance(best.evaluation, variance)
    ranks = freedoms(best.evaluation, model.sizes)
    if is_sought and not is_clean:
        _check_minimum(best, variance)
    found = []
    for index in range(len(model.free)):
        threshold = quantile(float(ranks[index]), is_known=is_known)
        rivals = [
            each
            for each in minima[1:]
            if each.evaluation.cost - best.evaluation.cost <= variance * threshold**2
        ]
        sides, is_over_jump = [], False
        for sign in (-1.0, 1.0):
            step = sign * threshold * errors[index]
            if is_clean:
                side = _by_curvature(best, index, step)
            elif not is_sought:
                side = Side(end=math.nan, reached=float(best.point[index]))
            else:
                side, is_rival = _farthest([best, *rivals], index, step, variance, threshold)
                is_over_jump |= is_rival
            sides.append(side)
        found.append(_estimate(best, index, sides, float(errors[index]), is_over_jump=is_over_jump))
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


def _farthest(
    minima: Sequence[Minimum], index: int, step: float, variance: float, threshold: float
) -> tuple[Side, bool]:
    """The farthest of the ends for all minima, and whether it is not that of the first minimum."""
    sign, least = math.copysign(1.0, step), minima[0].evaluation.cost
    sides = [
        profile_side(one, index, step, least=least, variance=variance, threshold=threshold)
        for one in minima
    ]
    lost = [one for one in sides if math.isnan(one.end)]
    chosen = max(lost or sides, key=lambda one: sign * (one.reached if lost else one.end))
    ends = [one.end for one in sides if not math.isnan(one.end)]
    if lost and any(sign * (end - chosen.reached) > 0 for end in ends):
        chosen = Side(end=math.nan, reached=max(ends, key=lambda end: sign * end))
    points = np.concatenate([one.points for one in sides])
    return replace(chosen, points=points), chosen is not sides[0]


def _estimate(
    best: Minimum, index: int, sides: Sequence[Side], error: float, *, is_over_jump: bool
) -> Estimate:
    one = best.model.free[index]
    ends, bounds, jumps = [], [], []
    for side, name in zip(sides, ("low", "high"), strict=True):
        end = math.nan if math.isnan(side.end) else one.outer(side.end)
        if side.is_bound:
            given = one.low if name == "low" else one.high
            searched = one.inner_bounds[name == "high"]
            if side.end != searched:
                end = JUMP
                jumps.append(name)
            else:
                # the search ended at the bound that was given; infinite: there is no limit
                end = given
                if math.isfinite(given):
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
        at_jump="both" if len(jumps) == 2 else "".join(jumps),
        over_jump=is_over_jump,
        reached=(one.outer(sides[0].reached), one.outer(sides[1].reached)),
        profile=np.column_stack([[one.outer(u) for u in tried[:, 0]], tried[:, 1]]),
    )
