"""The command line: every command by its name.

The commands import the rest of the project only when they run, so that ``--help`` is quick.
"""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, NoReturn

import typer

import fvi_cli
from fvi_cli.cli import compute, files
from fvi_cli.cli.exits import DONE

COMMANDS = (
    compute.run,
    compute.convergence,
    compute.plot,
    compute.quantities,
    compute.cost,
    compute.stability,
    compute.fit,
    compute.modes,
    compute.response,
    files.show,
    files.export,
    files.new,
    files.check,
    files.list_,
    files.guide,
)


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
        epilog = "\n\n".join(["Examples:", *one.examples]) if one.examples else None
        made.command(one.name, rich_help_panel=one.panel, epilog=epilog)(one.callback)
    return made


def command_line() -> Callable[[], object]:
    """A function that runs the command ``fvi``; building it takes a moment but starts nothing."""
    command = typer.main.get_command(app(sys.argv[1:]))

    def carried_out() -> None:
        signal.signal(signal.SIGTERM, _interrupt)
        # overflows need no warning: the status of a run reports them
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        command(prog_name="fvi")

    return carried_out


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Treat a termination signal like Ctrl-C, so that finished runs are kept."""
    raise KeyboardInterrupt


def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"fvi {fvi_cli.__version__}")
        raise typer.Exit(DONE)
