"""What the commands have in common: compute or recall the runs of a request, keep them."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.config.memory import in_gigabytes, machine_bytes, predicted_bytes
from fvi_cli.errors import RequestError
from fvi_cli.experiments.batches import batches_of, execute_batch
from fvi_cli.experiments.cluster import DaskCluster
from fvi_cli.experiments.executor import Executor, InProcess, compute_batches
from fvi_cli.experiments.experiment import Experiment, FinishedRun, Predicted, Run
from fvi_cli.experiments.processes import LocalProcesses
from fvi_cli.experiments.study import prediction_of
from fvi_cli.output.storage import (
    NEW,
    Reasons,
    holds_runs,
    open_results,
    place_of,
    read_results,
)
from fvi_cli.progress import progress_bar
from fvi_cli.requests import STORED_SUFFIX, Request, gather
from fvi_cli.scenes.problem import Problem

__all__ = [
    "Outcome",
    "Plan",
    "Request",
    "Settings",
    "answer",
    "carry_out",
    "gather",
    "is_unexpected_failure",
    "plan",
]

_logger = logging.getLogger(__name__)

FRESH = "--fresh"

Known = Callable[[Run], FinishedRun | None]
Why = Callable[[Run], str]
Keep = Callable[[Sequence[FinishedRun]], object]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the options of a command ask for.

    Parameters
    ----------
    output
        Folder of results.
    workers
        Number of processes of this machine.
    dask
        Address of a Dask scheduler whose workers compute in their place.
    fresh
        Ignore stored runs.
    fail_fast
        Stop at the first unexpected failure.
    show_progress
        Draw a progress bar where there is a terminal.
    keep
        Write what is computed; otherwise nothing at all is written.
    may_replace
        Keep runs even where that replaces stored runs of another problem.

    Raises
    ------
    RequestError
        If processes and a scheduler are given at the same time.
    """

    output: Path
    workers: int = 1
    dask: str | None = None
    fresh: bool = False
    fail_fast: bool = False
    show_progress: bool = True
    keep: bool = True
    may_replace: bool = True

    def __post_init__(self) -> None:
        if self.dask is not None and self.workers > 1:
            raise RequestError("--workers and --dask: give one of them; a scheduler has its own")

    def executor(self) -> Executor:
        """Where runs are computed."""
        if self.dask is not None:
            return DaskCluster(address=self.dask)
        return LocalProcesses(workers=self.workers) if self.workers > 1 else InProcess()

    def path_of(self, request: Request) -> Path:
        """Where the runs of `request` are, or would be, stored."""
        return request.stored or self.output / f"{request.name}{STORED_SUFFIX}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What became of one experiment.

    Parameters
    ----------
    experiment
        What was asked for.
    finished
        Finished runs in the order of the experiment's own list.
    """

    experiment: Experiment
    finished: tuple[FinishedRun, ...]

    @property
    def unexpected(self) -> tuple[FinishedRun, ...]:
        """Runs that came to nothing although the configuration did not say so."""
        return tuple(f for f in self.finished if is_unexpected_failure(f))

    @property
    def missing(self) -> int:
        """Number of runs that were not computed."""
        return len(self.experiment.runs()) - len(self.finished)


def is_unexpected_failure(finished: FinishedRun) -> bool:
    """Whether the run failed and its configuration did not expect that."""
    if finished.status in ("ok", "floor"):
        return False
    return not finished.run.experiment.expects_failure(finished.run.method)


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
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
        (see :class:`fvi_cli.output.storage.Reasons`) or ``--fresh``; ``refused:`` and what is
        predicted; ``not in the file``.
    predicted
        ``stable``, ``unstable`` or ``unknown``.
    """

    run: Run
    action: str
    reason: str
    predicted: Predicted


def plan(requests: Sequence[Request], settings: Settings) -> list[Plan]:
    """Tell for every run of `requests` what would be done with it; nothing is written."""
    plans = []
    for request in requests:
        _check_memory(request, settings)
        _is_kept(request, settings)
        with _stored_runs(request, settings) as known, _reasons(request, settings) as why:
            for experiment in request.loaded.experiments:
                plans += [_plan(run, known, why, request) for run in experiment.runs()]
    return plans


def _plan(run: Run, known: Known, why: Why, request: Request) -> Plan:
    earlier = known(run)
    if earlier is not None:
        return Plan(run=run, action="reuse", reason="stored", predicted=earlier.predicted)
    prediction = prediction_of(run)
    if request.stored is not None:
        action, reason = "leave out", "not in the file"
    elif prediction.verdict == "unstable" and not run.experiment.allow_unstable:
        action, reason = "refuse", f"refused: {prediction.reason}"
    else:
        action, reason = "compute", why(run)
    return Plan(run=run, action=action, reason=reason, predicted=prediction.verdict)


def answer(request: Request, settings: Settings) -> list[Outcome]:
    """Recall or compute every run of one request; keep what is computed if that is wanted.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If as many runs as there are processes would take more memory than there is.
    """
    _check_memory(request, settings)
    experiments = request.loaded.experiments
    if request.stored is not None:
        return _recall(experiments, request.stored)
    if not _is_kept(request, settings):
        with _stored_runs(request, settings) as known:
            return carry_out(experiments, settings, title=request.name, known=known)
    with (
        open_results(settings.output, request.name, fresh=settings.fresh) as results,
        _reasons(request, settings) as why,
    ):

        def keep(batch: Sequence[FinishedRun]) -> None:
            results.add_batch(batch)

        try:
            return carry_out(
                experiments,
                settings,
                title=request.name,
                known=_never if settings.fresh else results.finished,
                why=why,
                keep=keep,
            )
        finally:
            # also on Ctrl-C: what is finished is there for the next time
            results.consolidate(request.loaded)


def _check_memory(request: Request, settings: Settings) -> None:
    """The longest runs must have room at the same time; one alone was looked at before."""
    available = machine_bytes()
    if settings.workers == 1 or request.stored is not None or available is None:
        return
    sizes = []
    for experiment in request.loaded.experiments:
        problem = experiment.problem
        dimension = problem.scene.dimension if isinstance(problem, Problem) else 1
        for method in experiment.methods:
            is_brief = getattr(method, "history", "") == "exponentials"
            every = experiment.store_every if is_brief else None
            sizes += [predicted_bytes(n, dimension, every=every) for n in experiment.steps]
    together = sum(sorted(sizes)[-settings.workers :])
    if together > available:
        raise RequestError(
            f"--workers {settings.workers}: the longest runs of {request.name} need about "
            f"{in_gigabytes(together)} of memory at the same time, this machine has "
            f"{in_gigabytes(available)}; fewer processes need less"
        )


def _is_kept(request: Request, settings: Settings) -> bool:
    """Whether runs are written; says so where stored runs of another problem are in their place."""
    path = settings.path_of(request)
    if request.stored is not None or not settings.keep or not holds_runs(path):
        return settings.keep
    with read_results(path) as results:
        others = results.of_another_problem(
            first for e in request.loaded.experiments for first in e.runs()[:1]
        )
    if others and settings.may_replace:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and are replaced; "
            "another name or --output keeps them",
            path,
            others,
        )
    elif others:
        _logger.warning(
            "%s: %d stored runs belong to another problem of this name and stay; "
            "what is computed now is not kept",
            path,
            others,
        )
    return settings.may_replace or not others


@contextlib.contextmanager
def _stored_runs(request: Request, settings: Settings) -> Iterator[Known]:
    """Look-up of stored runs that writes nothing."""
    path = settings.path_of(request)
    is_fresh = settings.fresh and request.stored is None
    if is_fresh or not holds_runs(path):
        yield _never
        return
    with read_results(path) as results:
        yield results.finished


@contextlib.contextmanager
def _reasons(request: Request, settings: Settings) -> Iterator[Why]:
    """Function that says why a run is computed that was not found; writes nothing."""
    path = settings.path_of(request)
    if settings.fresh:
        yield lambda run: FRESH
    elif not holds_runs(path):
        yield lambda run: NEW
    else:
        with read_results(path) as stored:
            asked = {place_of(run) for e in request.loaded.experiments for run in e.runs()}
            yield Reasons(stored=stored, asked=asked).of


def _recall(experiments: Sequence[Experiment], path: Path) -> list[Outcome]:
    """Read the runs of a result file, and compute nothing."""
    with read_results(path) as results:
        outcomes = []
        for experiment in experiments:
            found = [results.finished(run) for run in experiment.runs()]
            finished = tuple(one for one in found if one is not None)
            outcomes.append(Outcome(experiment=experiment, finished=finished))
    for outcome in outcomes:
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                path,
                outcome.missing,
                outcome.experiment.name,
            )
    return outcomes


def _never(run: Run) -> FinishedRun | None:
    """No run is known."""
    return None


def carry_out(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    title: str,
    known: Known = _never,
    keep: Keep | None = None,
    why: Why | None = None,
) -> list[Outcome]:
    """Recall or compute every run of `experiments`.

    Parameters
    ----------
    experiments
        What to do.
    settings
        How.
    title
        Beside the progress bar.
    known
        Gives back a run that was finished before, or None.
    keep
        Called with the runs of every batch that is computed, as soon as it is finished.
    why
        Says why a run is computed, for the log.
    """
    done: dict[Run, FinishedRun] = {}
    waiting: list[Run] = []
    listed = [(experiment, experiment.runs()) for experiment in experiments]
    for run in (run for _, runs in listed for run in runs):
        earlier = known(run)
        if earlier is None:
            waiting.append(run)
        else:
            done[run] = earlier
    _logger.info("%s: %d runs, %d of them stored", title, len(done) + len(waiting), len(done))
    if why is not None:
        _tell_reasons(title, waiting, why)
    computed = compute_batches(batches_of(waiting), execute_batch, executor=settings.executor())
    with (
        contextlib.closing(computed),
        progress_bar(title, len(waiting), wanted=settings.show_progress) as advance,
    ):
        for batch in computed:
            # what a dead worker did not tell is no result: the next time it is computed again
            if keep is not None and not batch.is_lost:
                keep(batch.finished)
            for finished in batch.finished:
                done[finished.run] = finished
                advance(finished.run.title)
                _report(finished)
            if settings.fail_fast and any(map(is_unexpected_failure, batch.finished)):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break
    return [
        Outcome(experiment=experiment, finished=tuple(done[run] for run in runs if run in done))
        for experiment, runs in listed
    ]


def _tell_reasons(title: str, waiting: Sequence[Run], why: Why) -> None:
    """How many runs are computed again for which reason."""
    counts: dict[str, int] = {}
    for run in waiting:
        reason = why(run)
        if reason not in (NEW, FRESH):
            _logger.debug("%s: %s", run.title, reason)
            counts[reason] = counts.get(reason, 0) + 1
    for reason, count in counts.items():
        _logger.info("%s: computed again: %d runs, %s", title, count, reason)


def _report(finished: FinishedRun) -> None:
    """One line for a run; loud when it failed unexpectedly."""
    level = logging.WARNING if is_unexpected_failure(finished) else logging.DEBUG
    message = finished.trajectory.message
    _logger.log(
        level,
        "%s: %s, error %.3g%s",
        finished.run.title,
        finished.status,
        finished.error,
        f" ({message})" if message else "",
    )
