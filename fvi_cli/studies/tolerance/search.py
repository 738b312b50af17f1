"""A run for a tolerance: a local tolerance chooses the steps, a second run measures the error.

The second run has two stages more on the same mesh and is the one that is delivered; the difference
of the runs bounds its error at the points. Where the stages are given, they are those of the first
run, which is delivered. Where forces have kinks, or are as steep as walls and pulses, the second
run chooses its own steps: on one mesh both runs might miss the same feature. Both look for such
features between their points, at the same samples of the force. Samples of a record are points of
the mesh.
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
from fvi_cli.studies.tolerance.errors import between_points, differences_of, growth_of
from fvi_cli.studies.tolerance.runs import (
    COARSEST,
    MOST_STEPS,
    adaptive_runs,
    amplitude_of,
    first_local,
    gauss,
    likely_amplitude,
)

EPSILON: Final = float(np.finfo(float).eps)
MOST_ROUNDS: Final = 10
FEW_DIGITS: Final = 7.0
"""Up to so many digits the first run has 8 stages, beyond that 10."""
BESIDE_KINKS: Final = 5.0
"""Factor on differences beside kinks, which are as random as the places of steps."""
ROUNDED: Final = 10.0
"""Least estimate, in units of round-off of the position."""
AIMED_AT: Final = 0.3
"""A new local tolerance is chosen for this share of the tolerance."""
SHRINKS_TO: Final = (1e-6, 0.3)
"""Least and largest factor from a local tolerance to the next."""
SECOND_RUN_FACTOR: Final = 0.3
"""Local tolerance of a second run on a mesh of its own, relative to that of the first one."""
STILL: Final = 0.3
"""An error that is more than this share of the previous one counts as not fallen."""
STALLED_FACTOR: Final = 0.01
"""Factor to the next local tolerance after one that did not reduce the error."""
STALLED_SHARE: Final = 0.2
"""An error that does not fall with the steps must be below this share of the tolerance."""
AFTER_FAILURE: Final = 1e-3
"""Factor to the next local tolerance after a run that failed."""
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

    The run with the least estimate is returned. ``trajectory(t)`` and ``trajectory.velocity(t)``
    give the motion at any times, ``trajectory.error_estimate`` its error, ``trajectory.met``
    whether the tolerance is met; ``trajectory.assessment`` says why not.

    Raises
    ------
    ValueError
        If not exactly one of the two is given, or one is not a positive number.
    """
    given = {"tolerance": tolerance, "relative": relative, "max_step": max_step}
    try:
        wanted = Accuracy.model_validate(given)
    except ValidationError as error:
        raise first_mistake(error) from None
    return solve_by_two_runs(scene, wanted, log=log)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """A run, the second run, and the error estimated from their differences."""

    run: Trajectory
    other: Trajectory | None = None
    times: Array = field(default_factory=lambda: np.zeros(1))
    differences: Array = field(default_factory=lambda: np.array([math.inf]))
    estimate: float = math.inf  # of the largest error at any time, a length
    line: str  # for the log


@in_one_thread
def solve_by_two_runs(
    scene: Scene, wanted: Accuracy, *, log: Callable[[str], object] = lambda line: None
) -> tuple[Trajectory, Trajectory | None]:
    """As :func:`solve`, and the run that it is compared with; None: there is none."""

    def length(amplitude: float) -> float:
        """The tolerance as a length, for a motion of this size."""
        if wanted.tolerance is not None:
            return wanted.tolerance
        return (wanted.relative or 0.0) * amplitude

    def ended(
        attempt: _Attempt, outcome: Outcome, reason: str = "", time: float | None = None
    ) -> tuple[Trajectory, Trajectory | None]:
        target = length(amplitude_of(attempt.run))
        assessment = Assessment(
            outcome=outcome,
            tolerance=target if target > 0 else math.nan,
            estimate=attempt.estimate,
            reason=reason,
            time=time,
            attempts=tuple(tried.line for tried in attempts),
        )
        return replace(attempt.run, assessment=assessment), attempt.other

    guess = likely_amplitude(scene)
    target, local = length(guess), first_local(length(guess), guess)
    digits = math.log10(max(guess, 1e-300) / target) if target > 0 else 0.0
    tried = _pair_of_runs(scene, wanted, wanted.stages or (8 if digits <= FEW_DIGITS else 10))
    attempts: list[_Attempt] = []
    before, stalled, failed, is_kinked = math.inf, 0, 0, has_kinks(scene)
    for _ in range(MOST_ROUNDS):
        # what hides does not fall with the steps as other errors do
        attempt = tried(local, MAY_MISS * target or math.inf)
        attempts.append(attempt)
        log(attempt.line)
        if attempt.other is None:
            failed += 1
            if failed > 2 or attempt.run.n_steps >= MOST_STEPS:
                break
            local *= AFTER_FAILURE
            continue
        amplitude, estimate = amplitude_of(attempt.run), attempt.estimate
        target = length(amplitude)
        if amplitude == 0.0 and wanted.relative is not None:
            reason = "relative: the motion stays at zero; give tolerance"
            return ended(attempt, "refused", reason)
        # runs that are dominated by round-off may agree by accident
        is_trusted = stalled == 0 or is_kinked
        if estimate <= (target if is_trusted else STALLED_SHARE * target):
            return ended(attempt, "met")
        factor = min(SHRINKS_TO[1], AIMED_AT * target / max(estimate, 1e-300))
        if estimate > STILL * before:
            # a small reduction may change nothing; if a large one does not help it is round-off
            stalled += 1
            factor = min(factor, STALLED_FACTOR)
        if stalled > 2 or local <= 10 * EPSILON * amplitude:
            break
        before = estimate
        local = min(max(SHRINKS_TO[0], factor) * local, COARSEST * amplitude or local)
    best = min(attempts, key=lambda one: one.estimate)
    if best.other is None:
        return ended(best, "refused", best.run.message)
    amplitude, reached = amplitude_of(best.run), f"the best error reached is {best.estimate:.2g}"
    time, growth = growth_of(best.times, best.differences, amplitude, target)
    if growth > SENSITIVE and float(best.differences.max()) > target:
        reason = (
            f"two runs agree to {target:.2g} until t = {time:.6g}: a difference grows by a factor "
            f"of {growth:.1e} in the run; {reached}"
        )
        return ended(best, "unreliable", reason, time)
    return ended(best, "refused", f"{target:.2g} is out of reach: {reached}, ask for that or more")


def _pair_of_runs(
    scene: Scene, wanted: Accuracy, degree: int
) -> Callable[[float, float], _Attempt]:
    """A function of a local tolerance, and of what steps may miss, that makes both runs."""
    first, second = (
        adaptive_runs(scene, stages, max_step=wanted.max_step) for stages in (degree, degree + 2)
    )
    # on one mesh two runs may miss the same feature
    is_rough, share = is_steep(scene), BESIDE_KINKS if has_kinks(scene) else 1.0

    def tried(local: float, may_miss: float) -> _Attempt:
        coarse = first(local, may_miss)
        words = f"Gauss{degree}, local tolerance {local:.2g}: {coarse.n_steps} steps"
        if coarse.status != "ok" or coarse.steps is None:
            return _Attempt(run=coarse, line=f"{words}; {coarse.status}: {coarse.message}")
        if is_rough:
            fine = second(SECOND_RUN_FACTOR * local, may_miss)
        else:
            mesh = coarse.steps.mesh(scene.break_points)
            fine = integrate(scene, gauss(scene, degree + 2), mesh, with_steps=True)
            fine = replace(fine, rejected=coarse.rejected)
        if fine.status != "ok" or fine.steps is None:
            return _Attempt(run=fine, line=f"{words}; Gauss{degree + 2} {fine.message}")
        run, other = (fine, coarse) if wanted.stages is None else (coarse, fine)
        times, differences = differences_of(coarse, fine)
        at_points = max(share * float(differences.max()), ROUNDED * EPSILON * amplitude_of(run))
        between = float(between_points(scene, run.steps or coarse.steps).max())
        line = f"{words}, Gauss{degree + 2} on {fine.n_steps} differs by {differences.max():.2g}"
        return _Attempt(
            run=run,
            other=other,
            times=times,
            differences=differences,
            estimate=max(at_points, between),
            line=f"{line}; errs by {between:.2g} between points",
        )

    return tried
