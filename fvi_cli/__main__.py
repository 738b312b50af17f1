"""The entry point of ``python -m fvi_cli`` and of the command ``fvi``.

Loading the command line takes a moment, in which an interruption would show a traceback of imports.
There is nothing to save yet, so an interruption then ends the process at once.
"""

from __future__ import annotations

import io
import os
import signal
import sys
from typing import NoReturn

INTERRUPTED = 130


def main() -> None:
    """Entry point: load the command line, then run it."""
    usual = signal.getsignal(signal.SIGINT)
    # if the parent process ignores Ctrl-C, it stays ignored
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    from fvi_cli.cli.app import command_line

    # names of files may contain any bytes, and a terminal may only support ASCII
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    run = command_line()
    signal.signal(signal.SIGINT, usual)
    run()


def _leave(signal_number: int, frame: object) -> NoReturn:
    """End silently; an exception could be caught or wrapped by modules that are being loaded."""
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
