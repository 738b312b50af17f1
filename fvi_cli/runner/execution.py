"""Runs of experiments are computed, as the options of a command say, unless they are known."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import RunBar, run_bar
from fvi_cli.runner.requests import STORED_SUFFIX, Request
from fvi_cli.storage import NEW
from fvi_cli.studies.batches import batches_of, execute_batch
from fvi_cli.studies.cluster import DaskCluster
from fvi_cli.studies.executor import Batch, Executor, InProcess, Watch, compute_batches
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.processes import LocalProcesses

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

    def executor(self, watch: Watch | None = None) -> Executor:
        """Where runs are computed; `watch` is told how far they are, on this machine."""
        if self.dask is not None:
            return DaskCluster(address=self.dask)
        if self.workers > 1:
            return LocalProcesses(workers=self.workers, watch=watch)
        return InProcess(watch=watch)

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
        asked = 1 if self.experiment.is_open else len(self.experiment.runs())
        return asked - len(self.finished)


def is_unexpected_failure(finished: FinishedRun) -> bool:
    """Whether the run failed and its configuration did not expect that."""
    if finished.status in ("ok", "floor"):
        return False
    return not finished.run.experiment.expects_failure(finished.run.method)


def never(run: Run) -> FinishedRun | None:
    """No run is known."""
    return None


def carry_out(
    experiments: Sequence[Experiment],
    settings: Settings,
    *,
    title: str,
    known: Known = never,
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
    batches = batches_of(waiting, workers=settings.workers)
    steps = sum(run.n_steps for run in waiting)
    with (
        run_bar(title, len(waiting), steps, wanted=settings.show_progress) as bar,
        contextlib.closing(
            compute_batches(batches, execute_batch, executor=settings.executor(_watch(bar)))
        ) as computed,
    ):
        for batch in computed:
            # what a dead worker did not tell is no result: the next time it is computed again
            if keep is not None and not batch.is_lost:
                keep(batch.finished)
            for finished in batch.finished:
                done[finished.run] = finished
                bar.finished(finished.run.title, batch.finished[0].run, finished.run.n_steps)
                _report(finished)
            if settings.fail_fast and any(map(is_unexpected_failure, batch.finished)):
                _logger.error("stopped at the first unexpected failure (--fail-fast)")
                break
    return [
        Outcome(experiment=experiment, finished=tuple(done[run] for run in runs if run in done))
        for experiment, runs in listed
    ]


def _watch(bar: RunBar) -> Watch | None:
    """Tell the bar how far a batch is; the steps of what its errors are measured against apart."""
    within = bar.within
    if within is None:
        return None

    def watch(batch: Batch, done: int, n_steps: int) -> None:
        first = batch[0]
        share = f"{100 * done // n_steps} %"
        if n_steps == first.n_steps:
            within(f"{first.title}: {share}", first, done * len(batch))
        else:
            within(f"{first.title}: {share} of a reference", first, 0)

    return watch


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
