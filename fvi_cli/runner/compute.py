"""Runs of experiments are computed, as the options of a command say, unless they are known."""

from __future__ import annotations

import contextlib
import functools
import logging
from collections.abc import Callable, Hashable, Sequence

from fvi_cli.runner.executors.batches import batches_of, execute_batch
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.executor import Batch, ComputeBatch, Watch
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure, without_motion
from fvi_cli.runner.progress import RunBar, run_bar
from fvi_cli.runner.settings import Settings
from fvi_cli.runner.stored import FRESH, Known, Why, resumed_at
from fvi_cli.storage import NEW
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

Keep = Callable[[Sequence[FinishedRun]], object]
"""Is given the runs that are computed together, as soon as they are finished."""


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
        Called with the runs of every batch that is computed, as soon as it is finished.
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
        for batch in computed:
            # what a dead worker did not tell is no result: the next time it is computed again
            if keep is not None and batch.results:
                keep(batch.results)
            for finished in batch.finished:
                done[finished.run] = kept(finished)
                bar.finished(
                    _named(finished.run, title), batch.finished[0].run, finished.run.n_steps
                )
                _report(finished)
            if settings.fail_fast and any(map(is_unexpected_failure, batch.finished)):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break
    return [
        Outcome(experiment=experiment, finished=tuple(done[run] for run in runs if run in done))
        for experiment, runs in listed.items()
    ]


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
        if remark.startswith("stability:"):
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
