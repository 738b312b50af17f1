"""Runs of experiments are computed, as the options of a command say, unless they are known."""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import math
import time
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence

from fvi_cli.runner.executors.batches import batches_of, execute_batch, one_by_one_words
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.executor import Batch, ComputeBatch, FinishedBatch, Watch
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure, without_motion
from fvi_cli.runner.progress import RunBar, run_bar
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import FRESH, Known, Why, resumed_at
from fvi_cli.storage import NEW
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

LONGEST_WAIT = 1.0
"""Seconds that a finished run waits to be kept together with others, at most."""

LARGEST_SHARE = 0.05
"""Of the time that keeping may take where runs are short."""

Keep = Callable[[Sequence[FinishedRun]], object]
"""Is given runs that are finished, before anybody is told of them."""


def compute_runs(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    title: str,
    known: Known = lambda run: None,
    keep: Keep | None = None,
    why: Why | None = None,
    checkpoints: CheckpointFolder | None = None,
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
        Called with the runs that are computed, soon after they are finished.
    why
        Says why a run is computed, for the log.
    checkpoints
        Where runs keep their checkpoints, and may have some from before.
    """
    done: dict[Run, FinishedRun] = {}
    kept = (lambda one: one) if settings.keeps_motions else without_motion
    waiting: list[Run] = []
    listed = settings.shard.runs_of(experiments)
    for run in (run for runs in listed.values() for run in runs):
        earlier = known(run)
        if earlier is None:
            waiting.append(run)
        else:
            done[run] = kept(earlier)
    _logger.info("%s: %d runs, %d of them stored", title, len(done) + len(waiting), len(done))
    if why is not None:
        _tell_reasons(title, waiting, why)
    batches = batches_of(waiting)
    for words in {one_by_one_words(run.experiment) for run in waiting} - {""}:
        _logger.warning("%s: %s", title, words)
    steps = sum(run.n_steps for run in waiting)
    begun: dict[Hashable, int] = {}
    if checkpoints is not None:
        for run, reached in checkpoints.unfinished(waiting).items():
            _logger.info("%s: %s", run.title, resumed_at(run, reached))
            begun[run] = reached
    compute: ComputeBatch = execute_batch
    if checkpoints is not None:
        compute = functools.partial(execute_batch, checkpoints=checkpoints)
    with (
        run_bar(
            title,
            len(waiting),
            steps,
            wanted=settings.show_progress,
            begun=begun,
        ) as bar,
        contextlib.closing(
            settings.executor(_watch(bar, title)).compute(batches, compute)
        ) as computed,
    ):
        sizes = [sum(run.n_steps for run in batch) for batch in batches]
        for together in _together(computed, sizes if settings.is_alone else ()):
            # what a dead worker did not tell is no result: the next time it is computed again
            results = [one for batch in together for one in batch.results]
            if keep is not None and results:
                keep(results)
            for batch in together:
                for finished in batch.finished:
                    done[finished.run] = kept(finished)
                    bar.finished(
                        _named(finished.run, title), batch.finished[0].run, finished.run.n_steps
                    )
                    _report(finished)
            if settings.fail_fast and any(map(_has_failed, together)):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break
    return [
        Outcome(experiment=experiment, finished=tuple(done[run] for run in runs if run in done))
        for experiment, runs in listed.items()
    ]


def _together(
    computed: Iterable[FinishedBatch], sizes: Sequence[int]
) -> Iterator[list[FinishedBatch]]:
    """Finished batches, several at a time where keeping each takes longer than computing it.

    They are given before an exception is passed on. What waits has taken less than
    :data:`LONGEST_WAIT`, and it does not wait for a batch that may take longer.

    Parameters
    ----------
    computed
        Batches, as they are finished.
    sizes
        Their steps, if they are computed one after the other; otherwise each is given at once.
    """
    together: list[FinishedBatch] = []
    begun = latest = time.monotonic()
    pause = 0.0
    following = itertools.chain(itertools.pairwise(sizes), itertools.repeat((1, math.inf)))
    try:
        for batch, (own, after) in zip(computed, following, strict=False):
            together.append(batch)
            now = time.monotonic()
            # the memory of a direct sum takes the square of the steps
            next_one = (now - latest) * max(1.0, after / own) ** 2
            latest = now
            limit = min(LONGEST_WAIT, pause / LARGEST_SHARE)
            if now - begun + next_one >= limit or _has_failed(batch):
                given, together = together, []
                yield given
                begun = latest = time.monotonic()
                pause = begun - now
    finally:
        if together:
            yield together


def _has_failed(batch: FinishedBatch) -> bool:
    return any(map(is_unexpected_failure, batch.finished))


def _watch(bar: RunBar, title: str) -> Watch | None:
    """Tell the bar how far a batch is; the steps of what its errors are measured against apart."""
    within = bar.within
    if within is None:
        return None

    def watch(batch: Batch, done: int, n_steps: int) -> None:
        first = batch[0]
        name = _named(first, title)
        share = f"{100 * done // n_steps} %"
        if n_steps == first.n_steps:
            within(f"{name}: {share}", first, done * len(batch))
        else:
            within(f"{name}: {share} of a reference", first, None)

    return watch


def _named(run: Run, title: str) -> str:
    """The run in one line, without the name of the experiment where that is said already."""
    return run.title.removeprefix(f"{title} ")


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
