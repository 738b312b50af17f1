"""Intervals by profile likelihood: how far one parameter can go when all others follow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.studies.fits.model import Evaluation, MotionModel

Array = NDArray[np.float64]

CONFIDENCE = 0.95
CLOSE = 0.01
"""How close the root of the increase comes to its threshold, relative."""
ALMOST = 0.03
"""Share of the increase that may be left to gain when the other parameters have followed."""
MOST_TRIALS = 12
MOST_STEPS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One end of an interval.

    Parameters
    ----------
    end
        In what the fit works with; infinite where the data set no limit.
    is_bound
        Whether a bound of the parameter came first.
    points
        Values tried and roots of the increase there, ``(n, 2)``.
    """

    end: float
    is_bound: bool
    points: Array


def quantile(freedom: int, *, is_known: bool) -> float:
    """Of the normal distribution where the noise is known, otherwise of Student's."""
    from scipy.special import ndtri, stdtrit

    share = 0.5 + 0.5 * CONFIDENCE
    return float(ndtri(share) if is_known else stdtrit(freedom, share))


def profile_side(
    model: MotionModel,
    best: Array,
    at_best: Evaluation,
    index: int,
    step: float,
    limit: float,
    *,
    variance: float,
    threshold: float,
) -> Side:
    """One end of the interval of a parameter.

    Parameters
    ----------
    model, best, at_best
        What is fitted, and its minimum.
    index, step
        The parameter, and a first guess of the distance with its sign.
    limit
        Its bound on that side.
    variance
        Of the residuals.
    threshold
        What the root of the increase over the variance may reach.
    """
    sign = math.copysign(1.0, step)
    inner, root_inner = best[index], 0.0
    outer: float | None = None
    root_outer = math.inf
    point, points = best.copy(), []
    distance = abs(step)
    for _ in range(MOST_TRIALS):
        value = inner + sign * distance
        is_bound = sign * (value - limit) >= 0
        if is_bound:
            value = limit
        found = _others(model, best, at_best, point, index, value)
        root = math.inf
        if found is not None:
            root = math.sqrt(max(found[1] - at_best.cost, 0.0) / variance)
            points.append((value, sign * root))
        if abs(root - threshold) <= CLOSE * threshold:
            return Side(end=value, is_bound=False, points=np.array(points))
        if root < threshold:
            if is_bound:
                return Side(end=value, is_bound=True, points=np.array(points))
            inner, root_inner = value, root
            if found is not None:
                point = found[0]
        else:
            outer, root_outer = value, root
        if outer is None:
            growth = threshold / root if root > 0.25 * threshold else 4.0
            distance = abs(value - best[index]) * (min(growth, 4.0) - 1.0) * 1.02
        else:
            width = abs(outer - inner)
            share = 0.5
            if root_outer < math.inf:
                share = (threshold - root_inner) / (root_outer - root_inner)
            distance = width * min(max(share, 0.05), 0.95)
    if outer is None:
        return Side(end=sign * math.inf, is_bound=False, points=np.array(points))
    return Side(end=inner, is_bound=False, points=np.array(points))


def _others(
    model: MotionModel,
    best: Array,
    at_best: Evaluation,
    near: Array,
    index: int,
    value: float,
) -> tuple[Array, float] | None:
    """The point of least misfit with one parameter held, and its cost; None: there is none."""
    rest = np.delete(np.arange(best.size), index)
    low, high = model.bounds
    point = near.copy()
    point[index] = value
    if at_best.jacobian is not None and rest.size:
        # the others follow, to first order
        jacobian = at_best.jacobian
        slope = -np.linalg.lstsq(jacobian[:, rest], jacobian[:, index], rcond=None)[0]
        point[rest] = np.clip(near[rest] + slope * (value - near[index]), low[rest], high[rest])
    try:
        now = model.evaluate(point)
    except ValueError:
        return None
    for _ in range(MOST_STEPS):
        if now.jacobian is None or not rest.size:
            break
        move = np.asarray(
            -np.linalg.lstsq(now.jacobian[:, rest], now.residuals, rcond=None)[0], dtype=np.float64
        )
        gain = float(-move @ (now.jacobian[:, rest].T @ now.residuals))
        if gain <= ALMOST * max(now.cost - at_best.cost, 0.0) + 1e-12 * now.cost:
            # so close to the end the misfit is a parabola
            point[rest] = np.clip(point[rest] + move, low[rest], high[rest])
            return point, now.cost - gain
        better = _step(model, point, rest, move, now.cost, (low, high))
        if better is None:
            break
        point, now = better
    return point, now.cost


def _step(
    model: MotionModel,
    point: Array,
    rest: NDArray[np.intp],
    move: Array,
    cost: float,
    bounds: tuple[Array, Array],
) -> tuple[Array, Evaluation] | None:
    """A point in this direction with less misfit; None: there is none."""
    share = 1.0
    while share > 1e-3:
        trial = point.copy()
        trial[rest] = np.clip(point[rest] + share * move, bounds[0][rest], bounds[1][rest])
        try:
            after = model.evaluate(trial)
        except ValueError:
            share *= 0.25
            continue
        if after.cost < cost:
            return trial, after
        share *= 0.25
    return None
