"""What accuracy costs: time, memory and work of every method on every number of steps.

Everything is measured in this process, one run after the other. The caches of the package (rules,
tableaux, expansions) are emptied before every timed run, so that the set-up time is that of a first
run; it does not include the import of modules, since every run is computed once before.
"""

from __future__ import annotations

import copy
import functools
import gc
import math
import statistics
import sys
import time
import tracemalloc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from fvi_cli.effects.scene import Derivative
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.trajectory import Outcome, Trajectory
from fvi_cli.studies.experiment import Experiment, FinishedRun, Observed, Run, lookup_case
from fvi_cli.studies.norms import Norm, error_norm, point_weights
from fvi_cli.studies.reference import Reference, reference_of
from fvi_cli.studies.study import execute
from fvi_cli.studies.tolerance.search import solve

LONG_SECONDS = 2.0
"""Runs and searches that take longer are timed once."""

LEAST_REPEATS = 5
MOST_REPEATS = 25
ENOUGH_SECONDS = 0.25
"""Shorter runs are repeated until they have taken this long together."""

TOLERANCES = tuple(10.0**-k for k in range(3, 12, 2))
"""1e-3, 1e-5, ... 1e-11: the tolerances whose searches are timed."""

SEARCHES = 3


@dataclass(frozen=True, kw_only=True)
class CostRow:
    """One method on one number of steps; the defaults stand for a run without measurements."""

    n_steps: int
    step_size: float
    status: Observed
    error: float = math.nan
    floor: float = 0.0
    """The floor in the experiment's norm; errors below are round-off or those of the reference."""
    setup_seconds: float = math.nan
    """Time of a run before its first step (weights, rates, matrices): least of the repeats."""
    stepping_seconds_min: float = math.nan
    stepping_seconds_median: float = math.nan
    storage_seconds: float = math.nan
    """Time to write the run into a result file; nan where this was not requested."""
    spread: float = math.nan
    """Interquartile range of the stepping times over their median; nan for a single one."""
    repeats: int = 0
    peak_memory_bytes: int = 0
    """Traced peak of one more run."""
    history_operations: int = 0
    newton_iterations: int = 0
    """Work as it was counted."""
    message: str = ""

    @property
    def seconds(self) -> float:
        """Set-up plus stepping: what the user waits for."""
        return self.setup_seconds + self.stepping_seconds_min

    @property
    def is_usable(self) -> bool:
        """Whether the run reached an accuracy that is worth its time."""
        return self.status in ("ok", "floor") and math.isfinite(self.error)


@dataclass(frozen=True, kw_only=True)
class CostCase:
    """The rows of one method, steps increasing."""

    method: AnyMethod
    rows: tuple[CostRow, ...]


@dataclass(frozen=True, kw_only=True)
class ToleranceRow:
    """The cost of a run for a tolerance, its search included."""

    tolerance: float
    """Largest permitted error of the position at any time, in the unit of the position."""
    outcome: Outcome
    error: float
    """Error at the points of the finest ladder, in the experiment's norm."""
    estimate: float
    """The error at any time, as the search estimates it."""
    n_steps: int
    degree: int
    """Steps and stages of the run that was delivered."""
    rounds: int
    """Runs of the search."""
    seconds: float
    """Time of the whole search, from a cold start; least of the repeats."""


@dataclass(frozen=True, kw_only=True)
class CostTable:
    """The cost of the methods of one experiment."""

    experiment: str
    equation: str
    reference: str
    """Name, equation of motion, and the reference of the errors."""
    gamma: str
    """Orders of the damping, joined by ``;``."""
    derivative: Derivative
    norm: Norm
    final_time: float
    cases: tuple[CostCase, ...]
    """One per method, in the order of the configuration."""
    by_tolerance: tuple[ToleranceRow, ...] = ()
    """The runs for tolerances, in addition to the ladders."""
    has_laws: bool = False
    """Whether relaxation laws are part of the damping."""
    expect: Mapping[str, str] = field(default_factory=dict)
    """Known failures, as in :attr:`Experiment.expect`."""
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def unexpected(self) -> list[str]:
        """One line for every run that failed although the configuration did not say so."""
        return [
            f"{self.experiment} {method_name(case.method)}, N={row.n_steps}: {row.status}"
            + (f" ({row.message})" if row.message else "")
            for case in self.cases
            if lookup_case(self.expect, case.method) is None
            for row in case.rows
            if row.status not in ("ok", "floor")
        ]

    @property
    def has_memory(self) -> bool:
        """Whether the damping has a memory over which some method sums."""
        orders = [] if self.gamma == "-" else [float(order) for order in self.gamma.split(";")]
        return (self.has_laws or any(order != 1 for order in orders)) and any(
            row.history_operations for case in self.cases for row in case.rows
        )


Store = Callable[[FinishedRun], object]


def measure_cost(
    run: Run, store: Store | None = None, reference: Reference | None = None
) -> CostRow:
    """Time, memory and work of one run; with `store` also the time to write it.

    The run is computed once before: imports, and first access to pages of memory, are not part of
    the measurement. A `reference` that is not given is found here.
    """
    finished = execute(run, reference=reference)
    trajectory = finished.trajectory
    timings: list[tuple[float, float]] = []
    peak, storage = 0, math.nan
    if finished.status != "refused":
        timings = _timings(run)
        peak = traced_peak_bytes(lambda: integrate(run.scene, run.method, run.steps))
    setups = [wall - stepping for wall, stepping in timings]
    steppings = [stepping for _, stepping in timings]
    if store is not None:
        began = time.perf_counter()
        store(finished)
        storage = time.perf_counter() - began
    return CostRow(
        n_steps=run.n_steps,
        step_size=run.step_size,
        error=finished.error,
        floor=finished.floor,
        setup_seconds=min(setups, default=math.nan),
        stepping_seconds_min=min(steppings, default=math.nan),
        stepping_seconds_median=statistics.median(steppings) if steppings else math.nan,
        storage_seconds=storage,
        spread=_spread(steppings),
        repeats=len(steppings),
        peak_memory_bytes=peak,
        history_operations=trajectory.history_operations,
        newton_iterations=trajectory.newton.iterations,
        status=finished.status,
        message=trajectory.message,
    )


def measure_tolerance(
    finest: Run, tolerance: float, reference: Reference | None = None
) -> ToleranceRow:
    """Time the search for a tolerance; its error is taken at the points of the `finest` run.

    Raises
    ------
    ValueError
        If the experiment has no scene.
    """
    experiment, scene, seconds = finest.experiment, finest.scene, math.inf
    found: list[Trajectory] = []

    def search() -> Trajectory:
        found[:] = [solve(scene, tolerance=tolerance)]
        return found[0]

    for _ in range(SEARCHES):
        seconds = min(seconds, timed_run(search)[0])
        if seconds > LONG_SECONDS:
            break
    (run,) = found
    if run.assessment is None or run.steps is None:
        raise ValueError(f"{experiment.name}: no run was made")
    error = math.nan
    if run.status == "ok":
        times = finest.times
        exact = (reference or reference_of(finest)).values(times)
        weights = point_weights(times, finest.step_size, 1, experiment.grading)
        error = error_norm(run.steps(times), exact, weights, experiment.norm)
    return ToleranceRow(
        tolerance=tolerance,
        outcome=run.assessment.outcome,
        error=error,
        estimate=run.assessment.estimate,
        n_steps=run.n_steps,
        degree=run.steps.tables.degree,
        rounds=len(run.assessment.attempts),
        seconds=seconds,
    )


def cost_table(
    experiment: Experiment, rows: Sequence[CostRow], by_tolerance: Sequence[ToleranceRow] = ()
) -> CostTable:
    """The rows of all runs by method, steps increasing, and the rows of the tolerances."""
    first, count = experiment.runs()[0], len(experiment.steps)
    return CostTable(
        experiment=experiment.name,
        equation=first.problem.equation,
        reference=reference_of(first).source,
        gamma=";".join(f"{term.order:g}" for term in first.scene.active_damping) or "-",
        derivative=first.scene.derivative,
        norm=experiment.norm,
        final_time=first.scene.final_time,
        cases=tuple(
            CostCase(method=method, rows=tuple(rows[k * count : (k + 1) * count]))
            for k, method in enumerate(experiment.methods)
        ),
        by_tolerance=tuple(by_tolerance),
        has_laws=bool(first.scene.active_laws),
        expect=experiment.expect,
        units=experiment.units,
    )


def timed_run(action: Callable[[], Trajectory]) -> tuple[float, float]:
    """Wall time of `action` from a cold start, and the stepping time that its result states."""
    clear_caches()
    # objects of the last run are young; a full collection would take longer than many runs
    gc.collect(1)
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        began = time.perf_counter()
        trajectory = action()
        return time.perf_counter() - began, trajectory.stepping_seconds
    finally:
        if was_enabled:
            gc.enable()


def _timings(run: Run) -> list[tuple[float, float]]:
    """Pairs (wall time, stepping time) of repeats; empty if no step could be made."""
    found: list[tuple[float, float]] = []
    while len(found) < MOST_REPEATS:
        # the copy lacks the factors of the mass that an earlier run has left in the scene
        scene = replace(run.scene, inertia=copy.copy(run.scene.inertia))
        found.append(timed_run(functools.partial(integrate, scene, run.method, run.steps)))
        is_enough = len(found) >= LEAST_REPEATS and sum(wall for wall, _ in found) > ENOUGH_SECONDS
        if found[0][0] > LONG_SECONDS or is_enough:
            break
    return found if any(stepping for _, stepping in found) else []


def _spread(seconds: list[float]) -> float:
    if len(seconds) < 2:
        return math.nan
    lower, middle, upper = statistics.quantiles(seconds, n=4, method="inclusive")
    return (upper - lower) / middle


def traced_peak_bytes(action: Callable[[], object]) -> int:
    """Traced peak memory of `action`."""
    clear_caches()
    gc.collect()
    tracemalloc.start()
    try:
        action()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


_FORGETFUL = ("fvi_cli.mathematics.", "fvi_cli.effects.", "fvi_cli.integrator.")


def clear_caches() -> None:
    """Empty every cache of the floors that integrate: the next run begins cold."""
    for name, module in list(sys.modules.items()):
        if name.startswith(_FORGETFUL):
            for kept in vars(module).values():
                if isinstance(kept, functools._lru_cache_wrapper):
                    kept.cache_clear()
