"""The runs of a configuration: looked up, computed, stored, and read."""

from __future__ import annotations

import functools
import logging
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fvi_cli.config import LoadedConfig
from fvi_cli.config.machine import run_bytes
from fvi_cli.errors import RequestError, StorageError
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.runner.executor import compute_all
from fvi_cli.runner.outcome import Outcome, is_unexpected_failure
from fvi_cli.runner.progress import Task, progress_bar
from fvi_cli.runner.request import Source, file_of, is_stored, load
from fvi_cli.runner.work import Batch, batches_of, reference_batches_of
from fvi_cli.storage.identity import identity_of
from fvi_cli.storage.store import Store
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run
from fvi_cli.studies.reference import needs_dense_run

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
        As for :func:`load`; the runs of a result file are read, and none is computed.
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
    """
    config = load(source)
    path, lost = file_of(config, output), dict[Run, str]()
    if path is not None and is_stored(config):
        store = Store.existing(path)
        work = _Work(config, store, shard, fresh)
    else:
        store = Store(path, keeps=keep)
        work = _Work(config, store, shard, fresh)
        if work.is_whole:
            # a damaged part is found now, so that its runs are computed
            store.fold(work.runs)
        store.describe(config.text, config.resolved, config.overrides)
        try:
            lost = work.compute(workers, dask, progress=progress)
        finally:
            # also after Ctrl-C
            if work.is_whole:
                store.fold(work.runs, prunes=prune)
            store.look()
    found = store.read(work.runs, motions=keeps_motions)
    found |= {one: _lost_run(one, words) for one, words in lost.items()}
    if not is_stored(config):
        _report([found[run] for run in work.runs if run in found])
    return [
        _outcome(experiment, [found[run] for run in own if run in found], config)
        for experiment, own in work.listed.items()
    ]


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
    return run(load(path, overrides=overrides))


def plan(
    source: Source,
    *,
    output: Path | str = "results",
    fresh: bool = False,
    shard: str = "1/1",
) -> list[Task]:
    """What :func:`run` would do, by method and number of steps; writes no file.

    Actions are ``compute``, ``reuse`` a stored run, or ``leave out`` a run that another shard
    computes, or that a result file in place of a configuration lacks.
    """
    config = load(source)
    work = _Work(config, Store(file_of(config, output)), shard, fresh)
    own = (run for batch in work.batches for run in batch.runs)
    actions = dict.fromkeys(work.runs, "reuse") | dict.fromkeys(work.missing, "leave out")
    actions |= dict.fromkeys(own, "compute")
    groups = Counter(
        (run.experiment, run.method, run.n_steps, action) for run, action in actions.items()
    )
    return [
        _planned(Run(experiment=experiment, method=method, n_steps=n_steps), action, count)
        for (experiment, method, n_steps, action), count in groups.items()
    ]


def _planned(run: Run, action: str, count: int) -> Task:
    """The plan for a run, or so many members."""
    experiment, of, memory = run.experiment, ["Gauss, adaptive steps"], None
    if not run.is_search:
        of = [f"{run.method.label}, N = {run.n_steps}"]
        memory = run_bytes(experiment, run.method, run.n_steps)
    if experiment.members:
        of.append(f"{count} members")
    return Task(experiment=experiment.name, action=action, of=", ".join(of), memory_bytes=memory)


def shard_named(text: str) -> tuple[int, int]:
    """The numbers I and N of a text ``I/N``, of which I counts from 1.

    Raises
    ------
    RequestError
        If the text names no part.
    """
    number, _, count = text.partition("/")
    are_numbers = number.isdecimal() and count.isdecimal()
    if not (are_numbers and 1 <= int(number) <= int(count)):
        raise RequestError(f"--shard {text}: write I/N with I from 1 to N, such as 2/4")
    return int(number), int(count)


class _Work:
    """What one command computes of a configuration."""

    def __init__(self, config: LoadedConfig, store: Store, shard: str, fresh: bool) -> None:
        self.config, self.store = config, store
        self.is_fresh = fresh and not is_stored(config)
        self.part, self.of = shard_named(shard)
        # only who computes all parts makes the result file
        self.is_whole = self.of == 1
        self.listed = {experiment: experiment.runs() for experiment in config.experiments}
        self.runs = [run for own in self.listed.values() for run in own]

    @functools.cached_property
    def missing(self) -> set[Run]:
        """The first of all equal runs that are not stored."""
        found: dict[str, Run] = {}
        for one in self.runs:
            identity = identity_of(one)
            if self.is_fresh or not self.store.has(identity):
                found.setdefault(identity, one)
        return set(found.values())

    @functools.cached_property
    def batches(self) -> list[Batch]:
        """What is missing of this part; none of a result file.

        All runs are divided, so that a part does not depend on what others have stored.
        """
        divided = [] if is_stored(self.config) else batches_of(self.runs)
        shared = [[run for run in one.runs if run in self.missing] for one in divided]
        return [Batch(runs=tuple(one)) for one in shared[self.part - 1 :: self.of] if one]

    def compute(self, workers: int, dask: str | None, *, progress: bool) -> dict[Run, str]:
        """Compute and store what is missing; returns runs that were lost, with the reason."""
        batches, name, lost = self.batches, self.config.name, dict[Run, str]()
        own = [run for batch in batches for run in batch.runs]
        count = len(self.runs)
        _logger.debug("%s: %d runs, %d of them stored", name, count, count - len(self.missing))
        with progress_bar(name, len(own), wanted=progress) as advance:
            for waiting in (reference_batches_of(own), batches):
                if workers > 1 or dask:
                    waiting.sort(key=lambda one: -one.n_steps)
                for batch, result in compute_all(self._ready(waiting), workers, dask):
                    if isinstance(result, bytes):
                        self.store.add(batch.name, result)
                    elif not batch.is_reference:
                        words = f"not computed: {type(result).__name__}: {result}"
                        lost |= dict.fromkeys(batch.runs, words)
                        _logger.debug("%s", words, exc_info=result)
                    if not batch.is_reference:
                        advance(len(batch.runs))
                self.store.look()
        return lost

    def _ready(self, batches: Sequence[Batch]) -> Iterator[Batch]:
        """The batches with the references that are known, but those that are computed meanwhile."""
        for batch in batches:
            if not self.is_fresh and all(map(self.store.has, batch.identities)):
                continue
            needed = [] if batch.is_reference else list(filter(needs_dense_run, batch.runs))
            if needed:
                # another command may have folded them
                self.store.look()
            yield replace(batch, references=self.store.references(needed))


def _lost_run(run: Run, message: str) -> FinishedRun:
    """A finished run with status ``failed`` that has only its start and the message."""
    scene = run.problem.scene
    start = np.zeros(1) if scene is None else scene.initial_position
    trajectory = Trajectory(
        time=np.zeros(1), position=start[None], n_steps=run.n_steps, step_size=run.step_size,
        status="failed", message=message,
    )  # fmt: skip
    return FinishedRun(
        run=run, trajectory=trajectory, error=float("nan"), floor=0.0, status="failed"
    )


def _outcome(
    experiment: Experiment, finished: Sequence[FinishedRun], config: LoadedConfig
) -> Outcome:
    """The outcome; for a single search its experiment has the chosen method and steps.

    Raises
    ------
    StorageError
        If a result file has none of the runs of an experiment.
    """
    if experiment.needs_search and not experiment.members and finished:
        experiment = finished[0].run.experiment
    missing = len(experiment.runs()) - len(finished)
    if is_stored(config) and missing:
        words = f"{config.path}: {missing} runs of {experiment.name} are not stored for "
        words += "these settings and this version of fvi; compute them with fvi run and their "
        words += f"configuration, which fvi show {config.path} --config prints"
        if not finished:
            raise StorageError(words)
        _logger.warning("%s", words)
    return Outcome(experiment=experiment, finished=tuple(finished))


def _report(found: Sequence[FinishedRun]) -> None:
    """Log a line for a run; as a warning each remark, and why runs failed unexpectedly, once."""
    shown: dict[tuple[str, str, str], list[str]] = {}
    for finished in found:
        run, trajectory = finished.run, finished.trajectory
        error = f", error {finished.error:.3g}" if math.isfinite(finished.error) else ""
        _logger.debug("%s: %s%s", run.title, finished.status, error)
        lines = list(trajectory.remarks)
        if is_unexpected_failure(finished):
            lines.append(": ".join(filter(None, (finished.status, trajectory.message))))
        for line in lines:
            alike = run.experiment.name, run.method.case, re.sub(r"[0-9.]+", "", line)
            shown.setdefault(alike, []).append(f"{run.title}: {line}")
    for first, *others in shown.values():
        more = f" (and {len(others)} more run{'s' * (len(others) > 1)})" if others else ""
        _logger.warning("%s%s", first, more)
