"""What would be done with every run of a request, and why."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fvi_cli.config.memory import derivative_bytes, in_gigabytes, machine_bytes
from fvi_cli.errors import RequestError
from fvi_cli.planning.plan import planned_bytes
from fvi_cli.runner.executors.batches import pack_size
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.executor import crash
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import Chosen, Known, Why, resumed_at, reusable, stored_runs
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Predicted, Run
from fvi_cli.studies.study import prediction_of


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedRun:
    """What would be done with one run.

    Parameters
    ----------
    run
        The run.
    action
        ``reuse`` a stored result, ``compute``, ``refuse``, or ``leave out``: a result file was
        named, from which nothing is computed.
    reason
        Why: ``stored``; ``new``, ``incomplete``, ``older solver``, ``changed: problem.stiffness``
        (see :class:`fvi_cli.storage.Reasons`) or ``--fresh``; ``resume at step 4096 of 65536`` from
        a checkpoint; ``refused:`` and what is predicted; ``not in the file``.
    predicted
        ``stable``, ``unstable`` or ``unknown``.
    """

    run: Run
    action: str
    reason: str
    predicted: Predicted

    @property
    def finds_steps(self) -> bool:
        """Whether method and number of steps are found on the way, and not known now."""
        return self.run.experiment.accuracy is not None and self.action != "reuse"


def plan_runs(requests: Sequence[Request], settings: Settings) -> list[PlannedRun]:
    """Tell for every run of `requests` what would be done with it; nothing is written."""
    plans = []
    for request in requests:
        check_memory(request, settings)
        checkpoints = None if settings.fresh else settings.checkpoints(request)
        with stored_runs(request, settings) as (store, why):
            shared = settings.shard.runs_of(request.loaded.experiments)
            searched = settings.shard.searches_of(request.loaded.experiments)
            for experiment, runs in shared.items():
                begun = {} if checkpoints is None else checkpoints.unfinished(runs)
                plans += [_planned(run, store.finished, why, request, begun) for run in runs]
                own = searched[experiment]
                plans += [_search(one, request, store.chosen, checkpoints) for one in own]
    return plans


def _search(
    search: Run, request: Request, chosen: Chosen, checkpoints: CheckpointFolder | None
) -> PlannedRun:
    """The run that would be found for a tolerance, or the one that was."""
    earlier = reusable(chosen(search))
    if earlier is not None:
        run, predicted = earlier.run, earlier.predicted
        return PlannedRun(run=run, action="reuse", reason="stored", predicted=predicted)
    accuracy = search.experiment.accuracy
    words = "a tolerance" if accuracy is None else accuracy.words
    action = "compute" if request.stored is None else "leave out"
    reason = f"steps are found on the way, for {words}; a second run tells the error"
    if checkpoints is not None:
        reason = checkpoints.resumed(search) or reason
    return PlannedRun(run=search, action=action, reason=reason, predicted="unknown")


def _planned(
    run: Run, known: Known, why: Why, request: Request, begun: Mapping[Run, int]
) -> PlannedRun:
    earlier = known(run)
    if earlier is not None:
        return PlannedRun(run=run, action="reuse", reason="stored", predicted=earlier.predicted)
    try:
        prediction = prediction_of(run)
    except Exception as error:
        reason = f"{why(run)}; nothing is predicted: {crash(error).message}"
        return PlannedRun(run=run, action="compute", reason=reason, predicted="unknown")
    if request.stored is not None:
        action, reason = "leave out", "not in the file"
    elif prediction.verdict == "unstable" and not run.experiment.allow_unstable:
        action, reason = "refuse", f"refused: {prediction.reason}"
    else:
        action = "compute"
        reason = resumed_at(run, begun[run]) if run in begun else why(run)
    return PlannedRun(run=run, action=action, reason=reason, predicted=prediction.verdict)


def check_memory(request: Request, settings: Settings) -> None:
    """The longest runs must have room at the same time; one alone was looked at before."""
    available = machine_bytes()
    if settings.workers == 1 or request.stored is not None or available is None:
        return
    sizes: list[int] = []
    for experiment in request.loaded.experiments:
        problem = experiment.problem
        if not isinstance(problem, Problem):
            sizes += map(derivative_bytes, experiment.steps)
            continue
        together = pack_size(experiment) if experiment.members else 1
        sizes += [
            planned_bytes(
                problem.scene,
                method,
                n,
                every=experiment.store_every,
                members=together,
                diagnosed=not experiment.diagnostics.is_empty,
            )
            for method in experiment.methods
            for n in experiment.steps
        ]
    needed = sum(sorted(sizes)[-settings.workers :])
    if needed > available:
        raise RequestError(
            f"--workers {settings.workers}: the longest runs of {request.name} need about "
            f"{in_gigabytes(needed)} of memory at the same time, this machine has "
            f"{in_gigabytes(available)}; fewer processes need less"
        )
