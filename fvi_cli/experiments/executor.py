"""Runs one after the other in this process, or several at a time in processes of this machine."""

from __future__ import annotations

import functools
import multiprocessing
import pickle
import signal
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import fields
from typing import Any

from fvi_cli.experiments.experiment import Experiment, FinishedRun, Run
from fvi_cli.integrator.method import AnyMethod
from fvi_cli.scenes.registry import build_problem

ComputeRun = Callable[[Run], FinishedRun]


def compute_runs(
    runs: Iterable[Run], compute: ComputeRun, *, workers: int = 1
) -> Generator[FinishedRun, None, None]:
    """Compute every run and yield each as soon as it is finished.

    Closing the generator, or an exception in the loop that reads it, ends the processes.

    Parameters
    ----------
    runs
        What to compute.
    compute
        Function of one run; with several workers it must be importable by name.
    workers
        Number of processes; 1 computes here, in the order of `runs`.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    """
    if workers < 1:
        raise ValueError(f"workers: {workers} is not allowed; it must be at least 1")
    waiting = list(runs)
    if min(workers, len(waiting)) <= 1:
        yield from map(compute, waiting)
    else:
        yield from _compute_in_processes(waiting, compute, min(workers, len(waiting)))


def _compute_in_processes(
    runs: list[Run], compute: ComputeRun, workers: int
) -> Generator[FinishedRun, None, None]:
    # spawn: a fork would copy the locks of threads that a linear algebra library may hold
    context = multiprocessing.get_context("spawn")
    strangers = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_leave_interrupts_to_parent)
    try:
        portable = {id(run.experiment): _portable(run.experiment) for run in runs}
        # the longest runs first, so that no single one is left for the end
        tasks: dict[Future[dict[str, Any]], Run] = {
            pool.submit(
                _compute_portable, compute, portable[id(run.experiment)], run.method, run.n_steps
            ): run
            for run in sorted(runs, key=lambda run: -run.n_steps)
        }
        for future in as_completed(tasks):
            yield FinishedRun(run=tasks[future], **future.result())
    except BaseException:
        for process in set(multiprocessing.active_children()) - strangers:
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _leave_interrupts_to_parent() -> None:
    """A Ctrl-C reaches every process of a terminal; only the parent answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _portable(experiment: Experiment) -> bytes:
    """The experiment without its problem, whose functions need not survive the journey."""
    description: dict[str, Any] = {
        field.name: getattr(experiment, field.name)
        for field in fields(experiment)
        if field.name != "problem"
    }
    return pickle.dumps(
        {
            name: dict(value) if isinstance(value, Mapping) else value
            for name, value in description.items()
        }
    )


@functools.lru_cache(maxsize=8)
def _revive(portable: bytes) -> Experiment:
    """The experiment again, its problem built anew from its specification."""
    description = pickle.loads(portable)  # noqa: S301 - made by the parent process
    problem = build_problem(description["problem_specification"])
    return Experiment(problem=problem, **description)


def _compute_portable(
    compute: ComputeRun, portable: bytes, method: AnyMethod, n_steps: int
) -> dict[str, Any]:
    finished = compute(Run(experiment=_revive(portable), method=method, n_steps=n_steps))
    return {
        field.name: getattr(finished, field.name)
        for field in fields(finished)
        if field.name != "run"
    }
