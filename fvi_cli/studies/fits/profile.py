"""Intervals by profile likelihood: how far one parameter can go when all others follow."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, MotionModel

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
    is_bound: bool = False
    points: Array = field(default_factory=lambda: np.zeros((0, 2)))


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
        found = _others(model, at_best, point, index, value)
        root = math.inf
        if found is not None:
            root = math.sqrt(max(found[1] - at_best.cost, 0.0) / variance)
            points.append((value, sign * root))
        if abs(root - threshold) <= CLOSE * threshold:
            return Side(end=value, points=np.array(points).reshape(-1, 2))
        if root < threshold:
            if is_bound:
                return Side(end=value, is_bound=True, points=np.array(points).reshape(-1, 2))
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
    end = sign * math.inf if outer is None else inner
    return Side(end=end, points=np.array(points).reshape(-1, 2))


def _others(
    model: MotionModel,
    at_best: Evaluation,
    near: Array,
    index: int,
    value: float,
) -> tuple[Array, float] | None:
    """The point of least misfit with one parameter held, and its cost; None: there is none."""
    low, high = model.bounds
    point = near.copy()
    if at_best.jacobian is not None:
        # the others follow, to first order
        pushed = at_best.jacobian[:, index] * (value - near[index])
        move = _followed(at_best.jacobian, pushed, point, index, (low, high))
        point = np.clip(near + move, low, high)
    point[index] = value
    try:
        now = model.evaluate(point)
    except ValueError:
        return None
    for _ in range(MOST_STEPS):
        if now.jacobian is None:
            break
        move = _followed(now.jacobian, now.residuals, point, index, (low, high))
        gain = float(-move @ (now.jacobian.T @ now.residuals))
        if gain <= ALMOST * max(now.cost - at_best.cost, 0.0) + 1e-12 * now.cost:
            # so close to the end the misfit is a parabola
            return np.clip(point + move, low, high), now.cost - gain
        better = _step(model, point, move, now.cost, (low, high))
        if better is None:
            break
        point, now = better
    return point, now.cost


def _followed(
    jacobian: Array, residuals: Array, point: Array, index: int, bounds: tuple[Array, Array]
) -> Array:
    """The step of Gauss and Newton of all parameters but one; those at a bound stay there."""
    free = np.delete(np.arange(point.size), index)
    move = np.zeros(point.size)
    while free.size:
        move[:] = 0.0
        move[free] = -np.linalg.lstsq(jacobian[:, free], residuals, rcond=None)[0]
        outwards = (point <= bounds[0]) & (move < 0) | (point >= bounds[1]) & (move > 0)
        if not outwards.any():
            break
        free = free[~outwards[free]]
        move[:] = 0.0
    return move


def _step(
    model: MotionModel,
    point: Array,
    move: Array,
    cost: float,
    bounds: tuple[Array, Array],
) -> tuple[Array, Evaluation] | None:
    """A point in this direction with less misfit; None: there is none."""
    share = 1.0
    while share > 1e-3:
        trial = np.clip(point + share * move, *bounds)
        try:
            after = model.evaluate(trial)
        except ValueError:
            share *= 0.25
            continue
        if after.cost < cost:
            return trial, after
        share *= 0.25
    return None
