"""Messages on standard error while runs are computed."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

Advance = Callable[..., None]
"""Called with a description of what is done, and a number if that is more than one piece."""

SECONDS_BETWEEN_LINES = 10.0

_logger = logging.getLogger(__name__)


class StandardErrorHandler(logging.Handler):
    """Writes to the present ``sys.stderr``, which a progress bar replaces while it is shown."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record as one line; if the stream is closed, the computation goes on."""
        with suppress(OSError):
            print(self.format(record), file=sys.stderr)  # noqa: T201


def configure_logging(level: int) -> logging.Logger:
    """Send only records of this program of at least `level` to standard error."""
    logger = logging.getLogger("fvi_cli")
    for handler in list(logger.handlers):
        logger.removeHandler(handler)
    logger.addHandler(StandardErrorHandler())
    logger.setLevel(level)
    logger.propagate = False
    return logger


@contextmanager
def progress_bar(title: str, total: int, *, wanted: bool) -> Iterator[Advance]:
    """Show how many of `total` pieces are done: a bar on a terminal, elsewhere a line now and then.

    It yields a function that is called when something is done. Nothing is shown unless it is
    `wanted`.
    """
    if not (wanted and total):
        yield lambda doing, count=1: None
    elif sys.stderr.isatty():
        with _bar(title, total) as advance:
            yield advance
    else:
        with _lines(title, total) as advance:
            yield advance


@contextmanager
def _lines(title: str, total: int) -> Iterator[Advance]:
    done, ended = 0, threading.Event()

    def report() -> None:
        while not ended.wait(SECONDS_BETWEEN_LINES):
            _logger.info("%s: %d of %d done", title, done, total)

    def advance(doing: str, count: int = 1) -> None:
        nonlocal done
        done += count

    reporter = threading.Thread(target=report, daemon=True)
    reporter.start()
    try:
        yield advance
    finally:
        ended.set()
        reporter.join()


@contextmanager
def _bar(title: str, total: int) -> Iterator[Advance]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.table import Column

    # the description is cut, so that the bar and the count are whole on 80 columns
    doing = TextColumn(
        "{task.description}",
        markup=False,
        table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
    )
    columns = (BarColumn(bar_width=20), MofNCompleteColumn(), TimeElapsedColumn(), doing)
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as progress:
        task = progress.add_task(title, total=total)

        def advance(doing: str, count: int = 1) -> None:
            progress.update(task, advance=count, description=doing.removeprefix(f"{title} "))

        yield advance
