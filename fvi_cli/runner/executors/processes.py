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
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

from fvi_cli.runner.executors.batches import Pack
from fvi_cli.runner.executors.executor import Answer, Died, Executor
from fvi_cli.runner.executors.jobs import ComputeJob, Job, References, no_memory
from fvi_cli.runner.executors.portable import compute_portable, portable_job, returned_results

if TYPE_CHECKING:
    # Windows has only SpawnContext
    from multiprocessing.context import ForkServerContext, SpawnContext

_SECONDS_TO_LEAVE = 5.0
_FORKED_ON = ("linux",)
_PRELOADED = ["fvi_cli.runner.executors.processes", "fvi_cli.runner.executors.batches"]


@dataclass(kw_only=True, eq=False)
class _Worker:
    """A process, our end of the pipe to it, its present job, and the pack of its latest job."""

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


@dataclass(kw_only=True, eq=False)
class LocalProcesses(Executor):
    """Computes in several processes of this machine; one that dies is replaced.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    """

    workers: int  # number of processes
    busy: dict[Connection, _Worker] = field(init=False, default_factory=dict)
    idle: list[_Worker] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers: {self.workers} is not allowed; it must be at least 1")

    def room(self) -> tuple[bool, Pack | None]:
        """As :meth:`Executor.room`; one process computes a pack where possible."""
        return len(self.busy) < self.workers, self.idle[-1].pack if self.idle else None

    def send(self, job: Job, references: References) -> None:
        """As :meth:`Executor.send`: to a process that is idle, or to a new one."""
        worker = self.idle.pop() if self.idle else self._started()
        worker.job, worker.pack = job, job.pack
        self.busy[worker.connection] = worker
        # the death of a process is noticed when its answer is read
        with contextlib.suppress(OSError):
            worker.connection.send(portable_job(job, references))

    def _started(self) -> _Worker:
        context = _context()
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self.compute_job))
        process.daemon = True
        try:
            with _interruptions_held():
                process.start()
        finally:
            # no other process may hold this end, so that the pipe closes when its process dies
            theirs.close()
        return _Worker(process=process, connection=ours)

    def answers(self) -> Iterator[tuple[Job, Answer]]:
        """As :meth:`Executor.answers`."""
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
            del self.busy[worker.connection]
            worker.job = None
            self.idle.append(worker)
            yield job, returned_results(job, answer) if kind == "results" else answer

    def stop(self) -> None:
        """As :meth:`Executor.stop`: idle processes end by themselves."""
        pool = [*self.busy.values(), *self.idle]
        for worker in pool:
            worker.connection.close()
        for worker in self.busy.values():
            worker.process.terminate()
        for worker in pool:
            worker.process.join(_SECONDS_TO_LEAVE)
            if worker.process.is_alive():
                worker.process.kill()
                worker.process.join()
        self.busy, self.idle = {}, []


def _context() -> SpawnContext | ForkServerContext:
    """The start method: never a fork of this process, whose threads may hold locks.

    On :data:`_FORKED_ON` a server without threads imports the common modules and is forked.
    """
    if sys.platform not in _FORKED_ON:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    return context


@contextlib.contextmanager
def _interruptions_held() -> Iterator[None]:
    """Block Ctrl-C in processes that start here, and in their forks; afterwards it is delivered.

    A Ctrl-C reaches every process of a terminal, even while these import their first modules.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    # start it before, since its start blocks and unblocks the same signal
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(connection: Connection, compute: ComputeJob) -> None:
    """Compute the jobs that come through the pipe until its other end is closed."""
    # a Ctrl-C reaches every process of a terminal; only the parent answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # as in the parent
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # the parent has ended: the answer has no receiver
    with contextlib.suppress(EOFError, OSError):
        while True:
            connection.send_bytes(_answer_to(connection.recv(), compute))


def _answer_to(portable: Any, compute: ComputeJob) -> bytes:
    try:
        return pickle.dumps(("results", compute_portable(compute, portable)))
    except MemoryError as error:
        return pickle.dumps(("lost", no_memory(error)))


def _end_with_parent() -> None:
    """End this process when its parent ends, even within a long job."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
