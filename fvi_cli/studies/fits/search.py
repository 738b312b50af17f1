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
from fvi_cli.mathematics.arrays import Array, Integers
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
SHORT = 0.3
"""Longest step after which the misfit may be larger, in inner parameters."""
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
    """Gauss-Newton in a trust region, with exact derivatives, within the bounds.

    It ends where parameters change by `tolerance`, relative, or the misfit by its square or by
    `gain`. The parameter of the number `fixed` is held.

    Raises
    ------
    RunFailedError
        If the start has no misfit.
    """
    from scipy.optimize import least_squares

    known: dict[bytes, Evaluation | None] = {}
    free = np.delete(np.arange(start.size), [fixed] if fixed >= 0 else [])
    low, high = (one[free] for one in model.bounds)
    begin = start.copy()
    # least squares begin inside of the bounds
    begin[free] = np.clip(start[free], _inside(low, high), _inside(high, low))

    def at(point: Array) -> Evaluation | None:
        whole = begin.copy()
        whole[free] = point
        key = whole.tobytes()
        if key not in known:
            try:
                known[key] = model.evaluate(whole)
            except RunFailedError:
                # the step was too long
                known[key] = None
        return known[key]

    def residuals(point: Array) -> Array:
        found = at(point)
        return np.full(sum(model.sizes), np.nan) if found is None else found.residuals

    def jacobian(point: Array) -> Array:
        found = at(point)
        assert found is not None
        return found.jacobian[:, free]

    first = at(begin[free])
    if first is None:
        raise RunFailedError("the run fails at the start of least squares")
    if not free.size:
        return Found(point=begin, at=first)
    # full steps as long as they do what the linear model says, or in a bent valley the short one
    # and the next do; the last one needs no check
    step, possible = _linear_step(first, free)
    for _ in range(most):
        if possible < max(gain, ENOUGH * first.cost, tolerance**2 * first.cost):
            return Found(point=begin, at=first, rest=possible)
        # a modulus is linear where its logarithm is not
        is_linear = np.array([one.is_positive for one in model.free])[free] & (step < LONGEST)
        change = np.where(is_linear, np.log1p(-np.minimum(step, LONGEST)), -step)
        tried = np.clip(begin[free] + change, _inside(low, high), _inside(high, low))
        found = at(tried)
        if found is None:
            break
        step, rest = _linear_step(found, free)
        expected = found.cost - (rest if np.abs(change).max() < SHORT else 0.0)
        if expected > first.cost - 0.5 * possible:
            break
        begin[free], first, possible = tried, found, rest
    with np.errstate(all="ignore"):
        done = least_squares(
            residuals,
            begin[free],
            jac=jacobian,
            bounds=(low, high),
            x_scale="jac",
            xtol=tolerance,
            ftol=max(ENOUGH, tolerance**2, gain / max(first.cost, 1e-300)),
            gtol=1e-14,
            max_nfev=most,
        )
    end, point = at(done.x), begin.copy()
    point[free] = done.x
    assert end is not None
    message = "" if done.status > 0 else str(done.message).rstrip(".")
    return Found(point=point, at=end, message=message)


def _linear_step(at: Evaluation, free: Integers) -> tuple[Array, float]:
    """The step to the minimum of the linear model, and by how much the misfit falls there."""
    jacobian = at.jacobian[:, free]
    # a positive parameter that is nearly 0 has a small column, and may leave 0 all the same
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0.0] = 1.0
    step = np.linalg.lstsq(jacobian / size, at.residuals, rcond=1e-12)[0] / size
    return step, float(np.sum((jacobian @ step) ** 2))


def _inside(bound: Array, other: Array, share: float = 1e-9) -> Array:
    """A bound moved a little towards the other one."""
    width = np.where(np.isfinite(other - bound), other - bound, np.sign(other - bound))
    return np.where(np.isfinite(bound), bound + share * width, bound)


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
