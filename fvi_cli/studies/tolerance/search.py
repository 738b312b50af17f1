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
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydantic import ValidationError

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.looks import has_kinks, is_steep
from fvi_cli.integrator.trajectory import Assessment, Trajectory
from fvi_cli.mathematics.threads import in_one_thread
from fvi_cli.scenes.keys.mistakes import first_mistake
from fvi_cli.studies.settings import Accuracy
from fvi_cli.studies.tolerance.errors import between_points, differences_of
from fvi_cli.studies.tolerance.runs import (
    COARSEST,
    adaptive_run,
    amplitude_of,
    first_local,
    gauss,
    likely_amplitude,
)

EPSILON: Final = float(np.finfo(float).eps)
MOST_STEPS = 200_000
FEW_DIGITS: Final = 7.0
"""Up to so many digits the first run has 8 stages, beyond that 10."""
BESIDE_KINKS: Final = 5.0
"""Factor on differences beside kinks, which are as random as the places of steps."""
ROUNDED: Final = 10.0
"""Least estimate, in units of round-off of the position."""
AIMED_AT: Final = 0.3
"""A new local tolerance is chosen for this share of the tolerance."""
SHRINKS_TO: Final = (1e-3, 0.01)
"""Least and largest factor from a local tolerance to the next."""
STILL: Final = 0.3
"""A search ends with an error that is more than this share of the previous one, but for kinks."""
SECOND_RUN_FACTOR: Final = 0.3
"""Local tolerance of a second run on a mesh of its own, relative to that of the first one."""
MAY_MISS: Final = 0.03
"""Share of the tolerance by which what no step sees may move the system."""


def solve(
    scene: Scene,
    *,
    tolerance: float | None = None,
    relative: float | None = None,
    max_step: float | None = None,
) -> Trajectory:
    """Integrate a scene such that the position errs by no more than a tolerance, at any time.

    The limit for any component is `tolerance`, a length, or the share `relative` of the largest
    position of the run. Steps are chosen during the run, none longer than `max_step`, and a second
    run measures the error (``docs/explanation/tolerances.md``).

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
    return solve_by_two_runs(scene, wanted)[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Attempt:
    """A run, the run that it is compared with, and what their differences say."""

    run: Trajectory
    other: Trajectory | None = None
    estimate: float = math.inf  # of the largest error at any time, a length
    parted: float = 0.0  # time from which on the runs differ by more than the tolerance


@in_one_thread
def solve_by_two_runs(scene: Scene, wanted: Accuracy) -> tuple[Trajectory, Trajectory | None]:
    """As :func:`solve`, and the run that it is compared with; None: there is none."""
    amplitude = likely_amplitude(scene)
    target = wanted.length(amplitude)
    local, before, best = first_local(target, amplitude), math.inf, None
    is_kinked = has_kinks(scene)
    # beside kinks errors fall like the root of the local tolerance
    least = (0.01 if is_kinked else 10.0) * EPSILON
    degree = wanted.stages or (8 if target >= 10.0**-FEW_DIGITS * amplitude else 10)
    while best is None or local > least * amplitude:
        # what hides does not fall with the steps as other errors do
        steps = AdaptiveSteps(
            tolerance=local,
            may_miss=MAY_MISS * target,
            most_steps=MOST_STEPS,
            max_step=wanted.max_step or math.inf,
        )
        attempt = _two_runs(scene, wanted, degree, steps)
        # beside kinks two runs may agree by accident
        if best is None or attempt.estimate < best.estimate or (is_kinked and attempt.other):
            best = attempt
        amplitude = amplitude_of(attempt.run)
        target = wanted.length(amplitude)
        is_still = STILL * before <= attempt.estimate < math.inf and not is_kinked
        if attempt.estimate <= target or is_still or attempt.run.n_steps >= MOST_STEPS:
            break
        before = attempt.estimate
        factor = max(SHRINKS_TO[0], min(SHRINKS_TO[1], AIMED_AT * target / before))
        local = factor * min(local, COARSEST * (amplitude or math.inf))
    target, reason = wanted.length(amplitude_of(best.run)), ""
    if best.other is None:
        reason = best.run.message
    elif not best.estimate <= target:
        reason = (
            f"{target:.2g} is out of reach: the least error is {best.estimate:.2g}, and two runs "
            f"agree to {target:.2g} until t = {best.parted:.6g}"
        )
    assessment = Assessment(tolerance=target, estimate=best.estimate, reason=reason)
    return replace(best.run, assessment=assessment), best.other


def _two_runs(scene: Scene, wanted: Accuracy, degree: int, steps: AdaptiveSteps) -> _Attempt:
    """Two runs with a local tolerance, and the error that their differences estimate."""
    coarse = adaptive_run(scene, degree, steps)
    if coarse.status != "ok" or coarse.steps is None:
        return _Attempt(run=coarse)
    # on one mesh two runs may miss the same feature
    if is_steep(scene):
        finer = replace(steps, tolerance=SECOND_RUN_FACTOR * steps.tolerance)
        fine = adaptive_run(scene, degree + 2, finer)
    else:
        mesh = coarse.steps.mesh(scene.break_points)
        fine = integrate(scene, gauss(scene, degree + 2), mesh, with_steps=True)
    if fine.status != "ok" or fine.steps is None:
        return _Attempt(run=fine)
    run, other = (fine, coarse) if wanted.stages is None else (coarse, fine)
    times, differences = differences_of(coarse, fine)
    share = BESIDE_KINKS if has_kinks(scene) else 1.0
    amplitude = amplitude_of(run)
    at_points = max(share * float(differences.max()), ROUNDED * EPSILON * amplitude)
    between = float(between_points(scene, run.steps or coarse.steps).max())
    apart = times[differences > wanted.length(amplitude)]
    return _Attempt(
        run=run,
        other=other,
        estimate=max(at_points, between),
        parted=float(apart[0]) if apart.size else scene.final_time,
    )
