"""Pieces of work, and what standard error shows while they are done."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

Advance = Callable[[int], object]
"""Called with the number of pieces that are done."""

SECONDS_BETWEEN_LINES = 10.0


@dataclass(frozen=True, kw_only=True)
class Task:
    """A piece of work that a command does, or names with ``--dry-run``."""

    experiment: str
    action: str  # such as "fit zener", for runs "compute" or "reuse"
    of: str  # what it is done with: "damping.0.order to decay.csv"
    memory_bytes: int | None = None  # memory that a run takes by itself
    work: Callable[[], Any] = lambda: None

    @property
    def row(self) -> dict[str, Any]:
        """What is told of it."""
        names = ("experiment", "action", "of", "memory_bytes")
        return {name: getattr(self, name) for name in names}


def carry_out(tasks: Sequence[Task], title: str, *, progress: bool) -> list[Any]:
    """The results of tasks, one after the other."""
    results = []
    with progress_bar(title, len(tasks), wanted=progress) as advance:
        for task in tasks:
            results.append(task.work())
            advance(1)
    return results


class StandardErrorHandler(logging.Handler):
    """Writes to the present ``sys.stderr``, which a progress bar replaces while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record as one line; if the stream is closed, the computation goes on."""
        with suppress(OSError):
            print(self.format(record), file=sys.stderr)  # noqa: T201


def configure_logging(level: int) -> None:
    """Send only records of this program of at least `level` to standard error."""
    logger = logging.getLogger("fvi_cli")
    logger.handlers = [StandardErrorHandler()]
    logger.setLevel(level)
    logger.propagate = False


@contextmanager
def progress_bar(title: str, total: int, *, wanted: bool) -> Iterator[Advance]:
    """Show how many of `total` pieces are done: a bar on a terminal, elsewhere a line now and then.

    It yields a function that is called when some are done.
    """
    if not (wanted and total):
        yield lambda count: None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeElapsedColumn

        columns = ("{task.description}", BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(title, total=total)
            yield lambda count: bar.advance(task, count)
    else:
        with _lines(title, total) as advance:
            yield advance


@contextmanager
def _lines(title: str, total: int) -> Iterator[Advance]:
    done, ended = list[int](), threading.Event()

    def report() -> None:
        while not ended.wait(SECONDS_BETWEEN_LINES):
            print(f"{title}: {sum(done)} of {total} done", file=sys.stderr, flush=True)  # noqa: T201

    reporter = threading.Thread(target=report, daemon=True)
    reporter.start()
    try:
        yield done.append
    finally:
        ended.set()
        reporter.join()
