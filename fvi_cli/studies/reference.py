"""References for errors: an exact solution, or a reference run with an estimate of its error."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate_members
from fvi_cli.integrator.meshes.looks import is_steep
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.problem import AnyProblem, Problem
from fvi_cli.studies.experiment import Experiment, Run, Subject
from fvi_cli.studies.members import Member
from fvi_cli.studies.norms import round_up
from fvi_cli.studies.tolerance.runs import adaptive_runs, likely_amplitude

CHECK_METHOD = Method(cq="gauss", degree=4, start="graded")
MOST_STEPS = 2**14
SUFFICIENT = 2e-14
SCALE_TOLERANCE = 1e-4
"""Local tolerance of the run that measures the size of the motion, relative to a guessed size."""
TOLERANCES = (1e-13, 1e-10)
"""Local tolerances of refined adaptive runs, relative to the motion; the first that succeeds."""
CHECK_STEPS = (64, 128)
"""Steps of the two runs with which exact solutions are checked."""
CHECK_TOLERANCE = 1e-9
"""An exact solution may differ from these runs by this share of the motion."""
ERROR_FACTOR = 10.0
"""A difference of more than so many errors of a run is not due to that run."""
WITHOUT_END = "none (no exact solution is known"
TIMES_DIFFER = 1e-12
"""Times of runs may differ by round-off, relative to the last."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Values with which the runs of a ladder are compared."""

    values: Callable[[Array], Array]
    """Function of times, shape ``(n,)`` to ``(n, d)``: an exact solution, polynomials of a run, or
    :class:`Tabulated`; nan where nothing is known."""
    error: float
    """Estimated error of the values in the maximum norm: 0 for an exact solution; nan where nothing
    is known."""
    source: str  # description for readers of tables

    def at(self, times: Array) -> Array:
        """The values at times."""
        return self.values(times)

    @property
    def is_known(self) -> bool:
        """Whether there is anything to compare with."""
        return not math.isnan(self.error)

    def tabulated(self, times: Array) -> Reference:
        """The reference restricted to `times`, which can be stored and sent to another process."""
        values = Tabulated(time=times, position=self.values(times))
        return replace(self, values=values)


@dataclass(frozen=True, kw_only=True, eq=False)
class Tabulated:
    """Values at increasing times, shapes ``(n,)`` and ``(n, d)``."""

    time: Array
    position: Array

    def __call__(self, times: Array) -> Array:
        """The values at some of the times; ValueError at others."""
        after = np.clip(np.searchsorted(self.time, times), 1, self.time.size - 1)
        nearest = after - (times - self.time[after - 1] < self.time[after] - times)
        off = np.abs(self.time[nearest] - times) > TIMES_DIFFER * self.time[-1]
        if off.any():
            raise ValueError(f"reference: it has no value at t = {times[off][0]:.17g}")
        return np.asarray(self.position[nearest])


def needs_refined_run(run: Run) -> bool:
    """Whether the error may have to be measured against a reference run."""
    problem = run.experiment.problem
    if run.is_search or run.experiment.observations.impacts or problem.exact_source == "none":
        return False
    return run.member is not None or problem.exact is None


def refined_references(runs: Sequence[Run]) -> list[Reference | None]:
    """A reference run for the scene of each run of one experiment, at the times of its ladder.

    None for a scene whose exact solution passed its check.
    """
    found = find_references([run.problem for run in runs])
    return [
        None if reference.error == 0.0 else reference.tabulated(_times_of_ladder(run))
        for run, reference in zip(runs, found, strict=True)
    ]


def _times_of_ladder(run: Run) -> Array:
    """The times that the runs of a ladder report, for all numbers of steps."""
    return np.unique(np.concatenate([replace(run, n_steps=n).times for n in run.experiment.steps]))


def reference_of(run: Run) -> Reference:
    """The reference for the error of `run`; computed once for all runs of its problem.

    For members of a sweep :func:`refined_references` checks the exact solutions.
    """
    return _reference_of(run.experiment, run.member)


@functools.lru_cache(maxsize=8)
def _reference_of(experiment: Experiment, member: Member | None) -> Reference:
    problem = Subject(experiment=experiment, member=member).problem
    if problem.scene is not None and experiment.observations.impacts:
        return _unknown(problem.scene, "none (a motion with impacts)")
    if member is not None and problem.exact is not None:
        return Reference(values=problem.exact, error=0.0, source=problem.exact_source)
    return find_reference(problem)


def find_reference(problem: AnyProblem) -> Reference:
    """The exact solution where it is known and passes a check, otherwise a reference run.

    The check compares an exact solution with two short runs. If these agree with each other but
    not with it, it is compared with the reference run, which replaces it where it differs by more
    than ten times the error of that run.

    The steps of the reference run are adaptive, whatever those of the ladder are. Its polynomials
    give the values, and the stated error is its difference from a run of another degree and
    tolerance. If it does not reach the end there are no values; the source says why.
    """
    (reference,) = find_references([problem])
    return reference


def find_references(problems: Sequence[AnyProblem]) -> list[Reference]:
    """:func:`find_reference` for each problem; exact solutions are checked together."""
    differences = _differences_from_exact(problems)
    return [_reference(one, differences.get(index)) for index, one in enumerate(problems)]


def _reference(problem: AnyProblem, difference: float | None) -> Reference:
    """The exact solution unless runs contradict it by a `difference`, else a reference run."""
    exact, scene, source = problem.exact, problem.scene, problem.exact_source
    known = None if exact is None else Reference(values=exact, error=0.0, source=source)
    if known is not None and (scene is None or difference is None):
        return known
    if scene is None:
        raise ValueError("reference: a derivative needs its exact value")
    if known is None and source == "none":
        is_given = scene.prescribed is not None
        return _unknown(scene, "none, the motion is given" if is_given else "none, as asked for")
    refined = _refined(scene)
    if known is not None and difference is not None:
        if not ERROR_FACTOR * refined.error < difference:
            return known
        source = f"the exact solution differs from it by {difference:.0e} and is not used"
    elif source == "unknown":
        return refined
    return replace(refined, source=f"{refined.source}; {source}")


def _differences_from_exact(problems: Sequence[AnyProblem]) -> dict[int, float]:
    """Differences of exact solutions from runs where they are significant, by index of problem.

    A difference is significant if two runs agree to a tenth of it, and it is more than
    :data:`CHECK_TOLERANCE` times the motion.
    """
    held = {k: one for k, one in enumerate(problems) if isinstance(one, Problem) and one.exact}
    if not held:
        return {}
    scenes = [one.scene for one in held.values()]
    pairs = (integrate_members(scenes, CHECK_METHOD, n, with_steps=True) for n in CHECK_STEPS)
    found: dict[int, float] = {}
    for (k, problem), coarse, fine in zip(held.items(), *pairs, strict=True):
        if problem.exact is None or fine.steps is None or {coarse.status, fine.status} != {"ok"}:
            continue
        with np.errstate(all="ignore"):
            own = np.abs(fine(coarse.time) - coarse.position).max()
            difference = float(np.abs(problem.exact(fine.time) - fine.position).max())
        least = max(own, CHECK_TOLERANCE / ERROR_FACTOR * float(np.abs(fine.position).max()))
        if not difference <= ERROR_FACTOR * least:
            found[k] = difference if math.isfinite(difference) else math.inf
    return found


def _unknown(scene: Scene, source: str) -> Reference:
    """A reference without values, with the reason."""

    def values(times: Array) -> Array:
        return np.full((times.size, scene.dimension), np.nan)

    return Reference(values=values, error=math.nan, source=source)


def _refined(scene: Scene) -> Reference:
    """Polynomials of a run with adaptive steps, for any times."""
    guess = likely_amplitude(scene) or 1.0
    better, worse = (adaptive_runs(scene, degree, most_steps=MOST_STEPS) for degree in (8, 10))
    last = better(SCALE_TOLERANCE * guess)
    scale = float(np.abs(last.position).max()) or guess
    # beside kinks two runs may agree by accident
    factors = (3.0, 10.0) if is_steep(scene) else (3.0,)
    for tolerance in TOLERANCES if last.status == "ok" else ():
        last = better(tolerance * scale)
        runs = [last]
        for factor in factors:
            if last.status == "ok":
                last = worse(factor * tolerance * scale)
                runs.append(last)
        if last.status != "ok":
            continue
        fine, *others = (run.steps for run in runs if run.steps is not None)
        times = np.unique(np.concatenate([fine.time, *(one.time for one in others)]))
        error = max(float(np.abs(fine(times) - one(times)).max()) for one in others)
        # so loose that round-off does not change the words
        bound = round_up(max(2.0 * error, 10.0 * SUFFICIENT * scale, 1e-300))
        words = f"gauss-s8-none, adaptive steps, estimated error below {bound}"
        return Reference(values=fine, error=error, source=f"reference run ({words})")
    reason = f"the reference run {last.status}: {last.message}"
    return _unknown(scene, f"{WITHOUT_END}, and {reason})")
