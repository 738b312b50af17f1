"""A run for a tolerance: steps by a local one, the error of the whole by a second run.

A run with m stages finds its steps by a local tolerance; one with two stages more on the same mesh
tells how far it is from the truth, and is the one that is delivered. Formulas with kinks, whose
places are points of the mesh, and those of which walls and pulses are made are run on an unrelated
mesh as well. Forces by samples have the samples as points of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.local_error.forces import SceneForces
from fvi_cli.integrator.trajectory import Assessment, Outcome, Trajectory
from fvi_cli.studies.tolerance.differences import (
    EPSILON,
    between_points,
    growth_of,
    local_errors,
    on_other_mesh,
    on_same_mesh,
    round_off,
)
from fvi_cli.studies.tolerance.runs import (
    MOST_KINKED_STEPS,
    MOST_STEPS,
    AdaptiveRuns,
    knot_mesh,
    knots_of,
    run_on,
)
from fvi_cli.studies.tolerance.scales import likely_amplitude

Array = NDArray[np.float64]

MOST_ROUNDS: Final = 10
FEW_DIGITS: Final = 5.0
"""Up to so many digits 6 stages are taken, 8 beyond."""
ROUGHLY: Final = 100.0
"""The first run aims at so many tolerances: it tells how loose the second one may be."""
LEAST_GAIN: Final = 0.03
"""Least share of a difference by which the better of two runs is thought to err."""
SAMPLED_GAIN: Final = 0.3
"""The same of two stages more on the samples of a record, where the slope of the force jumps."""
CAUTION: Final = 10.0
"""In what local errors tell of the errors of two runs."""
LOOSE: Final = 100.0
POWER: Final = 1.3
"""The error of the delivered run is below (local tolerance)^1.3 / 100, relative to the motion."""
COARSEST: Final = 0.01
"""No local tolerance is larger than this share of the motion."""
STEEPNESS: Final = 1.25
"""An error that is to fall by a factor takes a local tolerance smaller by this power of it."""
AIMED_AT: Final = 0.2
"""Share of the tolerance at which a new local tolerance aims."""
STILL: Final = 0.3
"""An error of more than this share of the one before has not fallen."""
LEAP: Final = 0.01
"""Factor of the local tolerance where less of it has not helped."""
BY_ACCIDENT: Final = 0.2
"""Share of the tolerance that is demanded of an error that does not fall with the steps."""
UNRELATED: Final = 0.3
"""Local tolerance of the run on an unrelated mesh, relative to the first one."""
SENSITIVE: Final = 1e3
"""Differences that grow by more than this in a run make it unreliable."""
MOST_PER_INTERVAL: Final = 64
FAR: Final = 1e3
"""Errors of so many tolerances are not mended by two stages more."""
PER_HALVING: Final = 16.0
"""What an error falls by when steps between samples are halved, after jumps of the slope."""
SHORTER_START: Final = 1e-12
"""First step for motions that begin more steeply than usual, relative to T."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Round:
    """A run with what another one says of its error: differences at times, and shares of them."""

    run: Trajectory
    line: str
    times: Array = field(default_factory=lambda: np.zeros(1))
    differences: Array = field(default_factory=lambda: np.array([math.inf]))
    at_points: float = math.inf
    between: float = math.inf

    @property
    def estimate(self) -> float:
        return max(self.at_points, self.between) if self.run.status == "ok" else math.inf

    @property
    def amplitude(self) -> float:
        found = float(np.abs(self.run.position).max())
        return found if math.isfinite(found) else 0.0


def solve(
    scene: Scene,
    *,
    tolerance: float | None = None,
    relative: float | None = None,
    tell: Callable[[str], object] = lambda line: None,
) -> Trajectory:
    """Integrate a scene such that the position errs by no more than a tolerance, at any time.

    Parameters
    ----------
    scene
        What is integrated.
    tolerance
        Largest error of any component of the position at any time of the run, a length.
    relative
        The same as a share of the largest position of the run; one of the two.
    tell
        Is told of every run in a line.

    Returns
    -------
    Trajectory
        The best run, with its polynomials; its `assessment` says ``met``, ``unreliable`` or
        ``refused``, and why.

    Raises
    ------
    ValueError
        If not exactly one of the two is given, or it is not a positive number.
    """
    given = {"tolerance": tolerance, "relative": relative}
    said = {name: value for name, value in given.items() if value is not None}
    if len(said) != 1:
        raise ValueError("tolerance: give either tolerance or relative")
    for name, value in said.items():
        if not 0 < value < math.inf:
            raise ValueError(f"{name}: {value!r} is not allowed; it must be positive")
    if relative is not None and relative >= 1:
        raise ValueError(f"relative: {relative!r} is not allowed; it must be less than 1")
    return _Search(scene=scene, tolerance=tolerance, relative=relative, tell=tell).result()


@dataclass(kw_only=True, eq=False)
class _Search:
    """The rounds so far; the best is kept."""

    scene: Scene
    tolerance: float | None
    relative: float | None
    tell: Callable[[str], object]
    best: _Round | None = None
    worst_since: float = 0.0
    lines: list[str] = field(default_factory=list)
    first_step: float | None = None

    def result(self) -> Trajectory:
        forces = SceneForces(self.scene)
        knots = knots_of(self.scene)
        if knots and not forces.has_kinks:
            found = self._on_samples(knots)
            if found is not None:
                return found
        return self._adaptively(forces, knots)

    def target(self, amplitude: float) -> float:
        """The tolerance as a length, for a motion of this size."""
        if self.tolerance is not None:
            return self.tolerance
        return (self.relative or 0.0) * amplitude

    def _note(self, one: _Round) -> None:
        self.lines.append(one.line)
        self.tell(one.line)
        if self.best is None or one.estimate < self.best.estimate:
            self.best, self.worst_since = one, 0.0
        elif one.run.status == "ok":
            # a finer run that differs more tells that it was an accident
            self.worst_since = max(self.worst_since, one.at_points)

    def _adaptively(self, forces: SceneForces, knots: tuple[float, ...]) -> Trajectory:
        guess = likely_amplitude(self.scene)
        target = self.target(guess)
        digits = math.log10(max(guess, 1e-300) / target) if target > 0 else 0.0
        degree = 8 if digits <= FEW_DIGITS else 10
        local = _first_local(ROUGHLY * target, guess)
        most_steps = MOST_KINKED_STEPS if forces.has_kinks else MOST_STEPS
        runs = AdaptiveRuns(self.scene, degree, points=knots, most_steps=most_steps)
        least_gain = 1.0 if forces.has_kinks or forces.is_steep else LEAST_GAIN
        other: Trajectory | None = None
        before, still, failed, doubted = math.inf, 0, 0, False
        for _ in range(MOST_ROUNDS):
            run = runs.run(local, self.first_step)
            words = f"gauss{degree}, local tolerance {local:.2g}: {run.n_steps} steps"
            if run.status != "ok" or run.steps is None:
                self._note(_Round(run=run, line=f"{words}; {run.status}: {run.message}"))
                failed += 1
                if failed > 2 or "most steps" in run.message:
                    break
                local *= 0.03
                continue
            one = self._compared(run, other, least_gain, words)
            self._note(one)
            amplitude = one.amplitude
            if amplitude == 0.0 and self.relative is not None:
                return self._ended(
                    one, "refused", "relative: the motion stays at zero; give tolerance"
                )
            target = self.target(amplitude)
            if run.doubts and self.first_step is None and run.doubts[0][0] == 0.0:
                self.first_step = SHORTER_START * self.scene.final_time
                continue
            # what round-off makes of runs may agree by accident
            if one.estimate <= (target if still == 0 else BY_ACCIDENT * target):
                if not run.doubts:
                    return self._ended(one, "met", "")
                if doubted:
                    break
                doubted = True
            factor = max(1e-6, (AIMED_AT * target / max(one.between, 1e-300)) ** STEEPNESS)
            if other is not None:
                # the square of it, at the points
                factor = min(factor, math.sqrt(AIMED_AT * target / max(one.at_points, 1e-300)))
            if other is not None and one.estimate > STILL * before:
                # a little may change nothing; what does not help either is round-off
                still += 1
                factor = min(factor, LEAP)
            if still > 2 or local <= 10 * EPSILON * amplitude:
                break
            before, other = one.estimate, run
            local = min(UNRELATED * local, factor * local, COARSEST * amplitude or local)
        return self._given_up()

    def _compared(
        self, run: Trajectory, other: Trajectory | None, least_gain: float, words: str
    ) -> _Round:
        """A run with its error by a worse one on an unrelated mesh; None: there is none yet."""
        if run.steps is None:  # pragma: no cover - it was asked for
            raise ValueError("tolerance: a run without its polynomials")
        between = float(between_points(self.scene, run.steps).max())
        if other is None or other.steps is None:
            return _Round(run=run, between=between, line=f"{words}, {between:.2g} between points")
        times, differences = on_other_mesh(other, run)
        difference = float(differences.max())
        own, others = local_errors(run.steps), local_errors(other.steps)
        gain = max(least_gain, min(1.0, CAUTION * own / others))
        at_points = max(gain * difference, round_off(run, difference, others))
        return _Round(
            run=run,
            times=times,
            differences=differences,
            at_points=at_points,
            between=between,
            line=f"{words}, differs by {difference:.2g} from the one before: errs by "
            f"{at_points:.2g} at points, {between:.2g} between them",
        )

    def _on_samples(self, knots: tuple[float, ...]) -> Trajectory | None:
        """Equal steps between samples; None where these do not do."""
        guess = likely_amplitude(self.scene)
        target = self.target(guess)
        digits = math.log10(max(guess, 1e-300) / target) if target > 0 else 0.0
        degree = 2 if digits < 3.5 else 3 if digits < 7.5 else 4
        per_interval, before = 1, math.inf
        while per_interval <= MOST_PER_INTERVAL and per_interval * len(knots) <= MOST_STEPS:
            mesh = knot_mesh(self.scene, knots, per_interval)
            coarse = run_on(self.scene, degree, mesh)
            line = f"gauss{degree}, {mesh.n_steps} steps between the samples"
            if coarse.status != "ok" or coarse.steps is None:
                self._note(_Round(run=coarse, line=f"{line}; {coarse.status}: {coarse.message}"))
                return None
            fine = run_on(self.scene, degree + 2, mesh)
            if fine.status != "ok" or fine.steps is None:
                return None
            differences = on_same_mesh(coarse, fine)
            difference = float(differences.max())
            rounded = round_off(fine, difference, local_errors(coarse.steps))
            at_points = max(SAMPLED_GAIN * difference, rounded)
            between = float(between_points(self.scene, fine.steps).max())
            one = _Round(
                run=fine,
                times=coarse.steps.time,
                differences=differences,
                at_points=at_points,
                between=between,
                line=f"{line}; gauss{degree + 2} on the same differs by {difference:.2g}: errs by "
                f"{at_points:.2g} at points, {between:.2g} between them",
            )
            self._note(one)
            if one.amplitude == 0.0 and self.relative is not None:
                return self._ended(
                    one, "refused", "relative: the motion stays at zero; give tolerance"
                )
            if one.estimate <= self.target(one.amplitude):
                return self._ended(one, "met", "")
            if one.estimate > STILL * before:
                return None
            before = one.estimate
            short = max(one.estimate / self.target(one.amplitude), 1.0)
            if degree < 6:
                degree = min(6, degree + (2 if short < FAR else 4))
            else:
                per_interval *= 2 ** min(3, math.ceil(math.log(short, PER_HALVING)))
        return None

    def _given_up(self) -> Trajectory:
        """The best run, and why it is not good enough."""
        one = self.best
        if one is None:  # pragma: no cover - a round is always made
            raise ValueError("tolerance: nothing was run")
        run = one.run
        if run.status != "ok":
            return self._ended(one, "refused", run.message)
        target = self.target(one.amplitude)
        one = replace(one, at_points=max(one.at_points, self.worst_since))
        if one.estimate <= target and run.doubts:
            time, why = run.doubts[0]
            return self._ended(one, "unreliable", f"{why} near t = {time:.6g}", time=time)
        if one.estimate <= target:
            reason = (
                f"the estimate {one.estimate:.2g} does not fall with the steps: it is round-off, "
                f"too near to {target:.2g}"
            )
            return self._ended(one, "refused", reason)
        growth = growth_of(run, one.times, one.differences, target)
        reached = f"the best error reached is {one.estimate:.2g}"
        if growth.factor > SENSITIVE and float(one.differences.max()) > target:
            where = ", ".join(f"{x:.4g}" for x in growth.place)
            reason = (
                f"runs that should agree differ by more than {target:.2g} from t = "
                f"{growth.time:.6g} on, at [{where}]: their difference grows by a factor of "
                f"{growth.factor:.1e} in the run; {reached}"
            )
            return self._ended(one, "unreliable", reason, time=growth.time, place=growth.place)
        return self._ended(one, "refused", f"{target:.2g} is out of reach: {reached}")

    def _ended(
        self,
        one: _Round,
        outcome: Outcome,
        reason: str,
        *,
        time: float | None = None,
        place: tuple[float, ...] | None = None,
    ) -> Trajectory:
        target = self.target(one.amplitude)
        assessment = Assessment(
            outcome=outcome,
            tolerance=target if target > 0 else math.nan,
            estimate=one.estimate,
            reason=reason,
            time=time,
            place=place,
            attempts=tuple(self.lines),
        )
        return replace(one.run, assessment=assessment)


def _first_local(target: float, amplitude: float) -> float:
    """Local tolerance to begin with, a length."""
    if target <= 0:
        # nothing is known to move, in no unit of length
        return 1.0
    if amplitude <= 0:
        return target
    share = (LOOSE * target / amplitude) ** (1 / POWER)
    return float(amplitude * min(COARSEST, share))
