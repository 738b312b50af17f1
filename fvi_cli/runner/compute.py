"""The runs of a request: looked up, computed, stored, and read."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from pathlib import Path

from fvi_cli.errors import StorageError
from fvi_cli.runner.executor import Result, check_workers, compute_all
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure
from fvi_cli.runner.plan import check_memory_together, result_file, shard_named
from fvi_cli.runner.progress import progress_bar
from fvi_cli.runner.request import Request, Source, gather, requested
from fvi_cli.runner.work import (
    Batch,
    batches_of,
    lost_run,
    one_by_one_words,
    reference_batches_of,
)
from fvi_cli.storage.identity import identity_of, reference_identity_of
from fvi_cli.storage.store import Store, running
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import needs_refined_run, remember

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
        Show progress on standard error.
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
    request, part = requested(source), shard_named(shard)
    check_workers(workers, dask)
    check_memory_together(request, workers)
    store = Store(result_file(request, output))
    listed = {one: one.runs() for one in request.loaded.experiments}
    runs = [one for own in listed.values() for one in own]
    lost: dict[Run, str] = {}
    if request.stored is None:
        target = store if keep else Store(None)
        task = _Task(request, runs, store, target, part, is_fresh=fresh)
        lost = task.compute(workers, dask, prunes=prune, progress=progress)
    else:
        target = store
        store.configuration()
        store.fold()
    found = store.read(runs, motions=keeps_motions)
    if target is not store:
        found |= target.read(runs, motions=keeps_motions)
    found |= {one: lost_run(one, message) for one, message in lost.items()}
    if request.stored is None:
        _report(runs, found)
    outcomes = [_outcome(one, [found[r] for r in own if r in found]) for one, own in listed.items()]
    if request.stored is not None:
        _report_missing(outcomes, request.stored)
    for experiment, own in listed.items():
        if own and not experiment.members and needs_refined_run(own[0]):
            references = target.references(own[:1]) or store.references(own[:1])
            if reference := references.get(own[0]):
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
    return run(request)


class _Task:
    """The runs of a request that are computed by one command."""

    def __init__(
        self,
        request: Request,
        runs: Sequence[Run],
        store: Store,
        target: Store,
        shard: tuple[int, int],
        *,
        is_fresh: bool,
    ) -> None:
        self.request, self.runs, self.store, self.target = request, runs, store, target
        self.shard, self.is_fresh = shard, is_fresh

    def compute(
        self, workers: int, dask: str | None, *, prunes: bool, progress: bool
    ) -> dict[Run, str]:
        """Compute and store what is missing; returns runs that were lost, with the reason."""
        loaded, lost = self.request.loaded, dict[Run, str]()
        number, count = self.shard
        if self.target is self.store:
            if count == 1:
                # a damaged part is found now, so that its runs are computed
                self.store.fold(self.runs)
            self.store.describe(loaded.text, loaded.resolved, loaded.overrides)
        missing = self._missing()
        _log_waiting(self.request.name, self.runs, missing)
        waiting = set(missing)
        # all runs are divided, so that the parts of one shard do not depend on those of others
        shared = ([run for run in one.runs if run in waiting] for one in batches_of(self.runs))
        batches = [Batch(runs=tuple(one)) for one in [*shared][number - 1 :: count] if one]
        own = [run for batch in batches for run in batch.runs]
        references = [
            batch
            for batch in reference_batches_of(own)
            if self.is_fresh
            or not all(self.store.has(reference_identity_of(run)) for run in batch.runs)
        ]
        try:
            with (
                running(self.target.path if batches else None) as is_alone,
                progress_bar(self.request.name, len(own), wanted=progress) as advance,
            ):
                for batch, result in self._results(references, workers, dask, is_alone=is_alone):
                    self._take(batch, result)
                self.target.look()
                for batch, result in self._results(batches, workers, dask, is_alone=is_alone):
                    lost |= self._take(batch, result)
                    advance(batch.runs[-1].title, len(batch.runs))
        finally:
            # also after Ctrl-C
            if count == 1:
                self.target.fold(self.runs, prunes=prunes)
            self.target.look()
        return lost

    def _missing(self) -> list[Run]:
        """The first of all equal runs that are not stored."""
        found: dict[str, Run] = {}
        for one in self.runs:
            identity = identity_of(one)
            if self.is_fresh or not self.store.has(identity):
                found.setdefault(identity, one)
        return list(found.values())

    def _results(
        self, batches: Sequence[Batch], workers: int, dask: str | None, *, is_alone: bool
    ) -> Iterator[tuple[Batch, Result]]:
        if workers > 1 or dask:
            batches = sorted(batches, key=lambda one: -one.n_steps)
        # two commands begin at different ends, and skip what the other has done
        ordered = batches if is_alone else batches[::-1]
        return compute_all(ordered, workers, dask, prepare=self._prepared)

    def _prepared(self, batch: Batch) -> Batch | None:
        """The batch with the references that are known; None: another command has computed it."""
        if not self.is_fresh:
            if self.target.has_part(batch.name):
                return None
            if self.target.has_grown():
                self.target.look()
            name_of = reference_identity_of if batch.is_reference else identity_of
            if all(self.store.has(name_of(one)) for one in batch.runs):
                return None
        if batch.is_reference:
            return batch
        needed = [one for one in batch.runs if needs_refined_run(one)]
        known = {} if self.is_fresh else self.store.references(needed)
        return replace(batch, references=known | self.target.references(needed))

    def _take(self, batch: Batch, result: Result) -> dict[Run, str]:
        """Store the part of a batch; returns the runs that it lacks."""
        if isinstance(result, BaseException):
            is_dead = isinstance(result, BrokenExecutor)
            words = "the process that computed it ended twice (out of memory?)"
            return dict.fromkeys(batch.runs, words if is_dead else f"not computed: {result}")
        self.target.add(batch.name, result.part)
        return {batch.runs[place]: message for place, message in result.lost.items()}


def _outcome(experiment: Experiment, finished: Sequence[FinishedRun]) -> Outcome:
    """The outcome; for a single search its experiment has the chosen method and steps."""
    is_chosen = experiment.needs_search and not experiment.members and finished
    own = finished[0].run.experiment if is_chosen else experiment
    return Outcome(experiment=own, finished=tuple(finished))


def _report_missing(outcomes: Sequence[Outcome], path: Path) -> None:
    """Warn of requested runs that a result file lacks.

    Raises
    ------
    StorageError
        If none of the runs of an experiment can be used.
    """
    for outcome in outcomes:
        if outcome.missing and not outcome.finished:
            raise StorageError(
                f"{path}: none of the {outcome.missing} runs of {outcome.experiment.name} is "
                "stored for these settings and this version of fvi; compute them with fvi run and "
                f"their configuration, which fvi show {path} --config prints"
            )
        if outcome.missing:
            _logger.warning(
                "%s: %d runs of %s are missing; run its configuration to compute them",
                path, outcome.missing, outcome.experiment.name,
            )  # fmt: skip


def _log_waiting(title: str, runs: Sequence[Run], missing: Sequence[Run]) -> None:
    """Log how many runs are computed, and why members are not a batch."""
    _logger.debug("%s: %d runs, %d of them stored", title, len(runs), len(runs) - len(missing))
    for experiment in dict.fromkeys(one.experiment for one in missing):
        if words := one_by_one_words(experiment):
            _logger.warning("%s: %s", title, words)


def _report(runs: Sequence[Run], found: dict[Run, FinishedRun]) -> None:
    """Log a line for a run (a warning if it failed unexpectedly), and each of its remarks once."""
    shown: set[tuple[str, str, str]] = set()
    for run_ in runs:
        if run_ not in found:
            continue
        finished = found[run_]
        title, trajectory = finished.run.title, finished.trajectory
        for remark in trajectory.remarks:
            alike = run_.experiment.name, run_.method.case, re.sub(r"[0-9.]+", "", remark)
            if alike not in shown:
                shown.add(alike)
                _logger.warning("%s: %s", title, remark)
        level = logging.WARNING if is_unexpected_failure(finished) else logging.DEBUG
        message = f" ({trajectory.message})" if trajectory.message else ""
        _logger.log(level, "%s: %s, error %.3g%s", title, finished.status, finished.error, message)
