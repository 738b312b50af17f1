"""Methods among which one is chosen for a tolerance: what they are expected to err and to take.

Before anything is run, errors are guessed from the time scales of the scene. The first runs of one
method correct the guesses of all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.planning.expected_order import expected_order, smooth_order
from fvi_cli.planning.resolution import Motion, Resolution, Singularity
from fvi_cli.studies.experiment import Norm

SINGULAR_CONSTANTS: Final = {1: 3e-2, 2: 4e-3, 3: 6e-4, 4: 1.6e-4}
"""Error over size t**2.5 of a Gauss method by its degree, measured at gamma = 1.5; for every power
more it is a quarter of that."""

FAR_TOO_LOW: Final = 20.0
"""Measured over guessed: more than this is no matter of constants."""

LEAST_GROWTH: Final = 0.2
LEAST_LEFT: Final = 1e-3
"""Least share of an amplitude by which a phase error counts, over the time and at its end."""

LEAST_ORDER: Final = 0.5
"""Observed orders below this are not continued."""

SPARE: Final = 1.5
"""An estimate by one difference is so many times the difference."""

CAUTION: Final = 4.0
MOST_GAIN: Final = 1 / 16
"""An estimate by observed orders is so many times the extrapolated error, and no smaller than this
share of the difference."""


@dataclass(kw_only=True, eq=False)
class Candidate:
    """One method with what is expected of it and what has been measured.

    Parameters
    ----------
    method
        The method.
    order
        Order on a smooth solution, or the whole order where `limits` is not known apart.
    motions
        Time scales.
    lowest_order
        Order on the grid that is safe to expect for small steps.
    limits
        Order and size of the errors of a singular start about which the method does nothing.
    differences
        Norm of the difference between N and N/2 steps, by N.
    norm
        In which errors are measured.
    quickening
        By so much the motions seem to be quicker than was thought.
    enlargement
        By so much the errors of the start seem to be larger.
    """

    method: AnyMethod
    order: float
    motions: tuple[Motion, ...]
    lowest_order: float
    limits: tuple[tuple[float, float], ...] = ()
    differences: dict[int, float] = field(default_factory=dict)
    norm: Norm = "max"
    quickening: float = 1.0
    enlargement: float = 1.0

    def guess(self, step_size: float, final_time: float) -> tuple[float, float]:
        """Error that is expected before anything is known, and its order."""
        constant = _smooth_constant(self.method, self.order)
        errors = [(0.0, self.order)]
        for motion in self.motions:
            per_step = min(self.quickening * motion.rate * step_size, 1e6)
            growth = lasting_growth(motion, final_time, self.norm)
            error = motion.amplitude * growth * constant * per_step**self.order
            errors.append((min(error, 1e200), self.order))
        errors += [(self.enlargement * s * step_size**o, o) for o, s in self.limits]
        return max(errors)

    def correction(self, n_steps: int, final_time: float) -> tuple[float, float]:
        """Factors of quickening and enlargement that make the guess what was measured.

        A guess that is far too low misses a quick motion: powers at the start are known better.
        """
        difference = self.differences.get(n_steps, math.inf)
        guess, order = self.guess(2.0 * final_time / n_steps, final_time)
        if not (0 < difference < math.inf and 0 < guess < math.inf):
            return 1.0, 1.0
        ratio = difference / guess
        if order == self.order:
            return ratio ** (1.0 / order), 1.0
        if ratio < FAR_TOO_LOW:
            return 1.0, ratio
        smooth, _ = replace(self, limits=()).guess(2.0 * final_time / n_steps, final_time)
        return (difference / smooth) ** (1.0 / self.order) if smooth > 0 else 1.0, 1.0

    def correct(self, quickening: float, enlargement: float) -> None:
        """Apply what was found out with one method to the guesses of this one."""
        self.quickening *= quickening
        self.enlargement *= enlargement

    def observed_order(self, n_steps: int) -> float:
        """Order between the differences at N/2 and N; nan where there are no two."""
        fine, coarse = self.differences.get(n_steps, 0.0), self.differences.get(n_steps // 2, 0.0)
        if n_steps % 2 or not (0 < fine < math.inf and 0 < coarse < math.inf):
            return math.nan
        return math.log2(coarse / fine)

    def estimate(self, n_steps: int) -> float:
        """Estimated error on N steps, from N against N/2.

        The difference, which is about the error on N/2 steps, with something to spare, for it is
        seen on every other point only. Where N/2 was compared with N/4 as well, Richardson's
        estimate by the lower of the observed and the expected order, times a caution.
        """
        difference = self.differences.get(n_steps, math.inf)
        order = self.observed_order(n_steps)
        if math.isnan(order):
            return SPARE * difference
        order = min(order, self.lowest_order)
        if order < LEAST_ORDER:
            return math.inf if difference else 0.0
        extrapolated = difference / math.expm1(order * math.log(2.0))
        cautious = max(CAUTION * extrapolated, MOST_GAIN * difference)
        return min(max(SPARE * difference, extrapolated), cautious)

    def predicted(self, n_steps: int, final_time: float) -> float:
        """Estimate that a run on N steps is expected to give, with all on N/2, N/4 done before."""
        finite = {n: d for n, d in self.differences.items() if math.isfinite(d)}
        if not finite:
            return SPARE * self.guess(2.0 * final_time / n_steps, final_time)[0]
        last = max(finite)
        order = self.guess(final_time / last, final_time)[1]
        observed = self.observed_order(last)
        if not math.isnan(observed):
            order = max(LEAST_ORDER, min(observed, order))
        difference = finite[last] * (last / n_steps) ** order
        gain = CAUTION / math.expm1(min(order, self.lowest_order) * math.log(2.0))
        return float(difference * min(SPARE, max(MOST_GAIN, gain)))


def lasting_growth(motion: Motion, final_time: float, norm: Norm) -> float:
    """By how much the phase error of a period counts, in amplitudes: it adds up, and dies out."""
    periods = 0.5 * motion.rate
    if norm == "final":
        left = math.exp(-min(motion.decay * final_time, 700.0))
        return max(periods * final_time * left, LEAST_LEFT)
    # t exp(-decay t) is largest at t = 1 / decay
    longest = min(final_time, 1.0 / motion.decay if motion.decay > 0 else math.inf)
    return max(periods * longest * math.exp(-min(1.0, motion.decay * final_time)), LEAST_GROWTH)


def usual_candidates(
    scene: Scene, methods: Sequence[AnyMethod], norm: Norm, resolution: Resolution
) -> list[Candidate]:
    """Candidates with what is expected of them; nothing is integrated."""
    motions = _guessed_motions(scene, resolution)
    found = []
    for method in methods:
        if not isinstance(method, Method) or method.cq != "gauss" or method.start == "weights":
            order = expected_order(scene, method, norm, max(16, resolution.least_steps))
            found.append(
                Candidate(
                    method=method,
                    order=2.0 if math.isnan(order) else order,
                    motions=motions,
                    lowest_order=2.0 if math.isnan(order) else order,
                    norm=norm,
                )
            )
            continue
        order = smooth_order(scene, method)
        quickest = max(m.rate for m in motions)
        is_free = norm == "final" and scene.forcing is None
        limits = tuple(
            _limit(one, method, quickest if is_free else None) for one in resolution.singularities
        )
        on_grid = min([order, *(one.order for one in resolution.singularities)])
        is_carried = method.start == "graded"
        found.append(
            Candidate(
                method=method,
                order=order,
                motions=motions,
                limits=() if is_carried else limits,
                lowest_order=order if is_carried else on_grid,
                norm=norm,
            )
        )
    return found


def _limit(one: Singularity, method: Method, rate: float | None) -> tuple[float, float]:
    """Order and size of the error that a singular start leaves, on the grid and at the end.

    A free motion has twice the order at its end; what stands in place of h there is guessed from
    its quickest rate.
    """
    constant = SINGULAR_CONSTANTS.get(method.degree, 1e-4) * 4.0 ** (2.5 - one.order)
    size = min(one.size, 1e300) * constant
    return (one.order, size) if rate is None else (2.0 * one.order, size * rate**one.order)


def least_steps(method: AnyMethod, resolution: Resolution) -> int:
    """Number of steps from which on a method sees all that moves."""
    points = method.stages if isinstance(method, Method) else 1
    return max(resolution.least_steps, -(-resolution.forcing_points // points), 4)


def _guessed_motions(scene: Scene, resolution: Resolution) -> tuple[Motion, ...]:
    """The motions that guesses are made from: modes, layers, and the force with its features."""
    found = [m for m in resolution.motions if m.amplitude > 0 and m.rate * scene.final_time > 1]
    size = float(np.abs(scene.initial_position).max())
    size = max(size, float(np.abs(scene.initial_velocity).max()) * scene.final_time)
    if resolution.forcing_points:
        rate = 1.5 * resolution.forcing_points / scene.final_time
        found.append(Motion(rate=rate, amplitude=max([size, *(m.amplitude for m in found)])))
    return tuple(found) or (Motion(rate=2.0 / scene.final_time, amplitude=size or 1.0),)


def _smooth_constant(method: AnyMethod, order: float) -> float:
    """Error of the phase over (omega h)**order per period; the Pade constant of Gauss methods."""
    if isinstance(method, Method) and method.cq == "gauss":
        m = method.degree
        return math.factorial(m) ** 2 / (math.factorial(2 * m) * math.factorial(2 * m + 1))
    return 1.0 / (order + 1.0)
