"""Jobs computed by processes of this machine, any of which may die."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

from fvi_cli.integrator.advance import on_progress
from fvi_cli.runner.executors.batches import Pack
from fvi_cli.runner.executors.executor import Answer, Died, run_jobs
from fvi_cli.runner.executors.jobs import (
    ComputeJob,
    FinishedJob,
    Job,
    JobQueue,
    Lookup,
    References,
    Watch,
    no_memory,
)
from fvi_cli.runner.executors.portable import compute_portable, portable_job, returned_results

if TYPE_CHECKING:
    # Windows has only one of them
    from multiprocessing.context import ForkServerContext, SpawnContext

_SECONDS_TO_LEAVE = 5.0
_FORKED_ON = ("linux",)
_PRELOADED = ["fvi_cli.runner.executors.processes", "fvi_cli.runner.executors.batches"]


@dataclass(kw_only=True, eq=False)
class _Worker:
    """A process, our end of the pipe to it, what it computes, and the pack of the latest job."""

    process: BaseProcess
    connection: Connection
    job: Job | None = None
    pack: Pack | None = None

    def exit_reason(self) -> str:
        """How the process ended."""
        self.process.join(_SECONDS_TO_LEAVE)
        code = self.process.exitcode
        if code is None or code >= 0:
            return f"the process that computed it ended with code {code}"
        name = signal.Signals(-code).name
        hint = " (out of memory?)" if -code == signal.SIGKILL else ""
        return f"the process that computed it was ended by {name}{hint}"


@dataclass(frozen=True, kw_only=True)
class LocalProcesses:
    """Computes in several processes of this machine.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    """

    workers: int  # number of processes
    watch: Watch | None = None  # called with the progress of a job; None: no callback

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers: {self.workers} is not allowed; it must be at least 1")

    def compute(
        self, jobs: Sequence[Job], compute: ComputeJob, lookup: Lookup = lambda run: None
    ) -> Generator[FinishedJob, None, None]:
        """As :meth:`Executor.compute`; the longest packs first, each by one process if it can."""
        pool = _Pool(compute=compute, size=min(self.workers, len(jobs)), watch=self.watch)
        return run_jobs(jobs, pool, lookup)


@dataclass(kw_only=True, eq=False)
class _Pool:
    """The processes that are alive, at most `size`; one that dies is replaced."""

    compute: ComputeJob
    size: int
    watch: Watch | None = None
    busy: dict[Connection, _Worker] = field(default_factory=dict)
    idle: list[_Worker] = field(default_factory=list)

    def ordered(self, jobs: Iterable[Job]) -> JobQueue:
        return JobQueue.longest_first(jobs)

    def room(self) -> tuple[bool, Pack | None]:
        return len(self.busy) < self.size, self.idle[-1].pack if self.idle else None

    def send(self, job: Job, references: References) -> None:
        """Hand a job to a process that is idle, or to a new one."""
        worker = self.idle.pop() if self.idle else self._started()
        worker.job, worker.pack = job, job.pack
        self.busy[worker.connection] = worker
        # a process that has just died is noticed when its answer is read
        with contextlib.suppress(OSError):
            worker.connection.send(portable_job(job, references))

    def _started(self) -> _Worker:
        context = _context()
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self.compute, bool(self.watch)))
        process.daemon = True
        try:
            with _interruptions_held():
                process.start()
        finally:
            # the pipe must end with the process, so no other process may hold its other end
            theirs.close()
        return _Worker(process=process, connection=ours)

    def answers(self) -> Iterator[tuple[Job, Answer]]:
        """Wait for processes that have answered, died, or said how far they are."""
        for connection in wait(list(self.busy)):
            worker = self.busy[connection]  # type: ignore[index]
            job = worker.job
            if job is None:  # pragma: no cover - only busy processes are asked
                raise ValueError("worker: computing is not its task")
            try:
                kind, answer = worker.connection.recv()
            except (EOFError, OSError):
                del self.busy[worker.connection]
                worker.connection.close()
                yield job, Died(message=worker.exit_reason())
                continue
            if kind == "progress":
                if self.watch is not None:
                    self.watch(job, *answer)
                continue
            del self.busy[worker.connection]
            worker.job = None
            self.idle.append(worker)
            yield job, returned_results(job, answer) if kind == "results" else answer

    def dismiss(self) -> None:
        """Let idle processes end by themselves."""
        for worker in self.idle:
            worker.connection.close()
        for worker in self.idle:
            worker.process.join(_SECONDS_TO_LEAVE)

    def stop(self) -> None:
        """End every process, whatever it does."""
        pool = [*self.idle, *self.busy.values()]
        for worker in pool:
            worker.connection.close()
            worker.process.terminate()
        for worker in pool:
            worker.process.join(_SECONDS_TO_LEAVE)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()


def _context() -> SpawnContext | ForkServerContext:
    """How processes begin: never by a fork of this one, whose threads may hold locks.

    Where that is safe, one process without threads loads what all of them need, and forks them.
    """
    if sys.platform not in _FORKED_ON:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    return context


@contextlib.contextmanager
def _interruptions_held() -> Iterator[None]:
    """Let a process that begins, and those that it forks, never see a Ctrl-C; we do afterwards.

    It reaches every process of a terminal, in the midst of what they load first.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # it begins with the first process, and holds and frees the same signal
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, compute: ComputeJob, reports_progress: object) -> None:
    """Compute what comes through the pipe until its other end is closed."""

    def report(done: int, n_steps: int) -> None:
        connection.send(("progress", (done, n_steps)))

    # a Ctrl-C reaches every process of a terminal; only the parent answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # as in the process that asks
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # the parent has ended: the answer has no receiver
    with contextlib.suppress(EOFError, OSError):
        while True:
            portable = connection.recv()
            with on_progress(report) if reports_progress else contextlib.nullcontext():
                answer = _answer_to(portable, compute)
            connection.send_bytes(answer)


def _answer_to(portable: Any, compute: ComputeJob) -> bytes:
    try:
        return pickle.dumps(("results", compute_portable(compute, portable)))
    except MemoryError as error:
        return pickle.dumps(("lost", no_memory(error)))


def _end_with_parent() -> None:
    """End this process when its parent has, be it in the midst of a long job."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
