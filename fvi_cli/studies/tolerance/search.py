"""A run for a tolerance: a local tolerance chooses the steps, a second run measures the error.

A run with m stages chooses its steps by a local tolerance. A second run with two stages more on the
same mesh measures its error, and is the run that is delivered. Where forces have kinks, or are as
steep as walls and pulses, the second run chooses its own steps: on one mesh both runs might miss
the same feature. Both look for such features between their points, at the same samples of the
force. Samples of a record are points of the mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from pydantic import ValidationError

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.looks import has_kinks, is_steep
from fvi_cli.integrator.trajectory import Assessment, Outcome, Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread
from fvi_cli.scenes.keys.mistakes import first_mistake
from fvi_cli.studies.accuracy_settings import Accuracy
from fvi_cli.studies.tolerance.differences import (
    EPSILON,
    ROUNDED,
    SHIFT,
    between_points,
    differences_of,
    growth_of,
    local_errors,
    perturb_start,
)
from fvi_cli.studies.tolerance.runs import (
    COARSEST,
    MOST_STEPS,
    adaptive_runs,
    amplitude_of,
    first_local,
    gauss,
    likely_amplitude,
)

MOST_ROUNDS: Final = 10
FEW_DIGITS: Final = 7.0
"""Up to so many digits the less accurate of two runs has 8 stages, beyond that 10."""
LEAST_GAIN: Final = 0.03
"""Least estimate of the error of the better of two runs, as a share of their difference."""
BESIDE_KINKS: Final = 5.0
"""The same beside kinks, where differences are as random as the places of steps."""
PROBED: Final = 1e-9
"""For tolerances below this share of a nonlinear motion the growth of round-off is measured."""
CAUTION: Final = 10.0
"""Safety factor on the ratio of local errors, which estimates the ratio of errors of two runs."""
AIMED_AT: Final = 0.3
"""A new local tolerance is chosen for this share of the tolerance."""
SHRINKS_TO: Final = (1e-6, 0.3)
"""Least and largest factor from a local tolerance to the next."""
SECOND_RUN_FACTOR: Final = 0.3
"""Local tolerance of a run on a mesh of its own, relative to that of the first one."""
STILL: Final = 0.3
"""An error that is more than this share of the previous one counts as not fallen."""
STALLED_FACTOR: Final = 0.01
"""Factor to the next local tolerance after one that did not reduce the error."""
STALLED_SHARE: Final = 0.2
"""An error that does not fall with the steps must be below this share of the tolerance."""
SENSITIVE: Final = 1e3
"""Differences that grow by more than this in a run make it unreliable."""
MAY_MISS: Final = 0.03
"""Share of the tolerance by which what no step sees may move the system."""


def solve(
    scene: Scene,
    *,
    tolerance: float | None = None,
    relative: float | None = None,
    max_step: float | None = None,
    log: Callable[[str], object] = lambda line: None,
) -> Trajectory:
    """Integrate a scene such that the position errs by no more than a tolerance, at any time.

    The limit for any component is `tolerance`, a length, or the share `relative` of the largest
    position of the run. Steps are chosen during the run, none longer than `max_step`, and a second
    run measures the error (``docs/explanation/tolerances.md``). `log` is called with a line about
    every run.

    The best run is returned. ``trajectory(t)`` and ``trajectory.velocity(t)`` give the motion at
    any times, ``trajectory.error_estimate`` its error, ``trajectory.outcome`` whether the tolerance
    is ``met``; otherwise ``unreliable`` or ``refused``, for the reason in
    ``trajectory.assessment``.

    Raises
    ------
    ValueError
        If not exactly one of the two is given, or one is not a positive number.
    """
    given = {"tolerance": tolerance, "relative": relative, "max_step": max_step}
    try:
        wanted = Accuracy.model_validate(given)
    except ValidationError as error:
        raise first_mistake(error, given, Accuracy) from None
    return solve_by_two_runs(scene, wanted, log=log)[0]


@in_one_thread
def solve_by_two_runs(
    scene: Scene, wanted: Accuracy, *, log: Callable[[str], object] = lambda line: None
) -> tuple[Trajectory, Trajectory | None]:
    """As :func:`solve`, and the run that it is compared with; None: there is none."""
    return _Search(scene=scene, wanted=wanted, log=log).result()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Round:
    """A run with its differences from another run, and the error estimated from them."""

    run: Trajectory
    other: Trajectory | None = None
    times: Array = field(default_factory=lambda: np.zeros(1))
    differences: Array = field(default_factory=lambda: np.array([math.inf]))
    at_points: float = math.inf
    between: float = math.inf

    @property
    def estimate(self) -> float:
        """Estimated largest error at any time, a length; infinite where none is known."""
        return max(self.at_points, self.between)


@dataclass(kw_only=True, eq=False)
class _Search:
    """The state of a search: its runs so far, of which the best is kept."""

    scene: Scene
    wanted: Accuracy
    log: Callable[[str], object]
    best: _Round | None = None
    worst_since: float = 0.0
    rounding: tuple[Array, Array] | None = None  # times, and how far a change of the start moves
    lines: list[str] = field(default_factory=list)

    def target(self, amplitude: float) -> float:
        """The tolerance as a length, for a motion of this size."""
        if self.wanted.tolerance is not None:
            return self.wanted.tolerance
        return (self.wanted.relative or 0.0) * amplitude

    def result(self) -> tuple[Trajectory, Trajectory | None]:
        scene, wanted = self.scene, self.wanted
        guess = likely_amplitude(scene)
        target = self.target(guess)
        digits = math.log10(max(guess, 1e-300) / target) if target > 0 else 0.0
        degree = wanted.stages or (8 if digits <= FEW_DIGITS else 10)
        local = first_local(target, guess)
        first, second = (
            adaptive_runs(scene, one, max_step=wanted.max_step) for one in (degree, degree + 2)
        )
        # on one mesh two runs may miss the same feature
        is_rough, is_kinked = is_steep(scene), has_kinks(scene)
        least_gain = BESIDE_KINKS if is_kinked else 1.0 if is_rough else LEAST_GAIN
        before, still, failed = math.inf, 0, 0
        for _ in range(MOST_ROUNDS):
            # what hides does not fall with the steps as other errors do
            may_miss = MAY_MISS * target or math.inf
            run = coarse = first(local, may_miss)
            words = f"Gauss{degree}, local tolerance {local:.2g}: {coarse.n_steps} steps"
            if coarse.status == "ok" and coarse.steps is not None:
                mesh = coarse.steps.mesh(scene.break_points)
                if is_rough:
                    run = second(SECOND_RUN_FACTOR * local, may_miss)
                else:
                    run = integrate(scene, gauss(scene, degree + 2), mesh, with_steps=True)
                    run = replace(run, rejected=coarse.rejected)
            if run.status != "ok" or run.steps is None or coarse.steps is None:
                self._note(_Round(run=run), f"{words}; {run.status}: {run.message}")
                failed += 1
                if failed > 2 or coarse.n_steps >= MOST_STEPS:
                    break
                local *= 0.03
                continue
            amplitude = amplitude_of(run)
            target = self.target(amplitude)
            is_probed = scene.is_linear or self.rounding is not None
            if not is_probed and target < PROBED * amplitude:
                other = perturb_start(scene, run)
                beside = integrate(other, gauss(other, degree), mesh, with_steps=True)
                self.rounding = differences_of(coarse, beside)
            gain = CAUTION * local_errors(run.steps) / local_errors(coarse.steps)
            if wanted.stages is None:
                one = self._compared(coarse, run, max(least_gain, min(1.0, gain)), words)
            else:
                one = self._compared(run, coarse, 1.0, words)
            if amplitude == 0.0 and wanted.relative is not None:
                reason = "relative: the motion stays at zero; give tolerance"
                return self._ended(one, "refused", reason)
            if self.rounding is not None and self._rounded(run) > target:
                times, moved = self.rounding
                lengths = ROUNDED * EPSILON / SHIFT * moved
                growth = growth_of(times, lengths, amplitude, target)
                reason = f"round-off itself is more than {target:.2g}"
                end = f"the error is about {one.estimate:.2g}"
                return self._unreliable(one, growth, reason, end)
            # runs that are dominated by round-off may agree by accident
            is_enough = still == 0 or is_kinked
            if one.estimate <= (target if is_enough else STALLED_SHARE * target):
                return self._ended(one, "met", "")
            factor = min(SHRINKS_TO[1], AIMED_AT * target / max(one.estimate, 1e-300))
            if one.estimate > STILL * before:
                # a small reduction may change nothing; if a large one does not help it is round-off
                still += 1
                factor = min(factor, STALLED_FACTOR)
            if still > 2 or local <= 10 * EPSILON * amplitude:
                break
            before = one.estimate
            local = min(max(SHRINKS_TO[0], factor) * local, COARSEST * amplitude or local)
        return self._given_up()

    def _note(self, one: _Round, line: str) -> None:
        self.lines.append(line)
        self.log(line)
        if self.best is None or one.estimate < self.best.estimate:
            self.best, self.worst_since = one, 0.0
        elif one.run.status == "ok":
            # a later run that differs more shows that the agreement was an accident
            self.worst_since = max(self.worst_since, one.at_points)

    def _compared(self, other: Trajectory, run: Trajectory, gain: float, words: str) -> _Round:
        """A run with its error, the share `gain` of its difference from another run."""
        if run.steps is None:  # pragma: no cover - it was asked for
            raise ValueError("tolerance: a run without its polynomials")
        times, differences = differences_of(other, run)
        difference = float(differences.max())
        at_points = max(gain * difference, self._rounded(run))
        between = float(between_points(self.scene, run.steps).max())
        steps = "the same" if run.n_steps == other.n_steps else f"{run.n_steps}"
        one = _Round(
            run=run,
            other=other,
            times=times,
            differences=differences,
            at_points=at_points,
            between=between,
        )
        line = f"{words}, Gauss{run.steps.tables.degree} on {steps} differs by {difference:.2g}: "
        self._note(one, f"{line}errs by {at_points:.2g} at points, {between:.2g} between them")
        return one

    def _rounded(self, run: Trajectory) -> float:
        """Error at any time by round-off at the start, a length."""
        grown = 0.0 if self.rounding is None else float(self.rounding[1].max()) / SHIFT
        return ROUNDED * EPSILON * max(amplitude_of(run), grown)

    def _given_up(self) -> tuple[Trajectory, Trajectory | None]:
        """The best run, and why it is not good enough."""
        one = self.best
        if one is None:  # pragma: no cover - a run is always made
            raise ValueError("tolerance: no run was made")
        if one.run.status != "ok":
            return self._ended(one, "refused", one.run.message)
        amplitude = amplitude_of(one.run)
        target = self.target(amplitude)
        one = replace(one, at_points=max(one.at_points, self.worst_since))
        if one.estimate <= target:
            reason = (
                f"the estimate {one.estimate:.2g} does not fall with the steps: it is round-off, "
                f"too near to {target:.2g}"
            )
            return self._ended(one, "refused", reason)
        growth = growth_of(one.times, one.differences, amplitude, target)
        reached = f"the best error reached is {one.estimate:.2g}, ask for that or more"
        if growth[1] > SENSITIVE and float(one.differences.max()) > target:
            reason = f"runs that should agree differ by more than {target:.2g}"
            return self._unreliable(one, growth, reason, reached)
        return self._ended(one, "refused", f"{target:.2g} is out of reach: {reached}")

    def _unreliable(
        self, one: _Round, growth: tuple[float, float], reason: str, end: str
    ) -> tuple[Trajectory, Trajectory | None]:
        time, factor = growth
        reason += f" from t = {time:.6g} on: a difference grows by a factor of {factor:.1e} in the "
        return self._ended(one, "unreliable", f"{reason}run; {end}", time)

    def _ended(
        self, one: _Round, outcome: Outcome, reason: str, time: float | None = None
    ) -> tuple[Trajectory, Trajectory | None]:
        """The run with its assessment, and the run that it was compared with."""
        target = self.target(amplitude_of(one.run))
        assessment = Assessment(
            outcome=outcome,
            tolerance=target if target > 0 else math.nan,
            estimate=one.estimate,
            reason=reason,
            time=time,
            attempts=tuple(self.lines),
        )
        return replace(one.run, assessment=assessment), one.other
