"""Commands for result files and configurations, and the guide."""

from __future__ import annotations

import logging
import re
import textwrap
from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import Configs, ResultFile, shipped_names
from fvi_cli.errors import RequestError

_logger = logging.getLogger("fvi_cli")

FILES, CONFIGURATIONS = "Result files", "Configurations"


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
            _logger.warning("copy the files that it reads to its folder: %s", " ".join(files))
    return DONE


@command(FILES, "output", examples=("fvi export results/mine.h5",))
def export(call: Call, file: ResultFile) -> int:
    """Write every run of a result file as CSV."""
    from fvi_cli.storage.export import export_file

    print(*export_file(file, call.output / file.stem), sep="\n")
    return DONE


def _kinds(incomplete: str) -> list[str]:
    from fvi_cli.scenes.registry import KINDS

    return [kind for kind in KINDS if kind.startswith(incomplete)]


@command(CONFIGURATIONS)
def new(
    call: Call,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the experiment.")],
    kind: Annotated[
        str,
        typer.Option("--kind", metavar="KIND", help="Kind of the problem.", autocompletion=_kinds),
    ] = "damped-oscillator",
    schema: Annotated[
        bool, typer.Option("--schema", help="Write the JSON schema for editors beside it.")
    ] = False,
) -> int:
    """Write a commented configuration NAME.yaml to start from."""
    from fvi_cli.render.starter import write_starter

    print(*write_starter(name, kind, schema=schema), sep="\n")
    return DONE


@command(CONFIGURATIONS, "overrides", "json")
def check(call: Call, configs: Configs) -> int:
    """Validate configurations and compute nothing."""
    from fvi_cli.config.names import names_along
    from fvi_cli.render.json import document
    from fvi_cli.scenes.problem import Problem

    try:
        loaded = call.gather(configs)
    except RequestError as error:
        if call.json:
            print(document(valid=False, configurations=[], complaints=error.complaints))
        raise
    found = [
        {
            "file": str(one.path),
            "name": one.name,
            "experiments": [{"name": e.name, "runs": len(e.runs())} for e in one.experiments],
        }
        for one in loaded
    ]
    if call.json:
        print(document(valid=True, configurations=found, complaints=[]))
        return DONE
    for config in loaded:
        experiments = config.experiments
        runs = sum(len(one.runs()) for one in experiments)
        print(f"{config.path}: valid, experiments: {len(experiments)}, runs: {runs}")
        for one in experiments if call.verbose else ():
            if isinstance(one.problem, Problem):
                names = ", ".join(names_along(one.problem, one.problem.ready))
                print(f"  {one.name}: formulas know {names}")
    return DONE


@command(CONFIGURATIONS, "json")
def list_(call: Call) -> int:
    """List the configurations that come with the program, and what each shows."""
    from fvi_cli.config import shipped_titles

    titles = shipped_titles()
    if call.json:
        from fvi_cli.render.json import document

        print(document(configurations=[{"name": n, "title": t} for n, t in titles.items()]))
    else:
        print(_in_columns(titles))
    return DONE


@command("Help")
def guide(
    call: Call,
    page: Annotated[
        str | None,
        typer.Argument(metavar="PAGE", help="Name of a page; without it, list all names."),
    ] = None,
) -> int:
    """Show a page of the guide, or list the pages."""
    from fvi_cli.config import guide_page, guide_pages

    if page is not None:
        print(guide_page(page))
        return DONE
    for group, pages in guide_pages().items():
        print(f"{group}:\n{textwrap.indent(_in_columns(pages), '  ')}\n")
    return DONE


def _in_columns(titles: dict[str, str]) -> str:
    width = max(map(len, titles)) + 2
    return "\n".join(f"{name:<{width}}{title}" for name, title in titles.items())
