"""What is said on standard error while runs are computed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

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


@dataclass(frozen=True, kw_only=True)
class RunBar:
    """What a bar over runs is told.

    Parameters
    ----------
    finished
        Called with a word on each piece of work that is done, and its number of steps.
    within
        Called with words on a piece that is being done, its key, and how many steps of it are done;
        None where nobody watches.
    """

    finished: Callable[[str, Hashable, int], None]
    within: Callable[[str, Hashable, int], None] | None = None


@contextmanager
def run_bar(title: str, runs: int, steps: int, *, wanted: bool) -> Iterator[RunBar]:
    """As :func:`progress_bar` for runs of different lengths: the bar and the time left go by steps.

    Parameters
    ----------
    title
        Beside the bar.
    runs, steps
        How many there are to compute, with how many steps altogether.
    wanted
        Whether to show it where standard error is a terminal.

    Yields
    ------
    RunBar
        To be told what is done.
    """
    if not (wanted and runs and sys.stderr.isatty()):
        yield RunBar(finished=lambda doing, key, steps: None)
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[done]}/{task.fields[runs]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[doing]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(title, total=steps, doing="", done=0, runs=runs)
        count, complete = 0, 0
        begun: dict[Hashable, int] = {}

        def show(doing: str) -> None:
            progress.update(task, completed=complete + sum(begun.values()), done=count, doing=doing)

        def finished(doing: str, key: Hashable, steps: int) -> None:
            nonlocal count, complete
            count, complete = count + 1, complete + steps
            begun.pop(key, None)
            show(doing)

        def within(doing: str, key: Hashable, done: int) -> None:
            # several integrations may belong to one piece: what is behind stays behind
            begun[key] = max(begun.get(key, 0), done)
            show(doing)

        yield RunBar(finished=finished, within=within)


def _say_nothing(doing: str) -> None:
    """Take note of progress that nobody watches."""
