"""Plans: what would be done with every run of a request, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.config.memory import run_bytes, shortage
from fvi_cli.errors import RequestError
from fvi_cli.runner.executors.batches import pack_size
from fvi_cli.runner.executors.jobs import crash
from fvi_cli.runner.parts.shard import shard_named
from fvi_cli.runner.request import Request, Source, requested
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import reusable, stored_runs
from fvi_cli.studies.experiment import Predicted, Run
from fvi_cli.studies.study import prediction_of

_SEARCH = "steps are chosen during the run, for {}; a second run estimates the error"


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedRun:
    """The plan for one run."""

    run: Run
    # "reuse" a stored result, "compute", or "leave out" (a run that is missing in the result file
    # of the request)
    action: str
    # to reuse: stored; to compute: new; to leave out: not in the file
    reason: str
    predicted: Predicted

    @property
    def finds_steps(self) -> bool:
        """Whether a search will choose method and number of steps, which are not known now."""
        return self.run.experiment.accuracy is not None and self.action != "reuse"

    @property
    def memory_bytes(self) -> int | None:
        """Memory that the run takes by itself; None where its steps are not known."""
        run = self.run
        return None if self.finds_steps else run_bytes(run.experiment, run.method, run.n_steps)


def plan(
    source: Source,
    *,
    output: Path | str = "results",
    workers: int = 1,
    fresh: bool = False,
    shard: str = "1/1",
) -> list[PlannedRun]:
    """What :func:`run` would do with every run, why, and the prediction; writes no file."""
    settings = Settings(output=Path(output), workers=workers, fresh=fresh, shard=shard_named(shard))
    request = requested(source)
    check_memory_together(request, settings)
    plans = []
    with stored_runs(request, settings) as store:
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
                action, reason, predicted = _missing(run, request)
            plans.append(PlannedRun(run=run, action=action, reason=reason, predicted=predicted))
    return plans


def _missing(run: Run, request: Request) -> tuple[str, str, Predicted]:
    """Action, reason and prediction for a run that is not stored."""
    try:
        prediction = prediction_of(run)
    except Exception as error:
        return "compute", f"no prediction: {crash(error).message}", "unknown"
    verdict = prediction.verdict
    if request.stored is not None:
        return "leave out", "not in the file", verdict
    return "compute", "new", verdict


def group_alike(plans: Sequence[PlannedRun]) -> list[list[PlannedRun]]:
    """Groups of plans: members with the same plan form one group, any other plan its own."""
    groups: dict[tuple[object, ...], list[PlannedRun]] = {}
    for plan in plans:
        run = plan.run
        shared = (run.experiment, run.method, run.n_steps, plan.action, plan.predicted, plan.reason)
        groups.setdefault((run,) if run.member is None else shared, []).append(plan)
    return list(groups.values())


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
