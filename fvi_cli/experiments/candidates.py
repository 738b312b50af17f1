"""Methods among which one is chosen for a tolerance: what they are expected to err and to take.

Before anything is run, errors are guessed from the time scales of the scene. The first runs of one
method correct the guesses of all of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

from fvi_cli.effects.scene import Scene
from fvi_cli.experiments.experiment import Norm
from fvi_cli.integrator.expected_order import expected_order, smooth_order
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.resolution import Motion, Resolution

SINGULAR_CONSTANTS: Final = {1: 3e-2, 2: 4e-3, 3: 6e-4, 4: 1.6e-4}
"""Error over size t**2.5 of a Gauss method by its degree, measured at gamma = 1.5; for every power
more it is a quarter of that."""

LEAST_ORDER: Final = 0.5
"""Observed orders below this are not continued."""

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
    limits
        Order and size of the errors of a singular start about which the method does nothing.
    differences
        Norm of the difference between N and N/2 steps, by N.
    quickening
        By so much the motions seem to be quicker than was thought.
    enlargement
        By so much the errors of the start seem to be larger.
    """

    method: AnyMethod
    order: float
    motions: tuple[Motion, ...]
    limits: tuple[tuple[float, float], ...] = ()
    differences: dict[int, float] = field(default_factory=dict)
    quickening: float = 1.0
    enlargement: float = 1.0

    def guess(self, step_size: float, final_time: float) -> tuple[float, float]:
        """Error that is expected before anything is known, and its order."""
        constant = _smooth_constant(self.method, self.order)
        size = max((motion.amplitude for motion in self.motions), default=1.0)
        errors = [(0.0, self.order)]
        for motion in self.motions:
            per_step = min(self.quickening * motion.rate * step_size, 1e6)
            growth = max(1.0, 0.5 * motion.rate * final_time)
            error = motion.amplitude * growth * constant * per_step**self.order
            errors.append((min(error, size * 1e3), self.order))
        errors += [(self.enlargement * s * step_size**o, o) for o, s in self.limits]
        return max(errors)

    def learn(self, measured: Candidate, n_steps: int, final_time: float) -> None:
        """Correct the guess by what `measured` differs by on N and N/2 steps."""
        difference = measured.differences.get(n_steps, math.inf)
        guess, order = measured.guess(2.0 * final_time / n_steps, final_time)
        if not (0 < difference < math.inf and 0 < guess < math.inf):
            return
        if order == measured.order:
            self.quickening *= (difference / guess) ** (1.0 / order)
        else:
            self.enlargement *= difference / guess

    @property
    def lowest_order(self) -> float:
        """The order that is safe to expect for small steps."""
        return min([self.order, *(order for order, _ in self.limits)])

    def observed_order(self, n_steps: int) -> float:
        """Order between the differences at N/2 and N; nan where there are no two."""
        fine, coarse = self.differences.get(n_steps, 0.0), self.differences.get(n_steps // 2, 0.0)
        if n_steps % 2 or not (0 < fine < math.inf and 0 < coarse < math.inf):
            return math.nan
        return math.log2(coarse / fine)

    def estimate(self, n_steps: int) -> float:
        """Estimated error on N steps, from N against N/2.

        The difference itself, which is about the error on N/2 steps; where N/2 was compared with
        N/4 as well, Richardson's estimate by the lower of the observed and the expected order,
        times a caution.
        """
        difference = self.differences.get(n_steps, math.inf)
        order = self.observed_order(n_steps)
        if math.isnan(order):
            return difference
        order = min(order, self.lowest_order)
        if order < LEAST_ORDER:
            return math.inf if difference else 0.0
        extrapolated = difference / math.expm1(order * math.log(2.0))
        cautious = max(CAUTION * extrapolated, MOST_GAIN * difference)
        return min(max(difference, extrapolated), cautious)

    def predicted(self, n_steps: int, final_time: float) -> float:
        """Estimate that a run on N steps is expected to give, with all on N/2, N/4 done before."""
        finite = {n: d for n, d in self.differences.items() if math.isfinite(d)}
        if not finite:
            return self.guess(2.0 * final_time / n_steps, final_time)[0]
        last = max(finite)
        order = self.guess(final_time / last, final_time)[1]
        observed = self.observed_order(last)
        if not math.isnan(observed):
            order = max(LEAST_ORDER, min(observed, order))
        difference = finite[last] * (last / n_steps) ** order
        gain = CAUTION / math.expm1(min(order, self.lowest_order) * math.log(2.0))
        return float(difference * min(1.0, max(MOST_GAIN, gain)))


def usual_candidates(
    scene: Scene, methods: Sequence[AnyMethod], norm: Norm, resolution: Resolution
) -> list[Candidate]:
    """Candidates with what is expected of them; nothing is integrated."""
    motions = _capped(scene, resolution)
    found = []
    for method in methods:
        if not isinstance(method, Method) or method.cq != "gauss" or method.start == "weights":
            order = expected_order(scene, method, norm, max(16, resolution.least_steps))
            found.append(
                Candidate(method=method, order=2.0 if math.isnan(order) else order, motions=motions)
            )
            continue
        limits: tuple[tuple[float, float], ...] = ()
        if method.start == "none":
            constant = SINGULAR_CONSTANTS.get(method.degree, 1e-4)
            limits = tuple(
                (one.order, min(one.size, 1e300) * constant * 4.0 ** (2.5 - one.order))
                for one in resolution.singularities
            )
        found.append(
            Candidate(
                method=method, order=smooth_order(scene, method), motions=motions, limits=limits
            )
        )
    return found


def least_steps(method: AnyMethod, resolution: Resolution) -> int:
    """Number of steps from which on a method sees all that moves."""
    points = method.stages if isinstance(method, Method) else 1
    return max(resolution.least_steps, -(-resolution.forcing_points // points), 4)


def _capped(scene: Scene, resolution: Resolution) -> tuple[Motion, ...]:
    """The motions that a guess is made from, none of them larger than the solution."""
    modes = [m for m in resolution.motions if m.amplitude > 0 and m.rate * scene.final_time > 1]
    moves = [abs(float(x)) for x in scene.initial_position]
    size = max(
        [*moves, *(abs(float(v)) * scene.final_time for v in scene.initial_velocity), 1e-300]
    )
    found = [Motion(rate=m.rate, amplitude=m.amplitude) for m in modes]
    if resolution.forcing_points:
        rate = 1.5 * resolution.forcing_points / scene.final_time
        found.append(Motion(rate=rate, amplitude=max([size, *(m.amplitude for m in modes)])))
    return tuple(found) or (Motion(rate=2.0 / scene.final_time, amplitude=max(size, 1.0)),)


def _smooth_constant(method: AnyMethod, order: float) -> float:
    """Error of the phase over (omega h)**order per period; the Pade constant of Gauss methods."""
    if isinstance(method, Method) and method.cq == "gauss":
        m = method.degree
        return math.factorial(m) ** 2 / (math.factorial(2 * m) * math.factorial(2 * m + 1))
    return 1.0 / (order + 1.0)
