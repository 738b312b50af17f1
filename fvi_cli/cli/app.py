"""The command line: every command by its name.

The commands import the rest of the project only when they run, so that ``--help`` is quick.
"""

from __future__ import annotations

import _thread
import contextlib
import inspect
import io
import itertools
import os
import signal
import sys
import textwrap
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

import fvi_cli
from fvi_cli.cli import compute, configurations, files, report
from fvi_cli.cli.command import Command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import CLUSTERS

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

GROUPS: Mapping[str, tuple[Command, ...]] = {
    "Compute": (compute.run, compute.cost, compute.stability, compute.fit),
    "Report": (report.convergence, report.plot, report.quantities),
    "Linear structures": (compute.modes, compute.response),
    "Result files": (files.show, files.export),
    "Configurations": (
        configurations.new,
        configurations.check,
        configurations.list_,
    ),
    "Help": (configurations.guide,),
}
COMMANDS = tuple(itertools.chain.from_iterable(GROUPS.values()))


class _Groups(TyperGroup):
    """Lists the commands group by group."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        for title, commands in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl([(one.name, one.summary) for one in commands])


class _Options(TyperCommand):
    """Lists rarely used options in a section below the others; shows an example on errors."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            lines = [one.strip() for one in (self.epilog or "").splitlines()]
            example = next((one for one in lines if one.startswith("fvi ")), "")
            # click has no message of its own for a missing argument
            if example and not error.message:
                error.message = f"Write, for example, {example}"
            raise

    def format_options(self, ctx: Any, formatter: Any) -> None:
        sections: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            usual = "Arguments" if one.param_type_name == "argument" else "Options"
            title = getattr(one, "rich_help_panel", None) or usual
            if (record := one.get_help_record(ctx)) is not None:
                # without the type, which is a name of Python
                words, text = record[0].partition(" <")[0], record[1]
                sections.setdefault(title, []).append((words, text))
        # options that few users need come last
        for title in sorted(sections, key=["Arguments", "Options", CLUSTERS].index):
            with formatter.section(title):
                formatter.write_dl(sections[title])


def app(arguments: Sequence[str] = ()) -> typer.Typer:
    """The command line for these arguments; only one command if they begin with its name.

    Collecting the options of a command takes most of the time before it starts.
    """
    made = typer.Typer(
        name="fvi",
        cls=_Groups,
        help="Experiments with fractional variational integrators.",
        no_args_is_help=True,
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"max_content_width": 120, "help_option_names": ["-h", "--help"]},
    )
    made.callback(invoke_without_command=True)(_root)
    named = [one for one in COMMANDS if one.name in arguments[:1]]
    for command in named or COMMANDS:
        lines = inspect.cleandoc(command.examples)
        epilog = f"Examples:\n\n\b\n{textwrap.indent(lines, '  ')}" if lines else None
        made.command(command.name, cls=_Options, epilog=epilog)(command.callback())
    return made


def command_line() -> Callable[[], object]:
    """A function that runs the command ``fvi``; building it takes a moment but starts nothing."""
    command = typer.main.get_command(app(sys.argv[1:]))

    def carried_out() -> None:
        _open_standard_streams()
        sys.unraisablehook = _not_ignored
        signal.signal(signal.SIGTERM, _interrupt)
        # overflows need no warning: the status of a run reports them
        warnings.filterwarnings("ignore", category=RuntimeWarning)
        command(prog_name="fvi")

    return carried_out


def _open_standard_streams() -> None:
    """Discard output where a standard stream is closed, so that it reaches no file.

    Text that standard error refuses is dropped too. Python would keep it and try to write it again
    when it starts a process (which then fails) and at its end (with an exit code of its own).
    """
    while (handle := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(handle)
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)
    if os.name == "posix":
        sys.stderr = io.TextIOWrapper(
            io.BufferedWriter(_Unheard(2, "w", closefd=False)),
            encoding=sys.stderr.encoding,
            errors="backslashreplace",
            line_buffering=True,
        )


class _Unheard(io.FileIO):
    """A file that accepts and drops data that its device refuses."""

    def write(self, words: ReadableBuffer, /) -> int:
        with contextlib.suppress(OSError):
            return super().write(words)
        return memoryview(words).nbytes


def _not_ignored(unraisable: sys.UnraisableHookArgs) -> None:
    """Repeat a Ctrl-C that came within a callback, since Python ignores exceptions there."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.01, _thread.interrupt_main).start()
    else:
        sys.__unraisablehook__(unraisable)


def _interrupt(signal_number: int, frame: object) -> NoReturn:
    """Treat a termination signal like Ctrl-C, so that finished runs are kept."""
    raise KeyboardInterrupt


def _root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"fvi {fvi_cli.__version__}")
        raise typer.Exit(DONE)
