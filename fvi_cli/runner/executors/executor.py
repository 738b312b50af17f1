"""Batches of runs, computed wherever an executor does it: here, in processes, on a cluster."""

from __future__ import annotations

import functools
import logging
import pickle
import traceback
from collections import deque
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np

import fvi_cli
from fvi_cli.errors import ExecutorError
from fvi_cli.integrator.advance import on_progress
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.runner.executors.batches import Pack, pack_of
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.code import Code, own_code
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

_logger = logging.getLogger(__name__)

Batch = tuple[Run, ...]
Watch = Callable[[Batch, int, int], None]
"""Told now and then which batch is being computed, how many steps are done, and of how many."""
ComputeBatch = Callable[[Batch], Sequence[FinishedRun]]


@dataclass(frozen=True, kw_only=True, eq=False)
class FinishedBatch:
    """What became of one batch.

    Parameters
    ----------
    runs, finished
        Its runs, and what became of each, or what a search came to.
    lost
        Those of which nothing was computed: whoever computed them died every time or had not
        enough memory, or the program made a mistake. They are ``failed`` and say why, tell nothing
        about the method, and are not to be stored.
    """

    runs: Batch
    finished: tuple[FinishedRun, ...]
    lost: frozenset[Run] = frozenset()

    @property
    def results(self) -> tuple[FinishedRun, ...]:
        """What is to be stored."""
        return tuple(one for one in self.finished if one.run not in self.lost)


@dataclass(frozen=True, kw_only=True)
class Crash:
    """An exception that nobody expected while one run was computed.

    Parameters
    ----------
    message
        What it says, where it happened, and what to do about it.
    trace
        Its traceback.
    """

    message: str
    trace: str


class Executor(Protocol):
    """Computes batches somewhere."""

    def compute(
        self, batches: Sequence[Batch], compute: ComputeBatch
    ) -> Generator[FinishedBatch, None, None]:
        """Compute every batch and yield each as soon as it is finished.

        Closing the generator, or an exception in the loop that reads it, ends what was begun.
        What `compute` raises is the result of the run that is to blame, and of no other.

        Parameters
        ----------
        batches
            What to compute; the runs of a batch, at least one, share their experiment.
        compute
            Function of one batch, which gives its finished runs in the same order; to be computed
            in another process it must be importable by name.
        """


@dataclass(frozen=True, kw_only=True)
class InProcess:
    """Computes in this process, one batch after the other, in their order.

    Parameters
    ----------
    watch
        Told how far a batch is; None: nobody wants to know.
    """

    watch: Watch | None = None

    def compute(
        self, batches: Sequence[Batch], compute: ComputeBatch
    ) -> Generator[FinishedBatch, None, None]:
        """As :meth:`Executor.compute`."""
        for batch in batches:
            try:
                watcher = functools.partial(self.watch, batch) if self.watch else None
                with on_progress(watcher) if watcher else nullcontext():
                    results = attempt(batch, compute)
            except MemoryError as error:
                yield lost_batch(batch, no_memory(error))
            else:
                yield finished_batch(batch, results)


def attempt(batch: Batch, compute: ComputeBatch) -> list[FinishedRun | Crash]:
    """Compute a batch; where that raises an exception, every run by itself.

    Raises
    ------
    MemoryError
        If there is not enough memory: that is the fault of none of the runs.
    """
    try:
        return list(compute(batch))
    except MemoryError:
        raise
    except Exception as error:
        if len(batch) == 1:
            return [crash(error)]
        _logger.debug("%d runs together: %s", len(batch), crash(error).trace)
        _logger.warning("%d runs are computed one by one: %s", len(batch), crash(error).message)
        return [one for run in batch for one in attempt((run,), compute)]


def crash(error: Exception) -> Crash:
    """What is told of an exception: its words, and the last line of this package on the way."""
    package = Path(fvi_cli.__file__).parent
    place = "".join(
        f" in {Path(frame.filename).relative_to(package.parent).as_posix()}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if package in Path(frame.filename).parents
    ).rpartition(" in ")[2]
    return Crash(
        message=f"unexpected {type(error).__name__}{f' in {place}' if place else ''}: {error}; "
        "this is a mistake of the program, please report it with the configuration",
        trace="".join(traceback.format_exception(error)),
    )


def describe_crash(run: Run, error: Exception) -> str:
    """What is said of an exception in the midst of a run; where it was is said to those who ask."""
    found = crash(error)
    _logger.debug("%s: %s", run.title, found.trace)
    return found.message


def finished_batch(batch: Batch, results: Sequence[FinishedRun | Crash]) -> FinishedBatch:
    """The batch with what became of each of its runs."""
    finished, lost = [], []
    for run, result in zip(batch, results, strict=True):
        if isinstance(result, Crash):
            _logger.debug("%s: %s", run.title, result.trace)
            finished.append(lost_run(run, result.message))
            lost.append(run)
        else:
            finished.append(result)
    return FinishedBatch(runs=batch, finished=tuple(finished), lost=frozenset(lost))


# --- how batches travel ---------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True, eq=False)
class PortableBatch:
    """A batch as it travels to another process: plain values, no functions.

    Parameters
    ----------
    experiment
        The experiment without its problem, pickled; the same text for all of its batches.
    runs
        The fields of every run, without the experiment.
    code
        Of the program that sends it.
    """

    experiment: bytes
    runs: tuple[Mapping[str, Any], ...]
    code: Code


PortableResults = list[dict[str, Any] | Crash]
"""The fields of finished runs, without the runs."""


def packs_longest_first(batches: Sequence[Batch]) -> dict[Pack, deque[Batch]]:
    """The batches by their packs, those with the most steps in front.

    The batches of a pack share what errors are measured against: who computes one of them should
    compute all.
    """
    packs: dict[Pack, list[Batch]] = {}
    for batch in batches:
        packs.setdefault(pack_of(batch[0]), []).append(batch)
    ordered = sorted(packs.items(), key=lambda item: -sum(map(_steps, item[1])))
    return {pack: deque(sorted(own, key=_steps, reverse=True)) for pack, own in ordered}


def _steps(batch: Batch) -> int:
    return sum(run.n_steps for run in batch)


def portable_batch(batch: Batch) -> PortableBatch:
    """The batch for another process, where its problem is built anew from the specification."""
    return PortableBatch(
        experiment=_portable_experiment(batch[0].experiment),
        runs=tuple(_fields_of(run, "experiment") for run in batch),
        code=own_code(),
    )


@functools.lru_cache(maxsize=8)
def _portable_experiment(experiment: Experiment) -> bytes:
    return pickle.dumps(
        {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in _fields_of(experiment, "problem").items()
            if name != "members"
        }
    )


def _fields_of(value: Any, left_out: str) -> dict[str, Any]:
    names = (field.name for field in fields(value))
    return {name: getattr(value, name) for name in names if name != left_out}


@functools.lru_cache(maxsize=8)
def _revived(portable: bytes) -> Experiment:
    """The experiment again, its problem built anew."""
    description = pickle.loads(portable)  # noqa: S301 - made by the parent process
    problem = build_problem(description["problem_specification"])
    return Experiment(problem=problem, **description)


def compute_portable(compute: ComputeBatch, portable: PortableBatch) -> PortableResults:
    """Compute a batch that has travelled.

    Raises
    ------
    ExecutorError
        If it was sent by other code, whose numbers may be others.
    """
    differences = portable.code.differences(own_code())
    if differences:
        raise ExecutorError(f"it has {differences}; install the same on both sides")
    experiment = _revived(portable.experiment)
    batch = tuple(Run(experiment=experiment, **run) for run in portable.runs)
    return [
        result if isinstance(result, Crash) else _fields_of(result, "run") | _choice(result.run)
        for result in attempt(batch, compute)
    ]


def _choice(run: Run) -> dict[str, Any]:
    return {"method": run.method, "n_steps": run.n_steps}


def returned_batch(batch: Batch, results: PortableResults) -> FinishedBatch:
    """The finished batch, its runs being those that were sent out, or were chosen for them."""
    return finished_batch(
        batch,
        [
            result if isinstance(result, Crash) else _returned(run, dict(result))
            for run, result in zip(batch, results, strict=True)
        ],
    )


def _returned(run: Run, result: dict[str, Any]) -> FinishedRun:
    choice = {name: result.pop(name) for name in _choice(run)}
    if choice != _choice(run):
        run = run.experiment.chosen_run(**choice, member=run.member)
    return FinishedRun(run=run, **result)


def lost_batch(batch: Batch, message: str) -> FinishedBatch:
    """The batch as ``failed`` where nobody lived to tell its results."""
    finished = tuple(lost_run(run, message) for run in batch)
    return FinishedBatch(runs=batch, finished=finished, lost=frozenset(batch))


def no_memory(error: MemoryError) -> str:
    """Why a batch is lost for which there was no memory."""
    return "not enough memory" + (f": {error}" if str(error) else "")


def lost_run(run: Run, message: str) -> FinishedRun:
    """The run as ``failed``: of it there is nothing but its start, and why."""
    problem = run.problem
    start = problem.scene.initial_position if isinstance(problem, Problem) else np.zeros(1)
    return FinishedRun(
        run=run,
        trajectory=Trajectory(
            time=np.zeros(1),
            position=start[None],
            n_steps=run.n_steps,
            step_size=run.step_size,
            status="failed",
            message=message,
        ),
        error=float("nan"),
        floor=0.0,
        status="failed",
    )
