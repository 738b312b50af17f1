"""The command line: every command by its name.

The commands import the rest of the project only when they run, so that ``--help`` is quick.
"""

from __future__ import annotations

import io
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import Annotated, NoReturn

import typer

import fvi_cli
import fvi_cli.cli.compute
import fvi_cli.cli.files
from fvi_cli.cli.command import COMMANDS
from fvi_cli.cli.exits import DONE


def app(arguments: Sequence[str] = ()) -> typer.Typer:
    """The command line for these arguments; only one command if they begin with its name.

    Collecting the options of a command takes most of the time before it starts.
    """
    made = typer.Typer(
        name="fvi",
        help="Experiments with fractional variational integrators.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback(invoke_without_command=True)(_root)
    named = [one for one in COMMANDS if one.name in arguments[:1]]
    for one in named or COMMANDS:
        made.command(one.name, rich_help_panel=one.panel)(one.callback)
    return made


def command_line() -> None:
    """Run the command ``fvi``."""
    # names of files may contain any bytes, and a terminal may only support ASCII
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    signal.signal(signal.SIGTERM, _interrupt)
    # overflows need no warning: the status of a run reports them
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    app(sys.argv[1:])(prog_name="fvi")


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Treat a termination signal like Ctrl-C, so that finished runs are kept."""
    raise KeyboardInterrupt


def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"fvi {fvi_cli.__version__}")
        raise typer.Exit(DONE)
