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

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.looks import has_kinks, is_steep
from fvi_cli.integrator.trajectory import Assessment, Outcome, Trajectory
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.threads import in_one_thread
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
from fvi_cli.studies.tolerance.rounds import (
    COARSEST,
    Round,
    amplitude_of,
    first_local,
    likely_amplitude,
)
from fvi_cli.studies.tolerance.runs import (
    MOST_STEPS,
    AdaptiveRuns,
    run_on,
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
    wanted = Accuracy(tolerance=tolerance, relative=relative, max_step=max_step)
    return solve_by_two_runs(scene, wanted, log=log)[0]


@in_one_thread
def solve_by_two_runs(
    scene: Scene, wanted: Accuracy, *, log: Callable[[str], object] = lambda line: None
) -> tuple[Trajectory, Trajectory | None]:
    """As :func:`solve`, and the run that it is compared with; None: there is none."""
    search = _Search(scene=scene, wanted=wanted, log=log)
    run = search.result()
    return run, None if search.given is None else search.given.other


@dataclass(kw_only=True, eq=False)
class _Search:
    """The state of a search: its rounds so far, of which the best is kept."""

    scene: Scene
    wanted: Accuracy
    log: Callable[[str], object]
    best: Round | None = None
    given: Round | None = None  # the round of the result
    worst_since: float = 0.0
    rounding: tuple[Array, Array] | None = None
    lines: list[str] = field(default_factory=list)
    guess: float = 0.0

    def target(self, amplitude: float) -> float:
        """The tolerance as a length, for a motion of this size."""
        if self.wanted.tolerance is not None:
            return self.wanted.tolerance
        return (self.wanted.relative or 0.0) * amplitude

    @property
    def digits(self) -> float:
        """Requested digits of the likely motion."""
        target = self.target(self.guess)
        return math.log10(max(self.guess, 1e-300) / target) if target > 0 else 0.0

    def _note(self, one: Round) -> None:
        self.lines.append(one.line)
        self.log(one.line)
        if self.best is None or one.estimate < self.best.estimate:
            self.best, self.worst_since = one, 0.0
        elif one.run.status == "ok":
            # a later run that differs more shows that the agreement was an accident
            self.worst_since = max(self.worst_since, one.at_points)

    def result(self) -> Trajectory:
        self.guess = likely_amplitude(self.scene)
        degree = self.wanted.stages or (8 if self.digits <= FEW_DIGITS else 10)
        local = first_local(self.target(self.guess), self.guess)
        runs, finer = (
            AdaptiveRuns(self.scene, one, max_step=self.wanted.max_step)
            for one in (degree, degree + 2)
        )
        # on one mesh two runs may miss the same feature
        is_rough, is_kinked = is_steep(self.scene), has_kinks(self.scene)
        least_gain = BESIDE_KINKS if is_kinked else 1.0 if is_rough else LEAST_GAIN
        before, still, failed, target = math.inf, 0, 0, 0.0
        for _ in range(MOST_ROUNDS):
            # what hides does not fall with the steps as other errors do
            may_miss = MAY_MISS * (target or self.target(self.guess)) or math.inf
            run = coarse = runs.run(local, may_miss=may_miss)
            words = f"Gauss{degree}, local tolerance {local:.2g}: {coarse.n_steps} steps"
            if coarse.status == "ok" and coarse.steps is not None:
                mesh = coarse.steps.mesh(self.scene.break_points)
                if is_rough:
                    run = finer.run(SECOND_RUN_FACTOR * local, may_miss=may_miss)
                else:
                    run = run_on(self.scene, degree + 2, mesh)
                    run = replace(run, rejected=coarse.rejected)
            if run.status != "ok" or run.steps is None or coarse.steps is None:
                self._note(Round(run=run, line=f"{words}; {run.status}: {run.message}"))
                failed += 1
                if failed > 2 or coarse.n_steps >= MOST_STEPS:
                    break
                local *= 0.03
                continue
            amplitude = amplitude_of(run)
            target = self.target(amplitude)
            is_probed = self.scene.is_linear or self.rounding is not None
            if not is_probed and target < PROBED * amplitude:
                moved = run_on(perturb_start(self.scene, run), degree, mesh)
                self.rounding = differences_of(coarse, moved)
            gain = CAUTION * local_errors(run.steps) / local_errors(coarse.steps)
            if self.wanted.stages is None:
                one = self._compared(coarse, run, max(least_gain, min(1.0, gain)), words)
            else:
                one = self._compared(run, coarse, 1.0, words)
            self._note(one)
            if amplitude == 0.0 and self.wanted.relative is not None:
                return self._result(
                    one, "refused", "relative: the motion stays at zero; give tolerance"
                )
            if self.rounding is not None and self._rounded(run) > target:
                return self._is_limited_by_rounding(one, target)
            # runs that are dominated by round-off may agree by accident
            is_enough = still == 0 or is_kinked
            if one.estimate <= (target if is_enough else STALLED_SHARE * target):
                return self._result(one, "met", "")
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

    def _compared(self, other: Trajectory, run: Trajectory, gain: float, words: str) -> Round:
        """A run with its error, the share `gain` of its difference from another run."""
        if run.steps is None:  # pragma: no cover - it was asked for
            raise ValueError("tolerance: a run without its polynomials")
        times, differences = differences_of(other, run)
        difference = float(differences.max())
        at_points = max(gain * difference, self._rounded(run))
        between = float(between_points(self.scene, run.steps).max())
        steps = "the same" if run.n_steps == other.n_steps else f"{run.n_steps}"
        return Round(
            run=run,
            other=other,
            times=times,
            differences=differences,
            at_points=at_points,
            between=between,
            line=f"{words}, Gauss{run.steps.tables.degree} on {steps} differs by "
            f"{difference:.2g}: errs by {at_points:.2g} at points, {between:.2g} between them",
        )

    def _rounded(self, run: Trajectory) -> float:
        """Error at any time by round-off at the start, a length."""
        own = ROUNDED * EPSILON
        grown = 0.0 if self.rounding is None else float(self.rounding[1].max()) / SHIFT
        return own * max(amplitude_of(run), grown)

    def _is_limited_by_rounding(self, one: Round, target: float) -> Trajectory:
        times, differences = self.rounding or (one.times, one.differences)
        lengths = ROUNDED * EPSILON / SHIFT * differences
        growth = growth_of(one.run, times, lengths, target)
        reason = (
            f"round-off itself is more than {target:.2g} {growth.where}: a change of the start "
            f"grows by a factor of {growth.factor:.1e} in the run; the error is about "
            f"{one.estimate:.2g}"
        )
        return self._result(one, "unreliable", reason, time=growth.time, place=growth.place)

    def _given_up(self) -> Trajectory:
        """The best run, and why it is not good enough."""
        one = self.best
        if one is None:  # pragma: no cover - a round is always made
            raise ValueError("tolerance: no run was made")
        run = one.run
        if run.status != "ok":
            return self._result(one, "refused", run.message)
        target = self.target(one.amplitude)
        one = replace(one, at_points=max(one.at_points, self.worst_since))
        if one.estimate <= target:
            reason = (
                f"the estimate {one.estimate:.2g} does not fall with the steps: it is round-off, "
                f"too near to {target:.2g}"
            )
            return self._result(one, "refused", reason)
        growth = growth_of(run, one.times, one.differences, target)
        reached = f"the best error reached is {one.estimate:.2g}, ask for that or more"
        if growth.factor > SENSITIVE and float(one.differences.max()) > target:
            reason = (
                f"runs that should agree differ by more than {target:.2g} {growth.where}: their "
                f"difference grows by a factor of {growth.factor:.1e} in the run; {reached}"
            )
            return self._result(one, "unreliable", reason, time=growth.time, place=growth.place)
        return self._result(one, "refused", f"{target:.2g} is out of reach: {reached}")

    def _result(
        self,
        one: Round,
        outcome: Outcome,
        reason: str,
        *,
        time: float | None = None,
        place: tuple[float, ...] | None = None,
    ) -> Trajectory:
        self.given = one
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
