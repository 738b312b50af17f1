"""Progress of the steps for a callback; without a callback this does no work."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from contextvars import ContextVar

STRIDE = 256
"""Loops over single steps report their progress after every 256 steps."""

SECONDS_BETWEEN = 0.1
"""Least seconds between two calls of the callback, unless it asks for others."""

Watcher = Callable[[int, int], None]
"""Called with the number of steps that are done, and N."""

_watcher: ContextVar[Watcher | None] = ContextVar("watcher", default=None)


@contextlib.contextmanager
def on_progress(watcher: Watcher, *, seconds_between: float | None = None) -> Iterator[None]:
    """Call `watcher` now and then with the progress of the integrations inside the block.

    Loops report their progress block by block; the watcher need not be passed on to them.
    """
    due = 0.0

    def seldom(done: int, n_steps: int) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + (SECONDS_BETWEEN if seconds_between is None else seconds_between)
            watcher(done, n_steps)

    token = _watcher.set(seldom)
    try:
        yield
    finally:
        _watcher.reset(token)


def report_progress(done: int, n_steps: int) -> None:
    """Report that `done` of `n_steps` steps are done."""
    watcher = _watcher.get()
    if watcher is not None:
        watcher(done, n_steps)
