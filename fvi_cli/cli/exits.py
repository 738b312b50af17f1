"""How a command ends: exit codes, and messages on standard error.

Exit codes: 0 done; 1 a run failed unexpectedly; 2 a request or configuration that cannot be carried
out; 3 a check did not hold; 130 interrupted. Standard output carries results, standard error
everything else.
"""

from __future__ import annotations

import functools
import logging
import os
import sys
from collections.abc import Callable
from typing import Any

import typer

from fvi_cli.errors import FviError, RequestError

_logger = logging.getLogger("fvi_cli")

DONE, RUN_FAILED, WRONG_REQUEST, CHECK_FAILED, INTERRUPTED = 0, 1, 2, 3, 130


def guarded(command: Callable[..., int]) -> Callable[..., None]:
    """Turn the value of `command`, and whatever it raises, into an exit code."""

    @functools.wraps(command)
    def wrapped(**options: Any) -> None:
        from fvi_cli.runner.progress import configure_logging

        quiet, verbose = bool(options.get("quiet")), bool(options.get("verbose"))
        configure_logging(logging.ERROR if quiet else logging.DEBUG if verbose else logging.WARNING)
        try:
            code = command(**options)
            sys.stdout.flush()
        except BrokenPipeError:
            # the reader of the pipe has ended; the interpreter would complain once more at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = DONE
        except (Exception, KeyboardInterrupt) as error:
            code, words = _ending(error)
            print(words, file=sys.stderr)
            if code == RUN_FAILED:
                _logger.debug("", exc_info=error)
        raise typer.Exit(code)

    return wrapped


def _ending(error: BaseException) -> tuple[int, str]:
    """The exit code of an exception, and the message."""
    match error:
        case RequestError():
            # as it is: a line may begin with file:line:column, as editors understand it
            return WRONG_REQUEST, str(error)
        case FviError() | OSError():
            return WRONG_REQUEST, f"fvi: {error}"
        case KeyboardInterrupt():
            return INTERRUPTED, "fvi: interrupted; the same command goes on"
        case MemoryError():
            return RUN_FAILED, f"fvi: not enough memory {error}".rstrip()
    words = f"fvi: unexpected {type(error).__name__}: {error}"
    return RUN_FAILED, f"{words}\nfvi: this is a mistake of the program; -v shows where"
