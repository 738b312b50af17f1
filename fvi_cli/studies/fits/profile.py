"""Intervals by profile likelihood: how far a parameter can move if all others are adjusted."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, MotionModel

CONFIDENCE = 0.95
CLOSE = 0.01
"""Relative accuracy with which the root of the increase of the misfit meets its threshold."""
ALMOST = 0.03
"""The other parameters are adjusted until another step would gain less than this share of the
increase."""
BETTER = 0.01
"""A misfit counts as another minimum if it is less by more than this share of the variance."""
NARROW = 0.01
"""Width of a bracket, relative to its distance from the estimate, at which its search ends."""
MOST_TRIALS = 24
MOST_STEPS = 15
FAR = 4.0
"""An increase of more than so many times the sought one is retried from another start."""
LONGEST = 3.0
"""Largest decrease of a logarithm in one step."""
RANK = 1e-7
"""Singular values of scaled derivatives below this count as zero in a step."""
DAMPING = (0.0, 1e-3, 0.1, 10.0, 1e3)
"""Damping of a step (Levenberg and Marquardt) for scaled derivatives, in the order of trial."""


class BetterMinimumError(ValueError):
    """A `point`, in inner parameters, has less misfit than the minimum."""

    def __init__(self, point: Array) -> None:
        super().__init__("another minimum has less misfit")
        self.point = point


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """One end of an interval."""

    end: float  # inner parameter; nan where it was not found
    is_bound: bool = False  # whether a bound of the parameter came first
    reached: float = math.nan  # the farthest value that is known to lie inside
    points: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """Values tried and signed roots of the increase there, ``(n, 2)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """A minimum of the misfit, where profiles begin."""

    model: MotionModel
    point: Array  # inner parameters
    evaluation: Evaluation
    bounds: tuple[Array, Array]  # of the inner parameters


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """The end of a search in which one parameter was fixed, or none."""

    point: Array  # inner parameters
    cost: float  # an upper bound of the misfit there
    is_minimum: bool
    jacobian: Array | None = None


def quantile(freedom: float, *, is_known: bool) -> float:
    """Quantile of the normal distribution where the noise is known, otherwise of Student's t."""
    from scipy.special import ndtri, stdtrit

    share = 0.5 + 0.5 * CONFIDENCE
    return float(ndtri(share) if is_known else stdtrit(freedom, share))


def profile_side(
    begin: Minimum, index: int, step: float, *, variance: float, threshold: float
) -> Side:
    """One end of the interval of a parameter.

    A value at which the misfit cannot be computed is neither inside nor outside.

    Raises
    ------
    BetterMinimumError
        If there is less misfit than at the minimum.
    """
    sign = math.copysign(1.0, step)
    best = float(begin.point[index])
    limit = float(begin.bounds[int(sign > 0)][index])
    least, inner, root_inner = begin.evaluation.cost, best, 0.0
    outer, root_outer, unknown = math.nan, math.nan, math.nan
    near = Followed(
        point=begin.point,
        cost=begin.evaluation.cost,
        is_minimum=True,
        jacobian=begin.evaluation.jacobian,
    )
    points: list[tuple[float, float]] = []
    distance, width = abs(step) if math.isfinite(step) else math.inf, math.inf

    def side(end: float, *, is_bound: bool = False) -> Side:
        found = np.array(points).reshape(-1, 2)
        return Side(end=end, is_bound=is_bound, reached=inner, points=found)

    def narrow(value: float) -> float:
        size = abs(value - best)
        return NARROW * (min(size, 1.0) if begin.model.free[index].is_positive else size)

    if inner == limit:
        return side(limit, is_bound=True)
    for _ in range(MOST_TRIALS):
        value = inner + sign * distance
        if sign * (value - limit) >= 0 or not math.isfinite(value):
            value = limit if math.isfinite(limit) else inner + sign * 1e3 * max(1.0, abs(inner))
        if not sign * (value - unknown) < 0 and not math.isnan(unknown):
            value = 0.5 * (inner + unknown)
        found = _others(begin, near, index, value, least, variance * threshold**2)
        if found is not None and found.cost < least - BETTER * variance:
            raise BetterMinimumError(found.point)
        root = math.nan
        if found is not None:
            root = math.sqrt(max(found.cost - least, 0.0) / variance)
        if found is None or (root > threshold and not found.is_minimum):
            unknown = value
            if abs(unknown - inner) <= narrow(unknown):
                break
            distance = 0.5 * abs(unknown - inner)
            continue
        points.append((value, sign * root))
        if abs(root - threshold) <= CLOSE * threshold and found.is_minimum:
            return side(value)
        if root < threshold:
            inner, root_inner, near = value, root, found
            if value == limit:
                return side(value, is_bound=True)
        else:
            outer, root_outer = value, root
        if math.isnan(outer):
            growth = threshold / root if root > 0.25 * threshold else 4.0
            distance = abs(value - best) * (min(growth, 4.0) - 1.0) * 1.02
        elif abs(outer - inner) <= narrow(outer):
            break
        else:
            share = (threshold - root_inner) / (root_outer - root_inner)
            is_slow = abs(outer - inner) > 0.5 * width
            width = abs(outer - inner)
            distance = width * (0.5 if is_slow else min(max(share, 0.05), 0.95))
    # the end lies before the value that is known to lie outside
    is_bracketed = not math.isnan(outer) and (
        math.isnan(unknown) or sign * (unknown - outer) > 0 or sign * (unknown - inner) < 0
    )
    return side(outer if is_bracketed else math.nan)


def _others(
    begin: Minimum, near: Followed, index: int, value: float, least: float, rise: float
) -> Followed | None:
    """The point of least misfit with one parameter fixed; None: no misfit could be computed."""
    starts = [near.point.copy()]
    if near.jacobian is not None:
        # adjust the others to first order
        pushed = near.jacobian[:, index] * (value - near.point[index])
        starts.insert(0, _moved(begin, near.point, near.jacobian, pushed, index)[0])
    best: Followed | None = None
    for point in starts:
        point[index] = value
        try:
            found = descend(begin, point, begin.model.evaluate(point), index, least)
        except ValueError:
            continue
        if best is None or found.cost < best.cost:
            best = found
        if best.cost - least <= FAR * rise:
            break
    return best


def descend(begin: Minimum, point: Array, now: Evaluation, index: int, least: float) -> Followed:
    """The least misfit near a point, by least squares within the bounds of a minimum.

    The parameter at `index` is fixed; -1: none is.
    """
    first = 0
    for _ in range(MOST_STEPS):
        if now.jacobian is None:
            break
        moved, gain = _moved(begin, point, now.jacobian, now.residuals, index)
        if gain <= ALMOST * max(now.cost - least, 0.0) + 1e-12 * now.cost:
            # so close to the end the misfit is a parabola
            return Followed(
                point=moved, cost=now.cost - gain, is_minimum=True, jacobian=now.jacobian
            )
        after: Evaluation | None = None
        for number in range(first, len(DAMPING)):
            trial = moved
            if number:
                damping = DAMPING[number]
                trial, _ = _moved(begin, point, now.jacobian, now.residuals, index, damping)
            try:
                after = begin.model.evaluate(trial)
            except ValueError:
                continue
            if after.cost < now.cost:
                first = max(0, number - 1)
                break
            after = None
        if after is None:
            # no step reduces the misfit: this is a minimum up to round-off
            return Followed(point=point, cost=now.cost, is_minimum=True, jacobian=now.jacobian)
        point, now = trial, after
    return Followed(point=point, cost=now.cost, is_minimum=False, jacobian=now.jacobian)


def _moved(
    begin: Minimum,
    point: Array,
    jacobian: Array,
    residuals: Array,
    index: int,
    damping: float = 0.0,
) -> tuple[Array, float]:
    """The point after a step of least squares within bounds, and how much misfit it should gain.

    The step of a positive parameter is computed for the parameter, not for its logarithm: so it can
    approach 0, and leave its neighbourhood, where the logarithm has no influence.
    """
    from scipy.optimize import lsq_linear

    free = np.delete(np.arange(point.size), index) if index >= 0 else np.arange(point.size)
    if not free.size:
        return point.copy(), 0.0
    is_positive = np.array([one.is_positive for one in begin.model.free])[free]
    low, high = ((bound - point)[free] for bound in begin.bounds)
    low = np.where(is_positive, np.expm1(np.maximum(low, -LONGEST)), low)
    high = np.where(is_positive, np.expm1(high), high)
    sizes = np.maximum(np.linalg.norm(jacobian[:, free], axis=0), 1e-300)
    left, upper = np.linalg.qr(jacobian[:, free] / sizes)
    rows = np.vstack([upper, math.sqrt(damping + RANK**2) * np.eye(free.size)])
    right = np.append(-(left.T @ residuals), np.zeros(free.size))
    room = (np.minimum(low, 0.0) * sizes, np.maximum(high, 0.0) * sizes + 1e-300)
    with np.errstate(all="ignore"):
        scaled = lsq_linear(rows, right, room, method="bvls", max_iter=10 * free.size).x
    gain = float(right @ right - np.sum((rows @ scaled - right) ** 2))
    move, moved = scaled / sizes, point.copy()
    moved[free] += np.where(is_positive, np.log1p(np.maximum(move, np.expm1(-LONGEST))), move)
    return np.clip(moved, *begin.bounds), max(gain, 0.0)
