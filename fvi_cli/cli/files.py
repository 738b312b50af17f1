"""Commands for result files: ``show``, ``export``."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import ResultFile, shipped_names

_logger = logging.getLogger("fvi_cli")

FILES = "Result files"


@command(
    FILES,
    "json",
    examples=("fvi show results/mine.h5", "fvi show three-designs --config > mine.yaml"),
)
def show(
    call: Call,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.h5|NAME",
            help="Results of `fvi run`; with --config also a shipped configuration.",
            autocompletion=shipped_names,
        ),
    ],
    config: Annotated[
        bool, typer.Option("--config", help="Print the configuration that made the file.")
    ] = False,
) -> int:
    """List what a result file holds, or print the configuration that made it."""
    from fvi_cli.config import find_config
    from fvi_cli.render.json import contents_as_json
    from fvi_cli.render.runs import contents_as_text
    from fvi_cli.runner.request import STORED_SUFFIX
    from fvi_cli.storage import list_runs, read_configuration

    if not config:
        print((contents_as_json if call.json else contents_as_text)(list_runs(file)))
    elif file.suffix == STORED_SUFFIX:
        made_by = read_configuration(file)
        print(made_by.text, end="")
        for override in made_by.overrides:
            _logger.warning("made with --set %s", override)
    else:
        path = find_config(str(file))
        text = path.read_text(encoding="utf-8")
        print(text, end="")
        # a configuration reads records and matrices from its own folder
        places = [path.with_name(one) for one in re.findall(r"\bfile: ([^,}\s]+)", text)]
        if files := [str(one) for one in dict.fromkeys(places) if one.is_file()]:
            _logger.info("copy the files that it reads to its folder: %s", " ".join(files))
    return DONE


@command(FILES, "output", examples=("fvi export results/mine.h5",))
def export(call: Call, file: ResultFile) -> int:
    """Write every run of a result file as CSV."""
    from fvi_cli.storage.export import export_file

    print(*export_file(file, call.output / file.stem), sep="\n")
    return DONE
