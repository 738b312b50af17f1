"""``fvi modes``: frequencies and damping of linear scenes."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, RUN_FAILED, guarded, verdict
from fvi_cli.cli.options import RESULTS, Check, Configs, Output, Overrides, Quiet, Verbose
from fvi_cli.cli.runs import tell


@guarded
def modes(
    configs: Configs,
    output: Output = RESULTS,
    count: Annotated[
        int | None,
        typer.Option("--count", metavar="N", help="How many; default 10, or all of fewer."),
    ] = None,
    near: Annotated[
        float | None,
        typer.Option(
            "--near", metavar="HZ", help="Those nearest to a frequency; default: the lowest."
        ),
    ] = None,
    check: Check = False,
    overrides: Overrides = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compute modes of linear scenes with their damping, and count whether any is missing.

    Exit code 1 where it is not known that none is missing.
    """
    from fvi_cli.runner.request import gather
    from fvi_cli.runner.vibration.modes import request_modes

    differences: list[str] = []
    complete = True
    for request in gather(configs, overrides or ()):
        tables = request_modes(request, count, near)
        complete = complete and all(table.is_complete for table in tables)
        differences += tell(tables, request.name, output, is_check=check)
    if check:
        return verdict(differences)
    return DONE if complete else RUN_FAILED
