"""References for errors: an exact solution, or a dense run with an estimate of its error."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.problem import AnyProblem
from fvi_cli.studies.experiment import Experiment, Run
from fvi_cli.studies.members import Member
from fvi_cli.studies.norms import round_up
from fvi_cli.studies.settings import Accuracy
from fvi_cli.studies.tolerance.search import solve_by_two_runs

NEARLY_EXACT: Final = Accuracy(relative=2e-14)
"""Tolerance of a dense run; where it is out of reach the run with the least error is taken."""
WITHOUT_END: Final = "none (no exact solution is known"
TIMES_DIFFER: Final = 1e-12
"""Times of runs may differ by round-off, relative to the last."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Values with which the runs of a ladder are compared."""

    values: Callable[[Array], Array]
    """Function of times, shape ``(n,)`` to ``(n, d)``: an exact solution, a dense run, or
    :class:`Tabulated`; nan where nothing is known."""
    error: float
    """Estimated error of the values in the maximum norm: 0 for an exact solution; nan where nothing
    is known."""
    source: str  # description for readers of tables

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


def needs_dense_run(run: Run) -> bool:
    """Whether the error is measured against a dense run."""
    experiment = run.experiment
    is_unknown = experiment.problem.exact_source == "unknown"
    return is_unknown and not (run.is_search or experiment.observations.impacts)


def tabulated_references(runs: Sequence[Run]) -> list[Reference]:
    """The reference for the scene of each run of one experiment, at the times of its ladder."""
    return [find_reference(run.problem).tabulated(_times_of_ladder(run)) for run in runs]


def _times_of_ladder(run: Run) -> Array:
    """The times that the runs of a ladder report, for all numbers of steps."""
    return np.unique(np.concatenate([replace(run, n_steps=n).times for n in run.experiment.steps]))


def reference_of(run: Run) -> Reference:
    """The reference for the error of `run`; computed once for all runs of its problem."""
    return _reference_of(run.experiment, run.member)


@functools.lru_cache(maxsize=8)
def _reference_of(experiment: Experiment, member: Member | None) -> Reference:
    problem = (member or experiment).problem
    if problem.scene is not None and experiment.observations.impacts:
        return _unknown(problem.scene, "none (a motion with impacts)")
    return find_reference(problem)


def find_reference(problem: AnyProblem) -> Reference:
    """The exact solution where it is known, otherwise a dense run by :func:`solve`.

    The steps of that run are adaptive, whatever those of the ladder are. Its polynomials give the
    values, and the stated error is its estimate. If it does not reach the end there are no values;
    the source says why.
    """
    if problem.exact is not None:
        return Reference(values=problem.exact, error=0.0, source=problem.exact_source)
    scene = problem.scene
    if problem.exact_source == "none":
        is_given = scene.prescribed is not None
        return _unknown(scene, "none, the motion is given" if is_given else "none, as asked for")
    run, _ = solve_by_two_runs(scene, NEARLY_EXACT)
    if run.status != "ok" or run.steps is None:
        reason = f"the reference run {run.status}: {run.message}"
        return _unknown(scene, f"{WITHOUT_END}, and {reason})")
    error, scale = run.error_estimate, float(np.abs(run.position).max())
    # so loose that round-off does not change the words
    bound = round_up(max(2.0 * error, 2e-13 * scale, 1e-300))
    words = f"gauss{run.steps.tables.degree}, adaptive steps, estimated error below {bound}"
    return Reference(values=run, error=error, source=f"reference run ({words})")


def _unknown(scene: Scene, source: str) -> Reference:
    """A reference without values, with the reason."""

    def values(times: Array) -> Array:
        return np.full((times.size, scene.dimension), np.nan)

    return Reference(values=values, error=math.nan, source=source)
