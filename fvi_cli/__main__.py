"""``python -m fvi_cli`` does what the command ``fvi`` does; both begin here.

Loading the command line takes a moment in which an interruption would show a traceback of imports;
there is nothing to save yet, so that the process ends at once.
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
    # ignored by the process that started this one: it stays ignored
    if usual is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    from fvi_cli.cli.app import command_line

    # names of files hold any bytes, and terminals may know ASCII alone
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    run = command_line()
    signal.signal(signal.SIGINT, usual)
    run()


def _leave(signal_number: int, frame: object) -> NoReturn:
    """End without a word; an exception could be caught, or wrapped, by what is being loaded."""
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
