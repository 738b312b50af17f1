"""Commands for result files: ``show``, ``export``."""

from __future__ import annotations

import logging
import re
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import ResultFile, Shown

_logger = logging.getLogger("fvi_cli")


@command(
    "json",
    examples="""
    fvi show results/damped-oscillator.h5
    fvi show three-designs --config > mine.yaml
    """,
)
def show(
    call: Call,
    file: Shown,
    config: Annotated[
        bool,
        typer.Option(
            "--config", help="Print the configuration that made the file, or a shipped one."
        ),
    ] = False,
) -> int:
    """List what a result file holds, or print the configuration that made it."""
    from fvi_cli.config import find_config
    from fvi_cli.render.json import contents_as_json
    from fvi_cli.render.runs import contents_as_text
    from fvi_cli.runner.request import STORED_SUFFIX
    from fvi_cli.storage import list_runs, read_configuration

    if config and file.suffix != STORED_SUFFIX:
        path = find_config(str(file))
        text = path.read_text(encoding="utf-8")
        print(text, end="")
        # a configuration reads records and matrices from its own folder
        names = dict.fromkeys(re.findall(r"\bfile: ([^,}\s]+)", text))
        if files := [str(path.with_name(one)) for one in names if path.with_name(one).is_file()]:
            _logger.info("copy the files that it reads to its folder: %s", " ".join(files))
        return DONE
    if config:
        made_by = read_configuration(file)
        print(made_by.text, end="")
        for override in made_by.overrides:
            _logger.warning("made with --set %s", override)
    elif call.json:
        print(contents_as_json(list_runs(file)))
    else:
        print(contents_as_text(list_runs(file)))
    return DONE


@command("output", examples="fvi export results/mine.h5")
def export(call: Call, file: ResultFile) -> int:
    """Write every run of a result file as CSV."""
    from fvi_cli.storage.export import export_file

    print(*export_file(file, call.output / file.stem), sep="\n")
    return DONE
