"""Least squares from few starts, on more and more of the data.

The misfit of an oscillation has a valley for every phase that fits by chance; the valleys are the
narrower the more periods are measured. A short beginning of the data has only one valley. Its
minimum is then followed to longer and longer parts of the data.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import DataSet

SAME = 0.05
"""Minima closer than this, relative, in every parameter count as one."""
ROUGH, FINE = 0.03, 1e-10
"""Tolerances of parameters on a part of the data, and of the estimates."""
ENOUGH = 1e-9
"""Share of the misfit below which a further gain is less than a hundredth of an error."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A point at which least squares ended."""

    point: Array  # values of the parameters
    at: Evaluation
    message: str = ""  # why it may be no minimum


def least_squares_from(
    model: MotionModel,
    start: Array,
    *,
    most: int = 100,
    tolerance: float = FINE,
    fixed: int = -1,
) -> Found:
    """Gauss-Newton in a trust region, with exact derivatives, within the bounds.

    It ends where parameters change by `tolerance`, relative, or the misfit by its square. The
    parameter of the number `fixed` is held.

    Raises
    ------
    RunFailedError
        If the start has no misfit.
    """
    from scipy.optimize import least_squares

    known: dict[bytes, Evaluation] = {}
    free = np.delete(np.arange(start.size), [fixed] if fixed >= 0 else [])
    low, high = (one[free] for one in model.bounds)

    def at(point: Array) -> Evaluation:
        whole = start.copy()
        whole[free] = point
        if (key := whole.tobytes()) not in known:
            known[key] = model.evaluate(whole)
        return known[key]

    def residuals(point: Array) -> Array:
        try:
            return at(point).residuals
        except RunFailedError:
            # the step was too long
            return np.full(sum(model.sizes), np.nan)

    def jacobian(point: Array) -> Array:
        return at(point).jacobian[:, free]

    begin = np.clip(start[free], low, high)
    first = at(begin)
    whole, slopes = start.copy(), first.jacobian[:, free]
    whole[free] = begin
    # what the linear model promises may not be worth a step
    promised = slopes @ np.linalg.lstsq(slopes, first.residuals, rcond=None)[0]
    if promised @ promised <= tolerance**2 * first.cost:
        return Found(point=whole, at=first)
    with np.errstate(all="ignore"):
        done = least_squares(
            residuals,
            begin,
            jac=jacobian,
            bounds=(low, high),
            x_scale="jac",
            xtol=tolerance,
            ftol=max(ENOUGH, tolerance**2),
            gtol=1e-14,
            max_nfev=most,
        )
    whole[free] = done.x
    message = "" if done.status > 0 else str(done.message).rstrip(".")
    return Found(point=whole, at=at(done.x), message=message)


def search(model: MotionModel) -> Array:
    """The least minimum of the misfit that was found, roughly.

    Raises
    ------
    RunFailedError
        If every run near the starting values fails.
    """
    parts = [MotionModel(model.model, replace(model.settings, data=d)) for d in _windows(model)]
    scan = _scan(model)
    costs = [_cost(parts[0], point) for point in scan]
    best = [scan[number] for number in np.argsort(costs)[:1] if costs[number] < math.inf]
    chosen: list[Array] = [model.start, *best]
    for one in parts:
        chosen = _minima(one, chosen, most=7 if one is not parts[-1] else 20)
    return chosen[0]


def _minima(model: MotionModel, starts: Iterable[Array], most: int) -> list[Array]:
    """At most two minima from some starts, the best first, each once."""
    every, kept = list[Found](), list[Array]()
    for start in starts:
        with contextlib.suppress(RunFailedError):
            every.append(least_squares_from(model, start, most=most, tolerance=ROUGH))
    for one in sorted(every, key=lambda one: one.at.cost):
        if not any(np.allclose(one.point, other, rtol=SAME) for other in kept):
            kept.append(one.point)
    if not kept:
        raise RunFailedError("every run near the starting values fails")
    return kept[:2]


def _windows(model: MotionModel) -> list[tuple[DataSet, ...]]:
    """Beginnings of the data, each three times as long as the one before, and all of them."""
    data, found = model.settings.data, []
    share = max(16, 4 * len(model.free) + 4) / sum(model.sizes)
    while share < 0.75:
        found.append(tuple(one.beginning(share) for one in data))
        share *= 3.0
    return [*found, data]


def _cost(model: MotionModel, point: Array) -> float:
    try:
        return model.evaluate(point, with_jacobian=False).cost
    except RunFailedError:
        return math.inf


def _scan(model: MotionModel) -> Array:
    """Points over likely values: between the bounds, or a factor of ten around the start."""
    count, (low, high) = len(model.free), model.bounds
    shares = np.random.default_rng(0).uniform(size=(4 + 2 * count, count))
    with np.errstate(invalid="ignore"):
        between = low + shares * (high - low)
    near = np.clip(model.start * 10.0 ** (2.0 * shares - 1.0), low, high)
    return np.asarray(np.where(np.isfinite(between), between, near))
