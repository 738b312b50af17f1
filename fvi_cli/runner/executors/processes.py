"""Batches computed by processes of this machine, any of which may die."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import warnings
from collections import deque
from collections.abc import Collection, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TYPE_CHECKING, Any

from fvi_cli.integrator.advance import on_progress
from fvi_cli.runner.executors.batches import Pack
from fvi_cli.runner.executors.executor import (
    Batch,
    ComputeBatch,
    FinishedBatch,
    PortableResults,
    Watch,
    compute_portable,
    lost_batch,
    no_memory,
    packs_longest_first,
    portable_batch,
    returned_batch,
)

if TYPE_CHECKING:
    # Windows has only one of them
    from multiprocessing.context import ForkServerContext, SpawnContext

ATTEMPTS = 2
"""How often a batch is computed before it is given up."""

_SECONDS_TO_LEAVE = 5.0
_FORKED_ON = ("linux",)
_PRELOADED = ["fvi_cli.runner.executors.processes", "fvi_cli.runner.executors.batches"]


@dataclass(kw_only=True, eq=False)
class _Task:
    """A batch, and how often a process has died of it."""

    batch: Batch
    deaths: int = 0


@dataclass(kw_only=True, eq=False)
class _Worker:
    """A process, our end of the pipe to it, what it computes, and the pack of that."""

    process: BaseProcess
    connection: Connection
    task: _Task | None = None
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

    A process holds one batch at a time. When it dies, another one takes its place and the batch
    is computed once more, after all others; when that dies as well, the batch is lost.

    Parameters
    ----------
    workers
        Number of processes.
    watch
        Told how far a batch is; None: nobody wants to know.

    Raises
    ------
    ValueError
        If `workers` is less than 1.
    """

    workers: int
    watch: Watch | None = None

    def __post_init__(self) -> None:
        if self.workers < 1:
            raise ValueError(f"workers: {self.workers} is not allowed; it must be at least 1")

    def compute(
        self, batches: Sequence[Batch], compute: ComputeBatch
    ) -> Generator[FinishedBatch, None, None]:
        """As :meth:`Executor.compute`; the longest packs first, each by one process if it can."""
        waiting = {
            pack: deque(_Task(batch=batch) for batch in own)
            for pack, own in packs_longest_first(batches).items()
        }
        size = min(self.workers, len(batches))
        pool = _Pool(compute=compute, size=size, watch=self.watch)
        try:
            while waiting or pool.busy:
                while waiting and pool.has_room:
                    pool.give(waiting)
                for worker in pool.ready():
                    received = pool.receive(worker)
                    if received is None:
                        continue
                    task, answer = received
                    if isinstance(answer, str):
                        yield lost_batch(task.batch, answer)
                    elif answer is not None:
                        yield returned_batch(task.batch, answer)
                    elif task.deaths < ATTEMPTS:
                        # behind all others
                        waiting[(task,)] = deque([task])
                    else:
                        message = f"{worker.exit_reason()}, {task.deaths} times"
                        yield lost_batch(task.batch, message)
            pool.dismiss()
        finally:
            pool.kill()


@dataclass(kw_only=True, eq=False)
class _Pool:
    """The processes that are alive, at most `size`."""

    compute: ComputeBatch
    size: int
    watch: Watch | None = None
    busy: dict[Connection, _Worker] = field(default_factory=dict)
    idle: list[_Worker] = field(default_factory=list)

    @property
    def has_room(self) -> bool:
        return len(self.busy) < self.size

    def give(self, waiting: dict[Pack, deque[_Task]]) -> None:
        """Hand a task to a process that is idle, or to a new one."""
        worker = self.idle.pop() if self.idle else self._started()
        worker.pack = self._pack_for(worker, waiting)
        worker.task = waiting[worker.pack].popleft()
        if not waiting[worker.pack]:
            del waiting[worker.pack]
        self.busy[worker.connection] = worker
        # a process that has just died is noticed when its answer is read
        with contextlib.suppress(OSError):
            worker.connection.send(portable_batch(worker.task.batch))

    def _pack_for(self, worker: _Worker, waiting: Collection[Pack]) -> Pack:
        """The pack of its last task, else the first that no other process has begun, else any."""
        if worker.pack is not None and worker.pack in waiting:
            return worker.pack
        begun = {other.pack for other in (*self.busy.values(), *self.idle)}
        free = (pack for pack in waiting if pack not in begun)
        return next(free, None) or next(iter(waiting))

    def _started(self) -> _Worker:
        context = _context()
        ours, theirs = context.Pipe()
        process = context.Process(target=_serve, args=(theirs, self.compute, bool(self.watch)))
        process.daemon = True
        try:
            with _interruptions_held():
                process.start()
        finally:
            # the pipe must end with the process, so nobody else may hold its other end
            theirs.close()
        return _Worker(process=process, connection=ours)

    def ready(self) -> list[_Worker]:
        """Wait for processes that have answered or died."""
        return [self.busy[connection] for connection in wait(list(self.busy))]  # type: ignore[index]

    def receive(self, worker: _Worker) -> tuple[_Task, PortableResults | str | None] | None:
        """The task of a process with its results, with why there are none, or None if it died.

        None in place of both if the process has only said how far it is.
        """
        task = worker.task
        if task is None:  # pragma: no cover - only busy processes are asked
            raise ValueError("worker: it computes nothing")
        try:
            kind, answer = worker.connection.recv()
        except (EOFError, OSError):
            task.deaths += 1
            del self.busy[worker.connection]
            worker.connection.close()
            return task, None
        if kind == "progress":
            if self.watch is not None:
                self.watch(task.batch, *answer)
            return None
        del self.busy[worker.connection]
        worker.task = None
        self.idle.append(worker)
        return task, answer

    def dismiss(self) -> None:
        """Let idle processes end by themselves."""
        for worker in self.idle:
            worker.connection.close()
        for worker in self.idle:
            worker.process.join(_SECONDS_TO_LEAVE)

    def kill(self) -> None:
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


def _serve(connection: Connection, compute: ComputeBatch, reports_progress: object) -> None:
    """Compute what comes through the pipe until its other end is closed."""

    def report(done: int, n_steps: int) -> None:
        connection.send(("progress", (done, n_steps)))

    # a Ctrl-C reaches every process of a terminal; only the parent answers it
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # as in the process that asks
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    # the parent has gone: there is nobody to tell
    with contextlib.suppress(EOFError, OSError):
        while True:
            portable = connection.recv()
            with on_progress(report) if reports_progress else contextlib.nullcontext():
                answer = _answer_to(portable, compute)
            connection.send_bytes(answer)


def _answer_to(portable: Any, compute: ComputeBatch) -> bytes:
    try:
        return pickle.dumps(("results", compute_portable(compute, portable)))
    except MemoryError as error:
        return pickle.dumps(("lost", no_memory(error)))


def _end_with_parent() -> None:
    """End this process when its parent has, be it in the midst of a long batch."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
