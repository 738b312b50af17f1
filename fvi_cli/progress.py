"""What is said on standard error while runs are computed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Advance = Callable[[str], None]


class StandardErrorHandler(logging.Handler):
    """Writes to what ``sys.stderr`` is at that moment, so that a progress bar can step aside."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record as one line."""
        print(self.format(record), file=sys.stderr)  # noqa: T201


def configure_logging(level: int) -> logging.Logger:
    """Send the records of this program from `level` on to standard error, and no others."""
    logger = logging.getLogger("fvi_cli")
    for handler in list(logger.handlers):
        logger.removeHandler(handler)
    logger.addHandler(StandardErrorHandler())
    logger.setLevel(level)
    logger.propagate = False
    return logger


@contextmanager
def progress_bar(title: str, total: int, *, wanted: bool) -> Iterator[Advance]:
    """Show a bar on standard error if it is `wanted` and standard error is a terminal.

    Yields
    ------
    Advance
        Function to be called with a word on each of the `total` pieces of work that is done.
    """
    if not (wanted and total and sys.stderr.isatty()):
        yield _say_nothing
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[doing]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=total, doing="")
        yield lambda doing: progress.update(task, advance=1, doing=doing)


def _say_nothing(doing: str) -> None:
    """Take note of progress that nobody watches."""
