"""The runs of a request: read back or computed, and stored if that is requested."""

from __future__ import annotations

import contextlib
import itertools
import logging
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from fvi_cli.runner.executors.batches import one_by_one_words
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.jobs import (
    ComputeJob,
    Crash,
    FinishedJob,
    Job,
    jobs_of,
)
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure, without_motion
from fvi_cli.runner.parts.shard import shard_named
from fvi_cli.runner.plan import check_memory_together
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Source, gather, requested
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import (
    report_missing,
    reusable,
    stored_runs,
)
from fvi_cli.storage import Store
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.members import Member
from fvi_cli.studies.reference import Reference, needs_refined_run, remember

_logger = logging.getLogger(__name__)


def run(
    source: Source,
    *,
    output: Path | str | None = None,
    workers: int = 1,
    dask: str | None = None,
    fresh: bool = False,
    keep: bool = True,
    shard: str = "1/1",
    prune: bool = False,
    progress: bool = False,
    keeps_motions: bool = True,
) -> list[Outcome]:
    """Compute every run of a configuration, as ``fvi run`` does; a failed run raises no exception.

    Parameters
    ----------
    source
        As for :func:`load`.
    output
        Folder of ``<name>.h5``, whose runs are not computed again; None: no file is written.
    workers
        Number of processes; more than one needs the ``if __name__ == "__main__"`` guard.
    dask
        Address of a Dask scheduler whose workers compute in place of processes here.
    fresh, shard, prune
        As the options of the command line.
    keep
        Store the computed runs in `output`.
    progress
        Show a progress bar where there is a terminal.
    keeps_motions
        Return the points of members of a sweep; a summary does not need them.

    One outcome for every experiment; a failed run is among its finished runs, with its status.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If the longest runs, one for each process, do not fit in memory together.
    """
    settings = Settings(
        output=Path(output or "."),
        workers=workers,
        dask=dask,
        fresh=fresh or output is None,
        show_progress=progress,
        keep=keep and output is not None,
        keeps_motions=keeps_motions,
        shard=shard_named(shard),
    )
    request = requested(source)
    check_memory_together(request, settings)
    is_kept = settings.keep and request.stored is None
    with stored_runs(request, settings, writes=is_kept) as store:
        listed = settings.runs_of(request)
        kept = (lambda one: one) if settings.keeps_motions else without_motion
        done: dict[Run, FinishedRun] = {}
        waiting: list[Run] = []
        for one in itertools.chain.from_iterable(listed.values()):
            found = reusable(store.finished(one), request)
            if found is None:
                waiting.append(one)
            else:
                done[one] = kept(found)
        shown: set[tuple[str, str, str]] = set()

        def take(one: FinishedJob) -> None:
            # runs of a dead worker are not stored, so the next command computes them again
            if is_kept and one.stored:
                store.add(one.stored)
            for run, finished in zip(one.job.runs, one.finished, strict=True):
                done[run] = kept(finished)
                _report(finished, shown)

        prunes = False
        try:
            if request.stored is None:
                _log_waiting(request.name, len(done), waiting)
                compute_jobs(
                    jobs_of(waiting, store.has_reference),
                    settings,
                    title=request.name,
                    compute=execute_job,
                    take=take,
                    store=store,
                    is_kept=is_kept,
                )
                prunes = prune
        finally:
            if is_kept:
                # also after Ctrl-C: the next command finds the finished runs
                # a part may have no runs; its file is written all the same, for `fvi merge`
                store.consolidate(
                    request.loaded, even_empty=settings.shard.count > 1, prunes=prunes
                )
        outcomes = [
            _outcome(experiment, [done[run] for run in runs if run in done])
            for experiment, runs in listed.items()
        ]
        if request.stored is not None:
            report_missing(outcomes, store)
            for experiment, runs in listed.items():
                is_refined = runs and not experiment.members and needs_refined_run(runs[0])
                if is_refined and (reference := store.reference(runs[0])):
                    remember(experiment, reference)
        return outcomes


def recall(path: Path | str, *, overrides: Sequence[str] = ()) -> list[Outcome]:
    """Read the runs of a result file that its configuration requests; computes none.

    Parameters
    ----------
    path
        Result file.
    overrides
        Changes ``key.path=value`` of that configuration, for runs with other values in the file.

    Raises
    ------
    StorageError
        If the file cannot be read.
    """
    (request,) = gather([str(path)], overrides)
    return run(request, output=Path(path).parent)


def compute_jobs(
    jobs: Sequence[Job],
    settings: Settings,
    *,
    title: str,
    compute: ComputeJob,
    take: Callable[[FinishedJob], None],
    store: Store,
    is_kept: bool,
) -> None:
    """Compute the jobs of a command, with progress and references.

    `take` is called with every finished job. References are looked up in `store`; with `is_kept`
    computed references are stored there.
    """
    runs = [(job, run) for job in jobs if not job.is_reference for run in job.runs]
    references = _References(store=store, jobs=jobs, is_kept=is_kept)
    # a single search logs its progress itself
    is_single_search = len(runs) == 1 and runs[0][1].is_search
    with (
        progress_bar(
            title, len(runs), wanted=settings.show_progress and not is_single_search
        ) as done,
        contextlib.closing(settings.executor().compute(jobs, compute, references.of)) as computed,
    ):
        for one in computed:
            if one.job.is_reference:
                references.learn(one)
                continue
            take(one)
            for run, result in zip(one.job.runs, one.results, strict=True):
                found = result.run if isinstance(result, FinishedRun) else run
                done(_named(found.title, title))
            references.forget(one.job)


class _References:
    """References for errors: stored ones, and others in memory until the last run needs them."""

    def __init__(self, *, store: Store, jobs: Sequence[Job], is_kept: bool) -> None:
        self._store, self._is_kept = store, is_kept
        self._waiting = Counter(job.needs for job in jobs if job.needs is not None)
        self._found: dict[tuple[Experiment, Member | None], Reference | Crash | None] = {}

    def of(self, run: Run) -> Reference | Crash | None:
        """The reference of a run, or why there is none; None where it is not computed yet."""
        key = run.experiment, run.member
        if key in self._found:
            return self._found[key]
        return self._store.reference(run) if needs_refined_run(run) else None

    def learn(self, one: FinishedJob) -> None:
        """Keep the references that a job has computed."""
        pairs = list(zip(one.job.runs, one.results, strict=True))
        for run, result in pairs:
            if result is None or isinstance(result, Reference | Crash):
                self._found[run.experiment, run.member] = result
        if self._is_kept:
            found = [(run, result) for run, result in pairs if isinstance(result, Reference)]
            self._store.add_references(found)

    def forget(self, job: Job) -> None:
        """Release references that no further job needs."""
        needs = job.needs
        if needs is not None:
            self._waiting[needs] -= 1
            if not self._waiting[needs]:
                for run in needs.runs:
                    self._found.pop((run.experiment, run.member), None)


def _outcome(experiment: Experiment, finished: Sequence[FinishedRun]) -> Outcome:
    """The outcome; for a single search its experiment has the chosen method and steps."""
    is_chosen = experiment.needs_search and not experiment.members and finished
    own = finished[0].run.experiment if is_chosen else experiment
    return Outcome(experiment=own, finished=tuple(finished))


def _named(words: str, title: str) -> str:
    """A run in one line, without the name of the experiment if the title has it already."""
    return words.removeprefix(f"{title} ")


def _log_waiting(title: str, stored: int, waiting: Sequence[Run]) -> None:
    """Log how many runs are computed."""
    _logger.info("%s: %d runs, %d of them stored", title, stored + len(waiting), stored)
    for words in {one_by_one_words(one.experiment) for one in waiting} - {""}:
        _logger.warning("%s: %s", title, words)


def _report(finished: FinishedRun, shown: set[tuple[str, str, str]]) -> None:
    """Log a line for a run (a warning if it failed unexpectedly), and each of its remarks once."""
    run = finished.run
    for remark in finished.trajectory.remarks:
        alike = run.experiment.name, run.method.case, re.sub(r"[0-9.]+", "", remark)
        if alike not in shown:
            shown.add(alike)
            _logger.warning("%s: %s", run.title, remark)
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
