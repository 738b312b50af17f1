"""The runs of a request: recalled or computed, and kept if that is wanted."""

from __future__ import annotations

import contextlib
import functools
import logging
from collections import Counter
from collections.abc import Hashable, Sequence

from fvi_cli.runner.executors.batches import one_by_one_words, search_title
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.jobs import Crash, FinishedJob, Job, Watch, jobs_of
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure, without_motion
from fvi_cli.runner.plan import check_memory
from fvi_cli.runner.progress import RunBar, run_bar
from fvi_cli.runner.request import Request
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import FRESH, Why, recall, resumed_at, reusable, stored_runs
from fvi_cli.storage import NEW, Store
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.members import Member
from fvi_cli.studies.reference import Reference
from fvi_cli.studies.study import needs_refined_run

_logger = logging.getLogger(__name__)


def run_request(request: Request, settings: Settings) -> list[Outcome]:
    """Recall or compute every run of one request; keep what is computed if that is wanted.

    Raises
    ------
    StorageError
        If results cannot be read or written.
    RequestError
        If as many runs as there are processes would take more memory than there is.
    """
    check_memory(request, settings)
    experiments = request.loaded.experiments
    is_kept = settings.keep and request.stored is None
    checkpoints = settings.checkpoints(request)
    with stored_runs(request, settings, writes=is_kept) as (store, why):
        if request.stored is not None:
            return recall(experiments, store)
        if settings.fresh and checkpoints is not None:
            every = (run for one in experiments for run in (*one.runs(), *one.searches()))
            checkpoints.remove(every)
        try:
            return compute_runs(
                experiments,
                settings,
                title=request.name,
                store=store,
                is_kept=is_kept,
                why=why,
                checkpoints=checkpoints,
            )
        finally:
            if is_kept:
                # also on Ctrl-C: what is finished is there for the next time
                # a part of few packs may be empty, which those who wait for its file need not know
                store.consolidate(request.loaded, even_empty=settings.shard.count > 1)


def compute_runs(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    title: str,
    store: Store,
    is_kept: bool,
    why: Why | None = None,
    checkpoints: CheckpointFolder | None = None,
) -> list[Outcome]:
    """Recall or compute every run of `experiments`.

    `title` stands beside the progress bar, `store` gives back what was finished before and, where
    that `is_kept`, is given what is computed; `why` says for the log why it is.
    """
    done: dict[Run, FinishedRun] = {}
    kept = (lambda one: one) if settings.keeps_motions else without_motion
    waiting: list[Run] = []
    listed = settings.shard.runs_of(experiments)
    for run in (run for runs in listed.values() for run in runs):
        found = store.finished(run)
        earlier = reusable(found) if run.is_search else found
        if earlier is None:
            waiting.append(run)
        else:
            done[run] = kept(earlier)
    _logger.info("%s: %d runs, %d of them stored", title, len(done) + len(waiting), len(done))
    if why is not None:
        _log_reasons(title, waiting, why)
    for words in {one_by_one_words(run.experiment) for run in waiting} - {""}:
        _logger.warning("%s: %s", title, words)
    begun: dict[Hashable, int] = {} if checkpoints is None else _resumed(waiting, checkpoints)
    # a single search says how far it is in lines of its own
    is_single_run = len(waiting) == 1 and waiting[0].is_search
    jobs = jobs_of(waiting, store.has_reference)
    references = _References(store=store, jobs=jobs, is_kept=is_kept)
    with (
        run_bar(
            title,
            len(waiting),
            sum(run.n_steps for run in waiting),
            wanted=settings.show_progress and not is_single_run,
            begun=begun,
        ) as bar,
        contextlib.closing(
            settings.executor(_watch(bar, title)).compute(
                jobs, functools.partial(execute_job, checkpoints=checkpoints), references.of
            )
        ) as computed,
    ):
        for one in computed:
            if one.job.is_reference:
                references.learn(one)
                continue
            # what a dead worker did not tell is no result: the next time it is computed again
            if is_kept and one.stored:
                store.add(one.stored)
            for run, finished in zip(one.job.runs, one.finished, strict=True):
                done[run] = kept(finished)
                bar.finished(_named(finished.run, title), one.job.runs[0], run.n_steps)
                _report(finished)
            references.forget(one.job)
            if settings.fail_fast and any(map(is_unexpected_failure, one.finished)):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break
    return [
        _outcome(experiment, [done[run] for run in runs if run in done])
        for experiment, runs in listed.items()
    ]


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
            if not isinstance(result, FinishedRun):
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


def _resumed(waiting: Sequence[Run], checkpoints: CheckpointFolder) -> dict[Hashable, int]:
    """Log which runs go on from a checkpoint; how many steps of them are done."""
    for search in (run for run in waiting if run.is_search):
        if words := checkpoints.resumed(search):
            _logger.info("%s: %s", search_title(search), words)
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
        if first.is_search:
            # how many steps it takes is not known
            return
        name = _named(first, title)
        share = f"{100 * done // n_steps} %"
        if n_steps == first.n_steps and not job.is_reference:
            within(f"{name}: {share}", first, done * len(job.runs))
        else:
            within(f"{name}: {share} of a reference", first, None)

    return watch


def _named(run: Run, title: str) -> str:
    """The run in one line, without the name of the experiment where that is said already."""
    return run.title.removeprefix(f"{title} ")


def _log_reasons(title: str, waiting: Sequence[Run], why: Why) -> None:
    """How many runs are computed again for which reason."""
    counts: dict[str, int] = {}
    for run in waiting:
        reason = NEW if run.is_search else why(run)
        if reason not in (NEW, FRESH):
            _logger.debug("%s: %s", run.title, reason)
            counts[reason] = counts.get(reason, 0) + 1
    for reason, count in counts.items():
        _logger.info("%s: computed again: %d runs, %s", title, count, reason)


def _report(finished: FinishedRun) -> None:
    """One line for a run; loud when it failed unexpectedly, or may be about to."""
    for remark in finished.trajectory.remarks:
        if remark.startswith(("stability:", "steps:")):
            _logger.warning("%s: %s", finished.run.title, remark)
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
