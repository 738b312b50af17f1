"""Batches computed by any executor of :mod:`concurrent.futures`, of which Dask has one too.

A worker that dies takes its pool with it: a new pool goes on, and each batch that was under way is
computed once more, alone.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from typing import Any

from fvi_cli.errors import ExecutorError, RequestError
from fvi_cli.runner.work import Batch, Computed, compute, compute_packed, packed

AHEAD = 2
"""Batches for each worker that are sent before they are needed."""
DASK_WORKERS = 64
"""Workers of a scheduler for which batches are sent ahead; more of them wait a moment."""
CONNECTION_SECONDS = 20.0
"""Longest wait for an answer of a Dask scheduler, which may be slow on a busy machine."""

_SCHEMES = ("tcp", "tls", "ucx", "ws", "wss", "inproc")
_Pool = Callable[[int], contextlib.AbstractContextManager[Executor]]
Result = Computed | BaseException


class InProcess(Executor):
    """Computes at once in this process."""

    def submit(self, work: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """As :meth:`Executor.submit`."""
        future: Future[Any] = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextlib.contextmanager
def _processes(workers: int) -> Iterator[Executor]:
    """A pool of processes of this machine, which end when the block is left by an exception."""
    method = "forkserver" if sys.platform == "linux" else "spawn"
    context = multiprocessing.get_context(method)
    if method == "forkserver":
        context.set_forkserver_preload(["fvi_cli.runner.executor"])
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_begin)
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    pool.shutdown()


def _begin() -> None:
    """Prepare a process: only its parent answers Ctrl-C, and it ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent was killed: else it would compute on."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


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


def _dask(address: str) -> _Pool:
    """The workers of a Dask scheduler."""

    @contextlib.contextmanager
    def opened(_: int) -> Iterator[Executor]:
        try:
            from distributed import Client
        except ModuleNotFoundError as error:
            raise ExecutorError(
                f"--dask needs the package {error.name}: install fvi-cli[dask]"
            ) from None
        # the package logs tracebacks of broken connections; the errors here replace them
        logging.getLogger("distributed").setLevel(logging.CRITICAL)
        try:
            client = Client(address, timeout=CONNECTION_SECONDS, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise ExecutorError(f"{address}: no Dask scheduler answers there: {error}") from None
        with client, client.get_executor(pure=False, retries=0) as pool:
            yield pool

    return opened


def check_workers(workers: int, dask: str | None) -> None:
    """Refuse processes and a scheduler at the same time, and what is no address.

    Raises
    ------
    RequestError
        With what to write.
    """
    if dask is not None and workers > 1:
        raise RequestError("--workers and --dask: give one of them; a scheduler has its own")
    scheme, separator, _ = (dask or "").partition("://")
    if separator and scheme not in _SCHEMES:
        raise RequestError(
            f"--dask {dask}: is not the address of a scheduler, such as tcp://host:8786"
        )


def compute_all(
    batches: Sequence[Batch],
    workers: int,
    dask: str | None,
    *,
    prepare: Callable[[Batch], Batch | None],
) -> Iterator[tuple[Batch, Result]]:
    """Yield every batch with its part, or with the exception if it failed twice.

    `prepare` is called before a batch is sent; None: it is not needed any more.
    """
    pool: _Pool
    if dask is not None:
        pool, workers = _dask(dask), DASK_WORKERS
    else:
        pool = _processes if workers > 1 else lambda _: InProcess()
    waiting, suspects = deque(batches), list[Batch]()
    while waiting:
        with pool(workers) as executor:
            yield from _drain(executor, waiting, suspects, AHEAD * workers, prepare)
    for batch in suspects:
        with pool(1) as executor:
            yield from _drain(executor, deque([batch]), None, 1, prepare)


def _drain(
    pool: Executor,
    waiting: deque[Batch],
    suspects: list[Batch] | None,
    most: int,
    prepare: Callable[[Batch], Batch | None],
) -> Iterator[tuple[Batch, Result]]:
    """Compute until nothing waits, or the pool is broken; failed batches become suspects."""
    futures: dict[Future[Any], Batch] = {}
    is_sound = True
    while futures or (waiting and is_sound):
        while is_sound and waiting and len(futures) < most:
            batch = waiting.popleft()
            ready = prepare(batch)
            if ready is None:
                continue
            try:
                futures[_submitted(pool, ready)] = batch
            except BrokenExecutor:  # since the last answer
                waiting.appendleft(batch)
                is_sound = False
            if isinstance(pool, InProcess):
                break
        for future in wait(futures, return_when=FIRST_COMPLETED).done if futures else ():
            batch = futures.pop(future)
            if future.cancelled():
                raise ExecutorError("the Dask scheduler is gone; run the command again to go on")
            error = future.exception()
            if error is None:
                yield batch, future.result()
            elif isinstance(error, ExecutorError):
                raise error
            elif suspects is None:
                yield batch, error
            else:
                suspects.append(batch)
                is_sound = is_sound and not isinstance(error, BrokenExecutor)


def _submitted(pool: Executor, batch: Batch) -> Future[Any]:
    if isinstance(pool, InProcess):
        return pool.submit(compute, batch)
    # processes start here
    with _interruptions_held():
        return pool.submit(compute_packed, packed(batch))
