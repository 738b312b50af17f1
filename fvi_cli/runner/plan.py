"""Plans: what would be done with every run of a request, and why."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fvi_cli.config.memory import run_bytes, shortage
from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS
from fvi_cli.errors import RequestError
from fvi_cli.integrator.members import companions
from fvi_cli.integrator.method import Method
from fvi_cli.planning.plan import Plan, plan_run
from fvi_cli.planning.seconds import (
    MOST_SECONDS,
    MOST_WITH_IMPACTS,
    Timing,
    short_job,
    time_job,
)
from fvi_cli.runner.executors.batches import batches_of, pack_size
from fvi_cli.runner.executors.jobs import crash
from fvi_cli.runner.parts.shard import shard_named
from fvi_cli.runner.request import Request, Source, requested
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import Why, reusable, stored_runs
from fvi_cli.studies.experiment import Experiment, Predicted, Run
from fvi_cli.studies.reference import (
    MOST_STEPS,
    REFERENCE_METHOD,
    first_steps,
    needs_refined_run,
)
from fvi_cli.studies.study import prediction_of

MOST_ALIKE = 1024
"""The batch of a member is searched among so many members of a sweep."""

_SEARCH = "steps are chosen during the run, for {}; a second run estimates the error"


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedRun:
    """The plan for one run."""

    run: Run
    # "reuse" a stored result, "compute", "refuse", or "leave out" (a run that is missing in the
    # result file of the request)
    action: str
    # to reuse: stored; to compute: new, older solver, changed: problem.stiffness (see
    # fvi_cli.storage.Reasons), or --fresh; to refuse: refused: and
    # the prediction; to leave out: not in the file
    reason: str
    predicted: Predicted

    @property
    def finds_steps(self) -> bool:
        """Whether a search will choose method and number of steps, which are not known now."""
        return self.run.experiment.accuracy is not None and self.action != "reuse"


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """The plan of a run, and its seconds on this machine; None: not known."""

    plan: Plan
    seconds: float | None = None


def plan(
    source: Source,
    *,
    output: Path | str = "results",
    workers: int = 1,
    fresh: bool = False,
    allow_unstable: bool = False,
    shard: str = "1/1",
) -> list[PlannedRun]:
    """What :func:`run` would do with every run, why, and the prediction; writes no file."""
    settings = Settings(output=Path(output), workers=workers, fresh=fresh, shard=shard_named(shard))
    request = requested(source, allow_unstable=allow_unstable)
    check_memory_together(request, settings)
    plans = []
    with stored_runs(request, settings) as (store, why):
        runs = [run for own in settings.runs_of(request).values() for run in own]
        for run in runs:
            earlier = reusable(store.finished(run), request)
            action, reason = "reuse", "stored"
            predicted: Predicted = "unknown"
            if earlier is not None:
                run, predicted = earlier.run, earlier.predicted
            elif run.experiment.accuracy is not None:
                action = "compute" if request.stored is None else "leave out"
                reason = _SEARCH.format(run.experiment.accuracy.words)
            else:
                action, reason, predicted = _missing(run, why, request)
            plans.append(PlannedRun(run=run, action=action, reason=reason, predicted=predicted))
    return plans


def _missing(run: Run, why: Why, request: Request) -> tuple[str, str, Predicted]:
    """Action, reason and prediction for a run that is not stored."""
    try:
        prediction = prediction_of(run)
    except Exception as error:
        return "compute", f"{why(run)}; no prediction: {crash(error).message}", "unknown"
    verdict = prediction.verdict
    if request.stored is not None:
        return "leave out", "not in the file", verdict
    if verdict == "unstable" and not run.experiment.allow_unstable:
        return "refuse", f"refused: {prediction.reason}", verdict
    return "compute", why(run), verdict


def group_alike(plans: Sequence[PlannedRun]) -> list[list[PlannedRun]]:
    """Groups of plans: members with the same plan form one group, any other plan its own."""
    groups: dict[tuple[object, ...], list[PlannedRun]] = {}
    for plan in plans:
        run = plan.run
        shared = (run.experiment, run.method, run.n_steps, plan.action, plan.predicted, plan.reason)
        groups.setdefault((run,) if run.member is None else shared, []).append(plan)
    return list(groups.values())


def forecast_runs(plans: Sequence[PlannedRun]) -> dict[Run, Forecast]:
    """Forecasts for runs on given steps; with seconds for those that would be computed.

    Processor seconds are measured on the finest steps of every method. Each run has its share of
    the time of the references.
    """
    known = [one for one in plans if not one.finds_steps]
    found = {run: Forecast(plan=plan) for run, plan in engine_plans([p.run for p in known]).items()}
    computed = [p.run for p in known if p.run in found and p.action == "compute"]
    timings: dict[object, Timing | None] = {}
    shares: dict[Experiment, float] = {}
    for alike in sorted(_alike(computed), key=lambda alike: -alike[0].n_steps):
        first, batch = alike[0], batches_of(alike[:MOST_ALIKE])[0]
        key, experiment = (first.experiment, first.method), first.experiment
        if key not in timings:
            timings[key] = None
            with contextlib.suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
                timings[key] = _timing(batch, found[first].plan)
                if experiment not in shares:
                    n_sharing = sum(one.experiment is experiment for one in computed)
                    n_scenes = max(1, len(experiment.members))
                    shares[experiment] = _reference_seconds(batch) * n_scenes / n_sharing
        timing = timings[key]
        if timing is not None:
            seconds = timing.at(first.n_steps) + shares.get(experiment, 0.0)
            found |= {run: Forecast(plan=found[run].plan, seconds=seconds) for run in alike}
    return found


def _reference_seconds(batch: Sequence[Run]) -> float:
    """Seconds of the refined runs of a scene on grids: two, and half the time a third (guessed)."""
    experiment, first = batch[0].experiment, batch[0]
    n_steps = first_steps(math.lcm(*experiment.steps))
    # an exact solution is checked by short runs only
    is_refined = needs_refined_run(first) and first.problem.exact is None
    if not is_refined or 2 * n_steps > MOST_STEPS or experiment.grading != 1.0:
        return 0.0
    scenes = [one.scene for one in batch]
    if companions(scenes, REFERENCE_METHOD, n_steps)[0] == 1:
        scenes = scenes[:1]
    job = short_job(scenes, REFERENCE_METHOD, 2 * n_steps)
    timing = time_job(job, 2 * n_steps, n_runs=len(scenes))
    return timing.at(n_steps) + 2.0 * timing.at(2 * n_steps)


def engine_plans(runs: Sequence[Run]) -> dict[Run, Plan]:
    """Integration plans of runs on given steps; all members get the plan of the first."""
    found: dict[Run, Plan] = {}
    for alike in _alike([run for run in runs if run.problem.scene is not None]):
        batch = batches_of(alike[:MOST_ALIKE])[0]
        first = batch[0]
        plan = plan_run(
            first.scene,
            first.method,
            first.n_steps,
            every=first.experiment.store_every,
            members=companions([run.scene for run in batch], first.method, first.n_steps)[0],
            is_diagnosed=not first.experiment.diagnostics.is_empty,
            grading=first.experiment.grading,
        )
        found |= dict.fromkeys(alike, plan)
    return found


def _alike(runs: Sequence[Run]) -> list[list[Run]]:
    """Groups of runs: members with one method and N form one group, any other run its own."""
    groups: dict[object, list[Run]] = {}
    for run in runs:
        is_single = run.member is None
        groups.setdefault(
            run if is_single else (run.experiment, run.method, run.n_steps), []
        ).append(run)
    return list(groups.values())


def _timing(batch: Sequence[Run], plan: Plan) -> Timing:
    """Measure the beginning of a batch; seconds of one member."""
    run, experiment = batch[0], batch[0].experiment
    # members that are integrated individually take the same time: measure one
    together = batch if plan.members > 1 and experiment.diagnostics.is_empty else batch[:1]
    job = short_job(
        [one.scene for one in together],
        run.method,
        run.n_steps,
        every=experiment.store_every,
        diagnostics=experiment.diagnostics if isinstance(run.method, Method) else NO_DIAGNOSTICS,
        observations=[one.observations for one in together],
        grading=experiment.grading,
    )
    return time_job(
        job,
        run.n_steps,
        n_runs=len(together),
        is_quadratic=bool(plan.history_operations) and plan.mesh.n_lags == plan.mesh.n_steps,
        most_seconds=MOST_WITH_IMPACTS if run.observations.impacts else MOST_SECONDS,
    )


def check_memory_together(request: Request, settings: Settings) -> None:
    """Refuse if the longest runs do not fit in memory together; single runs are checked before."""
    if settings.workers == 1 or request.stored is not None:
        return
    sizes = [
        run_bytes(one, method, n_steps, members=pack_size(one))
        for one in request.loaded.experiments
        for method in one.methods
        for n_steps in one.steps
    ]
    if words := shortage(sum(sorted(sizes)[-settings.workers :]), " at the same time"):
        raise RequestError(
            f"--workers {settings.workers}: the longest runs of {request.name} {words}; fewer "
            "processes need less"
        )
