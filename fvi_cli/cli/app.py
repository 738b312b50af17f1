"""The command line: every command by its name.

The rest of the project is imported inside the commands, so that ``--help`` is quick.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from typing import Annotated, NoReturn

import typer

import fvi_cli
from fvi_cli.cli.check import check
from fvi_cli.cli.convergence import convergence
from fvi_cli.cli.cost import cost
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.export import export
from fvi_cli.cli.fit import fit
from fvi_cli.cli.forget import forget
from fvi_cli.cli.guide import guide
from fvi_cli.cli.hard_cases import hard_cases
from fvi_cli.cli.list import list  # noqa: A004 - the command's name
from fvi_cli.cli.merge import merge
from fvi_cli.cli.modes import modes
from fvi_cli.cli.new import new
from fvi_cli.cli.plot import plot
from fvi_cli.cli.quantities import quantities
from fvi_cli.cli.response import response
from fvi_cli.cli.run import run
from fvi_cli.cli.schema import schema
from fvi_cli.cli.show import show
from fvi_cli.cli.stability import stability

COMMANDS = (
    run,
    convergence,
    plot,
    quantities,
    cost,
    stability,
    fit,
    modes,
    response,
    check,
    list,
    show,
    export,
    merge,
    forget,
    hard_cases,
    schema,
    new,
    guide,
)


def app(arguments: Sequence[str] = ()) -> typer.Typer:
    """The command line for these arguments; where they begin with a command, of that one alone.

    To work out what a command takes is most of what there is to do before it begins.
    """
    made = typer.Typer(
        name="fvi",
        help="Experiments with fractional variational integrators.",
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"max_content_width": 120},
    )
    made.callback(invoke_without_command=True)(_root)
    named = [one for one in COMMANDS if one.__name__.replace("_", "-") in arguments[:1]]
    for command in named or COMMANDS:
        # given by itself it is not cut where the screen is narrow
        made.command(short_help=(command.__doc__ or "").partition("\n")[0])(command)
    return made


def command_line() -> Callable[[], object]:
    """What the command ``fvi`` does; to put it together takes a moment, in which nothing begins."""
    command = typer.main.get_command(app(sys.argv[1:]))

    def carried_out() -> None:
        _open_standard_streams()
        sys.unraisablehook = _not_ignored
        signal.signal(signal.SIGTERM, _interrupt)
        # what overflows on the way is told by the status of a run
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        command(prog_name="fvi")

    return carried_out


def _open_standard_streams() -> None:
    """Let what is said go nowhere where a standard stream is closed, and into no file."""
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


def _not_ignored(unraisable: sys.UnraisableHookArgs) -> None:
    """Interrupt once more where a Ctrl-C fell into a callback, whose exceptions Python ignores."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.01, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(unraisable)


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Let a termination leave through the same door as Ctrl-C: finished runs are kept."""
    raise KeyboardInterrupt


def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"fvi {fvi_cli.__version__}")
        raise typer.Exit(DONE)
