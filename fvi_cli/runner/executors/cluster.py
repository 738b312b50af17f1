"""Jobs computed by the workers of a Dask scheduler."""

from __future__ import annotations

import importlib
import logging
import queue
import threading
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from fvi_cli.errors import ExecutorError
from fvi_cli.runner.executors.batches import Pack
from fvi_cli.runner.executors.executor import Answer, Died, Executor
from fvi_cli.runner.executors.jobs import ComputeJob, Job, References, no_memory
from fvi_cli.runner.executors.portable import (
    PortableJob,
    PortableResults,
    compute_portable,
    portable_job,
    returned_results,
)

if TYPE_CHECKING:
    from distributed import Client, Future

_logger = logging.getLogger(__name__)

CONNECTION_SECONDS = 20.0
"""Longest wait for an answer of the scheduler, which may be slow on a busy machine."""
_CLOSING_SECONDS = 2.0
_SECONDS_BETWEEN_LOOKS = 5.0
_JOBS_AHEAD = 2
_LEAST_AHEAD = 8
_UNREADABLE = "deserialization of the task graph"

_ONE_AT_A_TIME = threading.Lock()
"""Held while a worker computes: threads of one process would share the precision of mpmath."""


@dataclass(kw_only=True, eq=False)
class DaskCluster(Executor):
    """Computes on the workers of an existing Dask scheduler.

    Only so many jobs are sent ahead as keep the workers busy, so that neither this process nor the
    scheduler has to hold them all. When a worker dies, the scheduler gives its jobs to other
    workers, as often as its setting ``distributed.scheduler.allowed-failures`` says (default 3).
    It does not know which of the jobs on that worker was the reason. So a job that the scheduler
    gives up is sent once more, after all others and by itself. If its workers die again, it is
    lost.

    Its methods raise an :class:`ExecutorError` if `distributed` is not installed, the scheduler
    does not answer or ends, or its workers cannot use the jobs that are sent to them.
    """

    address: str  # address of the scheduler, such as tcp://10.0.0.1:8786
    client: Client | None = None  # the connection; made for the first job
    running: dict[Future[Any], Job] = field(init=False, default_factory=dict)
    done: queue.SimpleQueue[Future[Any]] = field(init=False, default_factory=queue.SimpleQueue)
    ahead: int | None = field(init=False, default=None)
    has_warned_idle: bool = field(init=False, default=False)

    def room(self) -> tuple[bool, Pack | None]:
        """As :meth:`Executor.room`."""
        if self.ahead is None:
            self.ahead = self._ahead(self._connected())
        return len(self.running) < self.ahead, None

    def _connected(self) -> Client:
        if self.client is None:
            self.client = connect(self.address)
        return self.client

    def send(self, job: Job, references: References) -> None:
        """As :meth:`Executor.send`."""
        portable = portable_job(job, references)
        future: Future[Any] = self._connected().submit(
            compute_one_at_a_time, self.compute_job, portable, pure=False
        )
        self.running[future] = job
        future.add_done_callback(self.done.put)

    def answers(self) -> Iterable[tuple[Job, Answer]]:
        """As :meth:`Executor.answers`; empty when it is time to count the workers again."""
        try:
            future = self.done.get(timeout=_SECONDS_BETWEEN_LOOKS)
        except queue.Empty:
            self.ahead = None
            return []
        # the answer of a job that was given up meanwhile
        if future not in self.running:
            return []
        job = self.running.pop(future)
        return [(job, self._answer(future, job))]

    def _ahead(self, client: Client) -> int:
        """Number of jobs that may be sent ahead; warns when the scheduler has no workers."""
        if client.status != "running":
            raise ExecutorError(_lost_scheduler(self.address))
        threads = client.nthreads()
        if not threads and not self.has_warned_idle:
            _logger.warning("%s: the scheduler has no workers; waiting for them", self.address)
        self.has_warned_idle = not threads
        return max(_LEAST_AHEAD, _JOBS_AHEAD * len(threads))

    def _answer(self, future: Future[Any], job: Job) -> Answer:
        """The results of a job, or why there are none."""
        from distributed import CancelledError, KilledWorker
        from distributed.comm.core import CommClosedError

        try:
            return returned_results(job, future.result())
        except KilledWorker as error:
            message = "the worker that computed it died (out of memory?)"
            return Died(message=message, times=error.allowed_failures + 1)
        except MemoryError as error:
            return no_memory(error)
        except (CancelledError, CommClosedError):
            raise ExecutorError(_lost_scheduler(self.address)) from None
        except (ModuleNotFoundError, RuntimeError) as error:
            if isinstance(error, RuntimeError) and _UNREADABLE not in str(error):
                raise
            raise ExecutorError(
                f"{self.address}: scheduler and workers must have the same version of fvi "
                f"installed as this process: {' '.join(str(error).split())}"
            ) from None

    def stop(self) -> None:
        """As :meth:`Executor.stop`; the workers do not belong to this process and go on."""
        client, self.client = self.client, None
        if client is not None:
            if self.running and client.status == "running":
                client.cancel(list(self.running), force=True)
            client.close(timeout=_CLOSING_SECONDS)
        self.running, self.ahead = {}, None


def compute_one_at_a_time(compute: ComputeJob, portable: PortableJob) -> PortableResults:
    """Compute a job on a worker, one at a time in each process.

    Raises
    ------
    ExecutorError
        If the code of the worker differs from that of the sender; names the worker.
    """
    from distributed import get_worker

    with _ONE_AT_A_TIME:
        try:
            return compute_portable(compute, portable)
        except ExecutorError as error:
            worker = get_worker()
            raise ExecutorError(f"worker {worker.name} at {worker.address}: {error}") from None


def connect(address: str) -> Client:
    """Connect to a scheduler, or raise with the reason, after half a minute at most.

    A port that accepts connections but never answers would block the constructor for ever, so
    another thread calls it.
    """
    try:
        importlib.import_module("distributed")
    except ModuleNotFoundError as error:
        raise ExecutorError(
            f"--dask needs the package {error.name}: install fvi-cli[dask]"
        ) from None
    # the package logs tracebacks of broken connections; the errors here replace them
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    from distributed import Client

    answers: queue.SimpleQueue[Client | Exception] = queue.SimpleQueue()

    def begin() -> None:
        try:
            answers.put(Client(address, timeout=CONNECTION_SECONDS, set_as_default=False))
        except Exception as error:
            answers.put(error)

    threading.Thread(target=begin, daemon=True).start()
    try:
        answer = answers.get(timeout=1.5 * CONNECTION_SECONDS)
    except queue.Empty:
        answer = TimeoutError(f"silent for {1.5 * CONNECTION_SECONDS:g} s")
    if isinstance(answer, Exception):
        if not isinstance(answer, OSError | ValueError | TypeError):
            raise answer
        raise ExecutorError(f"{address}: no Dask scheduler answers there: {answer}") from None
    return answer


def _lost_scheduler(address: str) -> str:
    return (
        f"{address}: the Dask scheduler is gone; finished runs are stored; "
        "rerun the command to resume"
    )
