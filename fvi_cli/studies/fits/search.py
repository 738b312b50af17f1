"""Least squares from a coarse scan, on more and more of the data.

The misfit of an oscillation has a valley for every phase that fits by chance; the valleys are the
narrower the more periods are measured. A short beginning of the data has only one valley. Its
minimum is then followed to longer and longer parts of the data.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import DataSet, FitParameter

REACH = 1.0
"""Number of decades on either side of their start over which positive parameters are scanned."""
MOST_ITERATIONS = 100
PATIENCE = 20
"""Most evaluations of a candidate on all data, before the best candidate is refined."""
FIRST_ITERATIONS = 7
"""Most evaluations of a candidate on a part of the data."""
SAME = 0.01
"""Candidates closer than this in every inner parameter count as one."""
ROUGH = 1e-3
"""Tolerance on a part of the data."""
HOPELESS = 30.0
"""Candidates with more than so many times the misfit of the best are dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A point at which least squares ended."""

    point: Array  # inner parameters
    cost: float
    is_converged: bool  # whether it is a minimum, as far as is known
    message: str


def least_squares_from(
    model: MotionModel,
    start: Array,
    bounds: tuple[Array, Array],
    *,
    most: int = MOST_ITERATIONS,
    tolerance: float = 1e-10,
) -> Found | None:
    """Gauss-Newton in a trust region, with exact derivatives; None: the start has no misfit.

    `tolerance` is that of the parameters, relative; the misfit may still change by its square.
    """
    from scipy.optimize import least_squares

    kept: dict[bytes, Evaluation] = {}

    def at(point: Array) -> Evaluation:
        key = point.tobytes()
        if key not in kept:
            kept.clear()
            try:
                kept[key] = model.evaluate(point)
            except ValueError:
                # no scene or no run at this point: the step was too long
                kept[key] = Evaluation(residuals=np.full(model.size, np.nan))
        return kept[key]

    def residuals(point: Array) -> Array:
        return at(point).residuals

    def jacobian(point: Array) -> Array:
        found = at(point).jacobian
        return np.zeros((model.size, point.size)) if found is None else found

    low, high = bounds
    begin = np.clip(start, _inside(low, high, 1e-9), _inside(high, low, 1e-9))
    if not np.isfinite(at(begin).residuals).all():
        return None
    with np.errstate(all="ignore"):
        done = least_squares(
            residuals,
            begin,
            jac=jacobian,
            bounds=bounds,
            x_scale="jac",
            xtol=tolerance,
            ftol=max(1e-13, 0.01 * tolerance),
            gtol=1e-14,
            max_nfev=most,
        )
    return Found(
        point=np.asarray(done.x, dtype=float),
        cost=float(2.0 * done.cost),
        is_converged=bool(done.status > 0),
        message=str(done.message).rstrip("."),
    )


def _inside(bound: Array, other: Array, share: float) -> Array:
    """A bound moved a little towards the other one."""
    width = np.where(np.isfinite(other - bound), other - bound, np.sign(other - bound))
    return np.where(np.isfinite(bound), bound + share * width, bound)


def search(model: MotionModel, bounds: tuple[Array, Array], scale: float) -> list[Found]:
    """Minima of the misfit, the best first."""
    parts = [MotionModel(model.model, data, model.deviations) for data in _windows(model)]
    for one in parts:
        one.loosen(1e-4 * scale)
    given = np.clip(model.start, *bounds)
    candidates = [given, *(np.clip(point, *bounds) for point in _scan(model.free, bounds))]
    costs = [_cost(parts[0], point) for point in candidates]
    order = np.argsort(costs, kind="stable")
    chosen = [candidates[index] for index in order[:3] if costs[index] < math.inf]
    if costs[0] < math.inf and not any(point is given for point in chosen):
        chosen.append(given)
    for one in parts[:-1]:
        found = distinct(
            least_squares_from(one, point, bounds, most=FIRST_ITERATIONS, tolerance=ROUGH)
            for point in chosen
        )
        chosen = [each.point for each in found[:3] if each.cost <= HOPELESS * found[0].cost]
    if not any(np.abs(point - given).max() <= SAME for point in chosen):
        chosen.append(given)
    return distinct(
        least_squares_from(parts[-1], point, bounds, most=PATIENCE, tolerance=ROUGH)
        for point in chosen
    )


def distinct(found: Iterable[Found | None]) -> list[Found]:
    """The points found, the best first, each minimum once."""
    kept: list[Found] = []
    for one in sorted((o for o in found if o is not None), key=lambda o: o.cost):
        if all(np.abs(one.point - other.point).max() > SAME for other in kept):
            kept.append(one)
    return kept


def _windows(model: MotionModel) -> list[list[DataSet]]:
    """Beginnings of the data, each twice as long as the one before, and all of them."""
    share = min(1.0, max(16, 4 * len(model.free) + 4) / model.size)
    found = []
    while share < 0.75:
        found.append([one.until(_time_of(one, share)) for one in model.data])
        share *= 3.0
    return [*found, list(model.data)]


def _time_of(data: DataSet, share: float) -> float:
    """The time up to which this share of all values was measured."""
    times = np.sort(np.concatenate([one.times for one in data.series]))
    return float(times[min(times.size, max(1, math.ceil(share * times.size))) - 1])


def _cost(model: MotionModel, point: Array) -> float:
    try:
        return model.evaluate(point, with_jacobian=False).cost
    except ValueError:
        return math.inf


def _scan(free: Sequence[FitParameter], bounds: tuple[Array, Array]) -> list[Array]:
    """Points spread evenly (Halton's sequence) over likely values."""
    from scipy.stats.qmc import Halton

    # the first point of the sequence is a corner
    shares = Halton(len(free), scramble=False).random(9 + 4 * len(free))[1:]
    low, high = bounds
    middle = np.array([one.inner(one.start) for one in free])
    is_positive = np.array([one.is_positive for one in free])
    reach = np.where(is_positive, math.log(10.0) * REACH, np.maximum(np.abs(middle), 1.0))
    is_bounded = ~is_positive & np.isfinite(high - low)
    begin = np.where(is_bounded, low, np.maximum(low, middle - reach))
    end = np.where(is_bounded, high, np.minimum(high, middle + reach))
    return list(begin + shares * (end - begin))
