"""How a command ends: exit codes, and messages on standard error.

Exit codes: 0 done; 1 a run failed unexpectedly; 2 a request or configuration that cannot be carried
out; 3 a check did not hold; 130 interrupted. Standard output carries results, standard error
everything else.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import os
import sys
import traceback
from collections.abc import Callable, Mapping
from typing import ParamSpec

import typer

from fvi_cli.errors import FviError, RequestError

DONE, RUN_FAILED, WRONG_REQUEST, CHECK_FAILED, INTERRUPTED = 0, 1, 2, 3, 130

P = ParamSpec("P")


def guarded(command: Callable[P, int]) -> Callable[P, None]:
    """Turn the value of `command`, and whatever it raises, into an exit code."""

    @functools.wraps(command)
    def wrapped(*args: P.args, **kwargs: P.kwargs) -> None:
        verbose = bool(kwargs.get("verbose"))
        from fvi_cli.runner.progress import configure_logging

        level = logging.DEBUG if verbose else logging.INFO
        configure_logging(logging.ERROR if kwargs.get("quiet") else level)
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except RequestError as error:
            # as they are: the line may begin with file:line:column, as editors understand it
            _say(*error.complaints)
            code = WRONG_REQUEST
        except FviError as error:
            _say(f"fvi: {error}")
            code = WRONG_REQUEST
        except KeyboardInterrupt:
            stored = "; finished runs are stored; rerun the command to resume"
            _say(f"fvi: interrupted{stored if _keeps_runs(kwargs) else ''}")
            code = INTERRUPTED
        except MemoryError as error:
            detail = f": {error}" if str(error) else ""
            stored = "; finished runs are stored" if _keeps_runs(kwargs) else ""
            _say(f"fvi: not enough memory{detail}{stored}")
            code = RUN_FAILED
        except BrokenPipeError:
            # the reader of the pipe has ended; the interpreter would complain once more at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = DONE
        except OSError as error:
            # a folder that is not there, a full disk, no permission
            place = f"{error.filename}: " if error.filename else ""
            _say(f"fvi: {place}{error.strerror or error}")
            code = WRONG_REQUEST
        except Exception as error:
            # the last line of defence: users see a traceback only if they ask for it
            if verbose:
                traceback.print_exc()
            _say(f"fvi: unexpected {type(error).__name__}: {error}")
            if not verbose:
                _say("fvi: this is a mistake of the program; -v shows where it happened")
            code = RUN_FAILED
        raise typer.Exit(code)

    return wrapped


def _keeps_runs(options: Mapping[str, object]) -> bool:
    """Whether the command stores runs: those that do have the option ``--fresh``."""
    return "fresh" in options and not options.get("check") and not options.get("dry_run")


def _say(*lines: str) -> None:
    for line in lines:
        with contextlib.suppress(OSError):
            print(line, file=sys.stderr)
