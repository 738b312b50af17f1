"""``fvi new``: a commented configuration to start from."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.completion import kinds_of_problems
from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Verbose


@guarded
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the experiment.")],
    kind: Annotated[
        str,
        typer.Option(
            "--kind",
            metavar="KIND",
            help="Kind of the problem.",
            autocompletion=kinds_of_problems,
        ),
    ] = "damped-oscillator",
    verbose: Verbose = False,
) -> int:
    """Write a commented configuration NAME.yaml to start from, and the schema for editors."""
    from fvi_cli.render.starter import write_starter

    print(write_starter(name, kind))
    return DONE
