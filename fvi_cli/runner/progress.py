"""Messages on standard error while runs are computed."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

Advance = Callable[[str], None]

BAR_WIDTH = 20


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


@dataclass(frozen=True, kw_only=True)
class RunBar:
    """Callbacks that update a progress bar over runs."""

    # called with a description of every finished piece of work, its key and its number of steps
    finished: Callable[[str, Hashable, int], None]
    # called with a description of an unfinished piece, its key and its number of finished steps
    # (None: these do not count); None: there is no bar
    within: Callable[[str, Hashable, int | None], None] | None = None


@contextmanager
def progress_bar(title: str, total: int, *, wanted: bool) -> Iterator[Advance]:
    """Show a bar on standard error if it is `wanted` and standard error is a terminal.

    It yields a function; call it with a description of each of the `total` pieces when it is done.
    """
    with run_bar(title, total, total, wanted=wanted) as bar:
        yield lambda doing: bar.finished(doing, None, 1)


@contextmanager
def run_bar(title: str, runs: int, steps: int, *, wanted: bool) -> Iterator[RunBar]:
    """As :func:`progress_bar` for runs of different lengths: the bar and the time count steps.

    The description of the present run is cut to the remaining width, so that the bar, the count and
    the times are complete on a screen of 80 columns.

    The title is shown until the first run is described.
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
    from rich.table import Column

    columns = (
        BarColumn(bar_width=BAR_WIDTH),
        TextColumn("{task.fields[done]}/{task.fields[runs]}", table_column=Column(no_wrap=True)),
        TimeElapsedColumn(table_column=Column(no_wrap=True)),
        TimeRemainingColumn(compact=True, table_column=Column(no_wrap=True)),
        TextColumn("left", table_column=Column(no_wrap=True)),
        TextColumn(
            "{task.fields[doing]}",
            markup=False,
            table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"),
        ),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, expand=True) as progress:
        task = progress.add_task(
            "",
            total=steps,
            done=0,
            runs=runs,
            doing=title,
        )
        count, complete = 0, 0
        running: dict[Hashable, int] = {}

        def show(doing: str) -> None:
            reached = complete + sum(running.values())
            progress.update(task, completed=reached, done=count, doing=doing)

        def finished(doing: str, key: Hashable, steps: int) -> None:
            nonlocal count, complete
            count, complete = count + 1, complete + steps
            running.pop(key, None)
            show(doing)

        def within(doing: str, key: Hashable, done: int | None) -> None:
            if done is not None:
                # a piece may need several integrations: the one that is furthest counts
                running[key] = max(running.get(key, 0), done)
            show(doing)

        yield RunBar(finished=finished, within=within)
