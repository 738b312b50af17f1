"""Least squares from few starts, on more and more of the data.

The misfit of an oscillation has a valley for every phase that fits by chance; the valleys are the
narrower the more periods are measured. A short beginning of the data has only one valley. Its
minimum is then followed to longer and longer parts of the data.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.gradients.gradient import RunFailedError
from fvi_cli.mathematics.arrays import Array, Mask
from fvi_cli.studies.fits.model import Evaluation, MotionModel
from fvi_cli.studies.fits.settings import DataSet

REACH = 1.0
"""Number of decades on either side of their start over which positive parameters are scanned."""
SAME = 0.05
"""Candidates closer than this in every inner parameter count as one."""
ROUGH, FINE = 0.03, 1e-10
"""Tolerances of parameters on a part of the data, and of the estimates."""
ENOUGH = 1e-9
"""Share of the misfit below which a further gain is less than a hundredth of an error."""
LONGEST = 0.8
"""Largest share that a step takes from a positive parameter itself, not from its logarithm."""
MOST_DAMPED = 1e8
"""Damping of steps that no longer change anything."""
PRIMES = np.array([k for k in range(2, 400) if all(k % j for j in range(2, k))])


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """A point at which least squares ended."""

    point: Array  # inner parameters
    at: Evaluation
    message: str = ""  # why it may be no minimum
    rest: float = 0.0  # by how much the misfit may still fall

    @property
    def cost(self) -> float:
        """Sum of the squares."""
        return self.at.cost


def least_squares_from(
    model: MotionModel,
    start: Array,
    *,
    most: int = 100,
    tolerance: float = FINE,
    gain: float = 0.0,
    fixed: int = -1,
) -> Found:
    """Steps of Gauss and Newton within the bounds, damped where the misfit does not follow them.

    It ends where the misfit can fall by less than the square of `tolerance`, relative, or `gain`.
    The parameter of the number `fixed` is held.

    Raises
    ------
    RunFailedError
        If the start has no misfit.
    """
    low, high = model.bounds
    is_free = np.arange(start.size) != fixed
    point = np.where(is_free, np.clip(start, low, high), start)
    at, damping, before = model.evaluate(point), 0.0, None
    for _ in range(most):
        step, rest = _step(model, at, point, is_free)
        # the last step needs no check
        if rest < max(gain, ENOUGH * at.cost, tolerance**2 * at.cost) or damping > MOST_DAMPED:
            return Found(point=point, at=at, rest=rest)
        if damping:
            step, _ = _step(model, at, point, is_free, damping)
        # a modulus is linear where its logarithm is not
        is_linear = np.array([one.is_positive for one in model.free]) & (step < LONGEST)
        change = np.where(is_linear, np.log1p(-np.minimum(step, LONGEST)), -step)
        tried = np.where(is_free, np.clip(point + change, low, high), point)
        try:
            found = model.evaluate(tried)
            expected = found.cost - _step(model, found, tried, is_free)[1]
        except RunFailedError:
            # the step was too long
            found, expected = at, math.inf
        if found.cost < at.cost:
            point, at, damping, before = tried, found, 0.1 * damping * (damping > 1e-3), None
            continue
        # in a bent valley the step behind one that climbs may lead down
        if before is None and not damping and expected < at.cost - 0.5 * rest:
            before, point, at = (point, at), tried, found
            continue
        if before is not None:
            (point, at), before = before, None
        damping = max(10.0 * damping, 1e-2)
    return Found(point=point, at=at, message=f"no minimum was found in {most} steps")


def _step(
    model: MotionModel, at: Evaluation, point: Array, is_free: Mask, damping: float = 0.0
) -> tuple[Array, float]:
    """Minus the step to the minimum of the damped linear model, and how far the misfit falls."""
    low, high = model.bounds
    while True:
        jacobian = at.jacobian * is_free
        # a positive parameter that is nearly 0 has a small column, and may leave 0 all the same
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0.0] = 1.0
        rows = np.concatenate([jacobian / size, np.sqrt(damping) * np.eye(size.size)])
        right = np.concatenate([at.residuals, np.zeros(size.size)])
        step = np.linalg.lstsq(rows, right, rcond=1e-12)[0] / size
        outwards = is_free & (((point <= low) & (step > 0)) | ((point >= high) & (step < 0)))
        if not outwards.any():
            return step, float(np.sum((jacobian @ step) ** 2))
        is_free = is_free & ~outwards


def search(model: MotionModel, scale: float) -> Found:
    """The least minimum of the misfit that was found, roughly.

    Raises
    ------
    RunFailedError
        If every run near the starting values fails.
    """
    parts = [MotionModel(model.model, data, model.deviations) for data in _windows(model)]
    for one in parts:
        one.deviations = [
            d if isinstance(d, float) else d[:n]
            for d, n in zip(one.deviations, one.sizes, strict=True)
        ]
        one.loosen(1e-4 * scale)
    scan = _scan(model)
    costs = sorted((_cost(parts[0], point), number) for number, point in enumerate(scan))
    chosen = [model.start, *(scan[number] for cost, number in costs[:3] if cost < math.inf)]
    for one in parts:
        found = _minima(one, chosen, most=7 if one is not parts[-1] else 20)
        chosen = [each.point for each in found]
    return found[0]


def _minima(model: MotionModel, starts: Iterable[Array], most: int) -> list[Found]:
    """At most three minima from some starts, the best first, each once."""
    every, kept = list[Found](), list[Found]()
    for start in starts:
        with contextlib.suppress(RunFailedError):
            every.append(least_squares_from(model, start, most=most, tolerance=ROUGH))
    for one in sorted(every, key=lambda one: one.cost):
        if all(np.abs(one.point - other.point).max() > SAME for other in kept):
            kept.append(one)
    if not kept:
        raise RunFailedError("every run near the starting values fails")
    return kept[:3]


def _windows(model: MotionModel) -> list[list[DataSet]]:
    """Beginnings of the data, each three times as long as the one before, and all of them."""
    share = min(1.0, max(16, 4 * len(model.free) + 4) / sum(model.sizes))
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
    except RunFailedError:
        return math.inf


def _scan(model: MotionModel) -> list[Array]:
    """Points spread evenly over likely values, by multiples of irrational numbers."""
    count, (low, high) = len(model.free), model.bounds
    shares = np.outer(np.arange(1, 9 + 4 * count), np.sqrt(PRIMES[:count])) % 1.0
    is_positive = np.array([one.is_positive for one in model.free])
    reach = np.where(is_positive, math.log(10.0) * REACH, np.maximum(np.abs(model.start), 1.0))
    is_bounded = ~is_positive & np.isfinite(high - low)
    begin = np.where(is_bounded, low, np.maximum(low, model.start - reach))
    end = np.where(is_bounded, high, np.minimum(high, model.start + reach))
    return list(begin + shares * (end - begin))
