"""The runs of a request: recalled or computed, and kept if that is wanted."""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import re
from collections import Counter
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from fvi_cli.runner.executors.batches import one_by_one_words
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.jobs import (
    ComputeJob,
    Crash,
    FinishedJob,
    Job,
    Watch,
    jobs_of,
)
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure, without_motion
from fvi_cli.runner.parts.shard import shard_named
from fvi_cli.runner.plan import check_memory_together
from fvi_cli.runner.progress import RunBar, run_bar
from fvi_cli.runner.request import Source, gather, requested
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import (
    FRESH,
    Why,
    report_missing,
    resumed_at,
    reusable,
    stored_runs,
)
from fvi_cli.storage import NEW, Store
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.members import Member
from fvi_cli.studies.reference import Reference, needs_refined_run

_logger = logging.getLogger(__name__)


def run(
    source: Source,
    *,
    output: Path | str | None = None,
    workers: int = 1,
    dask: str | None = None,
    fresh: bool = False,
    fail_fast: bool = False,
    allow_unstable: bool = False,
    keep: bool = True,
    wait: bool = False,
    shard: str = "1/1",
    checkpoint_every: float = 60.0,
    progress: bool = False,
    keeps_motions: bool = True,
) -> list[Outcome]:
    """Compute every run of a configuration, as ``fvi run`` does; one that fails says so, no more.

    Parameters
    ----------
    source
        As for :func:`load`.
    output
        Folder of ``<name>.h5``, whose runs are not computed again; None: no file is written.
    workers
        Number of processes; more than one needs the ``if __name__ == "__main__"`` guard.
    dask
        Address of a Dask scheduler, whose workers compute in their place.
    fresh, fail_fast, allow_unstable, wait, shard, checkpoint_every
        As the options of the command line.
    keep
        Store what is computed in `output`.
    progress
        Show a progress bar where there is a terminal.
    keeps_motions
        Give the points of members of a sweep; a summary does without them.

    One outcome for every experiment; a run that failed is among its finished ones with its status.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If as many runs as there are processes would take more memory than there is.
    """
    settings = Settings(
        output=Path(output or "."),
        workers=workers,
        dask=dask,
        fresh=fresh or output is None,
        fail_fast=fail_fast,
        show_progress=progress,
        keep=keep and output is not None,
        checkpoint_seconds=checkpoint_every,
        waits=wait,
        keeps_motions=keeps_motions,
        shard=shard_named(shard),
    )
    request = requested(source, allow_unstable=allow_unstable)
    check_memory_together(request, settings)
    is_kept = settings.keep and request.stored is None
    with stored_runs(request, settings, writes=is_kept) as (store, why):
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

        def take(one: FinishedJob) -> bool:
            # a dead worker left no result: the next time it is computed again
            if is_kept and one.stored:
                store.add(one.stored)
            for run, finished in zip(one.job.runs, one.finished, strict=True):
                done[run] = kept(finished)
                _report(finished, shown)
            return any(map(is_unexpected_failure, one.finished))

        try:
            if request.stored is None:
                _log_waiting(request.name, len(done), waiting, why)
                checkpoints = settings.checkpoints(request)
                compute_jobs(
                    jobs_of(waiting, store.has_reference),
                    settings,
                    title=request.name,
                    compute=functools.partial(execute_job, checkpoints=checkpoints),
                    take=take,
                    store=store,
                    is_kept=is_kept,
                    begun=_begun(waiting, checkpoints, is_fresh=settings.fresh),
                )
        finally:
            if is_kept:
                # also on Ctrl-C: what is finished is there for the next time
                # a part of few packs may be empty, which those who wait for its file need not know
                store.consolidate(request.loaded, even_empty=settings.shard.count > 1)
        outcomes = [
            _outcome(experiment, [done[run] for run in runs if run in done])
            for experiment, runs in listed.items()
        ]
        if request.stored is not None:
            report_missing(outcomes, store)
        return outcomes


def recall(path: Path | str, *, overrides: Sequence[str] = ()) -> list[Outcome]:
    """Read the runs of a result file that its configuration asks for; computes none.

    Parameters
    ----------
    path
        Result file.
    overrides
        Changes ``key.path=value`` of that configuration, for runs of other values in the file.

    Raises
    ------
    StorageError
        If it cannot be read.
    """
    (request,) = gather([str(path)], overrides)
    return run(request, output=Path(path).parent)


def compute_jobs(
    jobs: Sequence[Job],
    settings: Settings,
    *,
    title: str,
    compute: ComputeJob,
    take: Callable[[FinishedJob], bool],
    store: Store,
    is_kept: bool,
    begun: Mapping[Hashable, int] = MappingProxyType({}),
) -> None:
    """Compute the jobs of a command: the one place for its progress, references and --fail-fast.

    `take` is given what a job came to, and says whether that is an unexpected failure. References
    are looked up in `store`, and those that are found are stored there if it `is_kept`; `begun` has
    the steps of runs that an earlier command has done.
    """
    runs = [(job, run) for job in jobs if not job.is_reference for run in job.runs]
    references = _References(store=store, jobs=jobs, is_kept=is_kept)
    # a single search says how far it is in lines of its own
    is_single_search = len(runs) == 1 and runs[0][1].is_search
    with (
        run_bar(
            title,
            len(runs),
            sum(run.n_steps for _, run in runs),
            wanted=settings.show_progress and not is_single_search,
            begun=begun,
        ) as bar,
        contextlib.closing(
            settings.executor(_watch(bar, title)).compute(jobs, compute, references.of)
        ) as computed,
    ):
        for one in computed:
            if one.job.is_reference:
                references.learn(one)
                continue
            is_failure = take(one)
            for run, result in zip(one.job.runs, one.results, strict=True):
                found = result.run if isinstance(result, FinishedRun) else run
                doing = one.job.title if one.job.kind == "cost" else found.title
                bar.finished(_named(doing, title), one.job.runs[0], run.n_steps)
            references.forget(one.job)
            if settings.fail_fast and is_failure:
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break


class _References:
    """What errors are measured against: stored, or in memory until the last run that needs it."""

    def __init__(self, *, store: Store, jobs: Sequence[Job], is_kept: bool) -> None:
        self._store, self._is_kept = store, is_kept
        self._waiting = Counter(job.needs for job in jobs if job.needs is not None)
        self._found: dict[tuple[Experiment, Member | None], Reference | Crash | None] = {}

    def of(self, run: Run) -> Reference | Crash | None:
        """The reference of a run, or why there is none; None where it is to be found yet."""
        key = run.experiment, run.member
        if key in self._found:
            return self._found[key]
        return self._store.reference(run) if needs_refined_run(run) else None

    def learn(self, one: FinishedJob) -> None:
        """Take in what a job has found."""
        pairs = list(zip(one.job.runs, one.results, strict=True))
        for run, result in pairs:
            if result is None or isinstance(result, Reference | Crash):
                self._found[run.experiment, run.member] = result
        if self._is_kept:
            found = [(run, result) for run, result in pairs if isinstance(result, Reference)]
            self._store.add_references(found)

    def forget(self, job: Job) -> None:
        """Let go of references that no further job needs."""
        needs = job.needs
        if needs is not None:
            self._waiting[needs] -= 1
            if not self._waiting[needs]:
                for run in needs.runs:
                    self._found.pop((run.experiment, run.member), None)


def _outcome(experiment: Experiment, finished: Sequence[FinishedRun]) -> Outcome:
    """The outcome; of a single search that of the experiment with what was chosen."""
    is_chosen = experiment.needs_search and not experiment.members and finished
    own = finished[0].run.experiment if is_chosen else experiment
    return Outcome(experiment=own, finished=tuple(finished))


def _begun(
    waiting: Sequence[Run], checkpoints: CheckpointFolder | None, *, is_fresh: bool
) -> dict[Hashable, int]:
    """How many steps of runs are done; says which go on from a checkpoint."""
    if checkpoints is None:
        return {}
    if is_fresh:
        checkpoints.remove(waiting)
    for search in (run for run in waiting if run.is_search):
        if words := checkpoints.resumed(search):
            _logger.info("%s: %s", search.name, words)
    begun: dict[Hashable, int] = {}
    runs = [one for one in waiting if not one.is_search]
    for run, reached in checkpoints.unfinished(runs).items():
        _logger.info("%s: %s", run.title, resumed_at(run, reached))
        begun[run] = reached
    return begun


def _watch(bar: RunBar, title: str) -> Watch | None:
    """Tell the bar how far a job is; the steps of what its errors are measured against apart."""
    within = bar.within
    if within is None:
        return None

    def watch(job: Job, done: int, n_steps: int) -> None:
        first = job.runs[0]
        # how many steps a search takes is not known, and the measurement of a cost has several runs
        if first.is_search or job.kind == "cost":
            return
        name = _named(first.title, title)
        share = f"{100 * done // n_steps} %"
        if n_steps == first.n_steps and not job.is_reference:
            within(f"{name}: {share}", first, done * len(job.runs))
        else:
            within(f"{name}: {share} of a reference", first, None)

    return watch


def _named(words: str, title: str) -> str:
    """A run in one line, without the name of the experiment where the title has it already."""
    return words.removeprefix(f"{title} ")


def _log_waiting(title: str, stored: int, waiting: Sequence[Run], why: Why) -> None:
    """How many runs are computed, how many of them again for which reason."""
    _logger.info("%s: %d runs, %d of them stored", title, stored + len(waiting), stored)
    counts: Counter[str] = Counter()
    for run in waiting:
        reason = NEW if run.is_search else why(run)
        if reason not in (NEW, FRESH):
            _logger.debug("%s: %s", run.title, reason)
            counts[reason] += 1
    for reason, count in counts.items():
        _logger.info("%s: computed again: %d runs, %s", title, count, reason)
    for words in {one_by_one_words(one.experiment) for one in waiting} - {""}:
        _logger.warning("%s: %s", title, words)


def _report(finished: FinishedRun, shown: set[tuple[str, str, str]]) -> None:
    """One line for a run, loud when it failed unexpectedly, and its remarks, those alike once."""
    run = finished.run
    for remark in finished.trajectory.remarks:
        alike = run.experiment.name, run.method.case, re.sub(r"[0-9.]+", "", remark)
        # tables of orders have the other remarks of a ladder, and nothing has those of a motion
        is_shown = remark.startswith(("stability:", "steps:")) or not run.observations.is_empty
        if is_shown and alike not in shown:
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
