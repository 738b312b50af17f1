"""``fvi show``: what a result file holds."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Json, Verbose

_logger = logging.getLogger("fvi_cli")


@guarded
def show(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="Results of `fvi run`.")],
    config: Annotated[
        bool, typer.Option("--config", help="Print the configuration that made the file.")
    ] = False,
    json: Json = False,
    verbose: Verbose = False,
) -> int:
    """List what a result file holds, or print the configuration that made it."""
    from fvi_cli.render.json import contents_as_json
    from fvi_cli.render.plans import machinery_as_text
    from fvi_cli.render.runs import contents_as_text
    from fvi_cli.runner.request import gather
    from fvi_cli.storage import list_runs, printable, read_configuration

    if json and not config:
        print(contents_as_json(list_runs(file)))
        return DONE
    if not config:
        print(contents_as_text(list_runs(file)))
        if verbose:
            (request,) = gather([str(file)], ())
            runs = [run for one in request.loaded.experiments for run in one.runs()]
            print(f"\n{machinery_as_text(runs)}")
        return DONE
    configuration = read_configuration(file)
    print(printable(configuration.text), end="")
    for override in configuration.overrides:
        _logger.warning("made with --set %s", printable(override))
    return DONE
