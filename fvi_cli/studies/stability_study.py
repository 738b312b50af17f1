"""Stability over steps and parameters: predictions and observations.

**Observed**: the scene without its forcing runs from random data for max(2000, 20 / growth) steps.
The method is unstable when the largest position in the last quarter of the steps exceeds that in
the first quarter by a factor of a thousand on top of the growth of the exact scene between the
two, and by a quarter more than that growth. A prediction for the same number of steps must agree.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.method_names import method_name
from fvi_cli.integrator.run.on_mesh import path_from
from fvi_cli.integrator.stability.limits import largest_stable_step
from fvi_cli.integrator.stability.linearisation import linearised_at_start
from fvi_cli.integrator.stability.patterns import has_patterns
from fvi_cli.integrator.stability.prediction import (
    RESOLVED,
    TOLERATED_GROWTH,
    StabilityPrediction,
    Verdict,
    predict_stability,
)
from fvi_cli.integrator.stability.region import StabilityMap, stability_map
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.experiment import Experiment, Run

FEWEST_STEPS = 2000
MOST_STEPS = 200_000
"""Most steps of an observation; slower growth than these steps can show is left unknown."""

MOST_VALUES = 4_000_000
"""Most values of an observation (steps times coordinates): larger scenes have fewer steps."""

LASTING = 1000
"""After so many times the final time every mode that grows at all is thought to show."""

_TIMES_E = 20.0
_LARGEST_LOGARITHM = 300.0  # energies, which are squares, must not overflow
_SEED = 20


@dataclass(frozen=True, kw_only=True)
class ObservedStability:
    """The observed growth of a run from random data."""

    verdict: Verdict
    """``stable``, ``unstable`` or ``unknown``, as the docstring of the module defines it."""
    n_steps: int
    growth_per_step: float
    """Logarithm of the growth from the first to the last quarter, per step; for a run that
    overflows up to there."""
    predicted: Verdict
    """The prediction for the same number of steps."""

    @property
    def agrees(self) -> bool | None:
        """Whether both verdicts are equal; None where one of them is unknown."""
        if "unknown" in (self.verdict, self.predicted):
            return None
        return self.verdict == self.predicted


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityRow:
    """One method on one member with one step size."""

    run: Run
    prediction: StabilityPrediction
    """The prediction for the configured run."""
    largest_stable_step: float
    """Largest step of the method such that all smaller ones are stable over the final time; nan
    where there is none, or no prediction."""
    lasting_step: float
    """The same over :data:`LASTING` times that time: no mode grows with smaller steps."""
    observation: ObservedStability | None = None
    """None where it was not requested, or is not possible."""
    failure: str = ""
    """Message of an internal error that prevented a result; else empty."""

    @property
    def verdict(self) -> Verdict:
        """The prediction; for a nonlinear scene that for its linearisation at the start."""
        if self.prediction.verdict == "unknown":
            return self.prediction.linearised_verdict
        return self.prediction.verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class StabilityTable:
    """The stability study of one experiment."""

    experiment: Experiment
    rows: tuple[StabilityRow, ...]
    regions: tuple[StabilityMap, ...] = ()

    @property
    def disagreements(self) -> tuple[StabilityRow, ...]:
        """Rows in which prediction and observation differ."""
        return tuple(
            row
            for row in self.rows
            if row.observation is not None and row.observation.agrees is False
        )


def stability_rows(
    experiment: Experiment,
    *,
    with_observation: bool,
    failed: Callable[[Run, Exception], str] | None = None,
) -> Iterator[StabilityRow]:
    """The stability of every run of the experiment; the runs are not computed.

    `failed` returns the message for an exception other than a `ValueError`, and the other runs are
    still examined; without it the exception is raised.

    Raises
    ------
    ValueError
        If nothing is integrated: a fractional derivative has no stability.
    """
    if experiment.problem.scene is None:
        raise ValueError(f"{experiment.name}: has no motion, and so no stability")
    limits: dict[tuple[str, int], tuple[float, float]] = {}
    for run in experiment.runs():
        try:
            yield _row(run, limits, with_observation=with_observation)
        except (ValueError, MemoryError):
            raise
        except Exception as error:
            if failed is None:
                raise
            message = failed(run, error)
            yield StabilityRow(
                run=run,
                prediction=StabilityPrediction(verdict="unknown", reason=message),
                largest_stable_step=math.nan,
                lasting_step=math.nan,
                failure=message,
            )


def _row(
    run: Run, limits: dict[tuple[str, int], tuple[float, float]], *, with_observation: bool
) -> StabilityRow:
    """One run; `limits` caches the largest stable steps by method and member."""
    scene = run.scene
    key = (run.method.case, run.member.number if run.member is not None else 0)
    if key not in limits:
        limits[key] = _limits(scene, run.method)
    observation = None
    if with_observation:
        observation = observe_growth(scene, run.method, run.n_steps)
    return StabilityRow(
        run=run,
        prediction=predict_stability(scene, run.method, run.n_steps),
        largest_stable_step=limits[key][0],
        lasting_step=min(limits[key][1], scene.final_time),
        observation=observation,
    )


def _limits(scene: Scene, method: AnyMethod) -> tuple[float, float]:
    """Largest stable steps over the scene's own time, and over a thousand times that."""
    prediction = predict_stability(scene, method, 1)
    if prediction.verdict == prediction.linearised_verdict == "unknown":
        return math.nan, math.nan
    longer = replace(scene, final_time=LASTING * scene.final_time)
    lasting = largest_stable_step(longer, method, fewest=LASTING) or math.nan
    if lasting >= scene.final_time:
        # a step that is stable over the longer time is stable over the shorter one, too
        return scene.final_time, lasting
    return largest_stable_step(scene, method) or math.nan, lasting


def observe_growth(scene: Scene, method: AnyMethod, n_steps: int) -> ObservedStability | None:
    """Observe how random data grow in steps of T / `n_steps`.

    None for a scene that cannot be linearised, and where the equations of a step have no unique
    solution.
    """
    h = scene.final_time / n_steps
    try:
        linear = linearised_at_start(scene)
    except ValueError:
        return None
    rest = np.zeros(linear.dimension)
    linear = replace(
        linear, forcing=None, initial_position=rest, initial_velocity=rest, final_time=h
    )
    over = replace(linear, final_time=h * FEWEST_STEPS)
    first = predict_stability(over, method, FEWEST_STEPS)
    count = FEWEST_STEPS
    if first.growth_per_step > first.exact_growth:
        count = int(max(count, _TIMES_E / (first.growth_per_step - first.exact_growth)))
    if first.exact_growth > 0:
        # so few steps that numbers do not overflow
        fastest = max(first.growth_per_step, first.exact_growth)
        count = int(max(8, min(count, _LARGEST_LOGARITHM / fastest)))
    count = min(count, MOST_STEPS, max(FEWEST_STEPS, MOST_VALUES // linear.dimension))
    over = replace(linear, final_time=h * count)
    predicted = predict_stability(over, method, count)
    try:
        sizes = _sizes_from_random_data(over, method, count)
    except np.linalg.LinAlgError:
        return None
    growth = _growth_between_quarters(sizes)
    excess = 0.75 * count * (growth - predicted.exact_growth)
    resolved = RESOLVED * 0.75 * count * predicted.exact_growth
    has_overflowed = sizes.size <= count
    is_unstable = has_overflowed or excess > max(math.log(TOLERATED_GROWTH), resolved)
    return ObservedStability(
        verdict="unstable" if is_unstable else "stable",
        n_steps=count,
        growth_per_step=growth,
        predicted=predicted.verdict,
    )


def _sizes_from_random_data(scene: Scene, method: AnyMethod, n_steps: int) -> Array:
    """Largest component at every time, up to the last finite one."""
    random = np.random.default_rng(_SEED)
    position, velocity = random.standard_normal((2, scene.dimension))
    with np.errstate(all="ignore"):
        plain = method
        if isinstance(method, Method):
            plain = replace(method, start="none", start_exponents=())
        if isinstance(plain, Method) and not plain.is_runge_kutta:
            path = path_from(scene, plain, n_steps, position, scene.inertia.mass @ velocity)
        else:
            moved = replace(scene, initial_position=position, initial_velocity=velocity)
            trajectory = integrate(moved, plain, n_steps)
            failure = trajectory.failure
            if trajectory.status == "failed" and (
                failure is None or failure.reason == "no unique solution"
            ):
                raise np.linalg.LinAlgError(trajectory.message)
            path = trajectory.position
        sizes = np.abs(path).max(axis=1)
    finite = np.isfinite(sizes)
    return np.asarray(sizes if finite.all() else sizes[: int(finite.argmin())])


def _growth_between_quarters(sizes: Array) -> float:
    """Logarithm of the growth of the largest value from the first to the last quarter, per step."""
    quarter = max(1, sizes.size // 4)
    first, last = sizes[:quarter].max(), sizes[-quarter:].max()
    if sizes.size <= quarter or not first > 0:
        return math.inf if last > 0 else 0.0
    return float(np.log(max(last, 1e-300)) - np.log(first)) / (0.75 * sizes.size)


def stability_maps(
    experiment: Experiment, advance: Callable[[str], object] = lambda doing: None
) -> tuple[StabilityMap, ...]:
    """The requested stability regions of an experiment, one for every order and method."""
    region, maps = experiment.stability.region, []
    if region is not None:
        stiffness, damping = np.array(region.stiffness), np.array(region.damping)
        for order, method in itertools.product(region.orders, distinct_regions(experiment.methods)):
            maps.append(stability_map(method, order, stiffness, damping))
            advance(f"region of {method_name(method)}")
    return tuple(maps)


def distinct_regions(methods: Sequence[AnyMethod]) -> list[AnyMethod]:
    """One method for each stability region: start and forcing do not change the region."""
    found: dict[object, AnyMethod] = {}
    for method in filter(has_patterns, methods):
        key: object = method
        if isinstance(method, Method):
            key = (method.cq, method.degree, method.rule, method.sampling)
        found.setdefault(key, method)
    return list(found.values())
