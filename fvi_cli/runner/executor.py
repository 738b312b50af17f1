"""Batches computed by any executor of :mod:`concurrent.futures`, of which Dask has one too."""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)

from fvi_cli.errors import RequestError
from fvi_cli.runner.work import Batch, compute, compute_packed, packed

AHEAD = 2
"""Batches for each worker that are sent before they are needed."""
DASK_WORKERS = 64
"""Workers of a scheduler for which batches are sent ahead; more of them wait a moment."""
LONGEST_WAIT = 0.2
"""Seconds between looks for Ctrl-C."""
CONNECTION_SECONDS = 20.0
"""Longest wait for an answer of a Dask scheduler, which may be slow on a busy machine."""

_Pool = Callable[[], contextlib.AbstractContextManager[Executor]]
Result = bytes | Exception
"""The part of a batch, or what prevented it."""


def compute_all(
    batches: Iterable[Batch], workers: int, dask: str | None
) -> Iterator[tuple[Batch, Result]]:
    """Yield every batch with its result.

    A worker that dies takes its pool with it: a new pool goes on. Each batch that was under way, or
    failed, is computed once more, alone.
    """
    if dask is None and workers == 1:
        for batch in batches:
            try:
                result: Result = compute(batch)
            except Exception as error:
                result = error
            yield batch, result
        return
    pool: _Pool = functools.partial(_processes, workers)
    if dask is not None:
        pool, workers = functools.partial(_dask, dask), DASK_WORKERS
    waiting, failed = iter(batches), dict[Batch, Exception]()
    for most in (AHEAD * workers, 1):
        failed = {}
        while first := list(itertools.islice(waiting, most)):
            with pool() as executor:
                yield from _drain(executor, itertools.chain(first, waiting), most, failed)
        waiting = iter(failed)
    yield from failed.items()


def _drain(
    pool: Executor, waiting: Iterator[Batch], most: int, failed: dict[Batch, Exception]
) -> Iterator[tuple[Batch, Result]]:
    """Compute until nothing waits, or the pool is broken, and note the batches without result."""
    futures: dict[Future[bytes], Batch] = {}
    try:
        with _noted_signals() as signals:
            while not signals:
                for batch in itertools.islice(waiting, most - len(futures)):
                    futures[pool.submit(compute_packed, packed(batch))] = batch
                if not futures:
                    return
                for future in wait(futures, LONGEST_WAIT, FIRST_COMPLETED).done:
                    batch = futures.pop(future)
                    error = future.exception()
                    if error is None:
                        yield batch, future.result()
                    elif isinstance(error, Exception) and not isinstance(error, BrokenExecutor):
                        failed[batch] = error
                    else:
                        raise error
        raise KeyboardInterrupt
    except BrokenExecutor as error:
        failed |= dict.fromkeys([batch, *futures.values()], error)
    except CancelledError:
        raise RequestError("the Dask scheduler is gone; run the command again to go on") from None


@contextlib.contextmanager
def _noted_signals() -> Iterator[list[int]]:
    """Signals to end that come meanwhile: an exception would leave locks of futures closed."""
    noted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield noted
        return
    usual = {
        number: signal.signal(number, lambda number, frame: noted.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield noted
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _processes(workers: int) -> Iterator[Executor]:
    """A pool of processes of this machine, which end when the block is left by an exception."""
    context: multiprocessing.context.BaseContext = multiprocessing.get_context("spawn")
    if sys.platform == "linux":
        from multiprocessing import forkserver, resource_tracker

        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([__name__])
        # a Ctrl-C reaches all processes of a terminal, also while they import their modules; the
        # start of the tracker would unblock it
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
    others = set(multiprocessing.active_children())
    with ProcessPoolExecutor(workers, mp_context=context, initializer=_begin) as pool:
        try:
            yield pool
        except BaseException:
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()
            raise


def _begin() -> None:
    """Prepare a process: only its parent answers Ctrl-C, and it ends with its parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, daemon=True).start()


@contextlib.contextmanager
def _dask(address: str) -> Iterator[Executor]:
    """The workers of a Dask scheduler."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise RequestError(
            f"--dask needs the package {error.name}: install fvi-cli[dask]"
        ) from None
    # the package logs tracebacks of broken connections; the errors here replace them
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECTION_SECONDS, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise RequestError(f"{address}: no Dask scheduler answers there: {error}") from None
    with client, client.get_executor(pure=False, retries=0) as pool:
        yield pool
