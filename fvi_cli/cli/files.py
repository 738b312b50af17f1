"""Commands for result files and configurations, and the guide."""

from __future__ import annotations

import logging
import re
from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import Configs, shipped_names

_logger = logging.getLogger("fvi_cli")

FILES, CONFIGURATIONS = "Result files", "Configurations"


@command(FILES, "json")
def show(
    call: Call,
    file: Annotated[Path, typer.Argument(metavar="FILE.h5|NAME", autocompletion=shipped_names)],
    config: Annotated[
        bool, typer.Option("--config", help="Print the configuration, also a shipped one.")
    ] = False,
) -> int:
    """List what a result file holds, or print the configuration that made it.

    For example: fvi show three-designs --config > mine.yaml
    """
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


@command(FILES, "output")
def export(
    call: Call,
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="Results of `fvi run`.")],
) -> int:
    """Write every run of a result file as CSV."""
    from fvi_cli.storage.export import export_file

    print(*export_file(file, call.output / file.stem), sep="\n")
    return DONE


@command(CONFIGURATIONS)
def new(
    call: Call,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the experiment.")],
    kind: Annotated[str, typer.Option(help="Kind of the problem.")] = "damped-oscillator",
    schema: Annotated[bool, typer.Option("--schema", help="And a JSON schema.")] = False,
) -> int:
    """Write a commented configuration NAME.yaml to start from."""
    from fvi_cli.render.starter import write_starter

    print(*write_starter(name, kind, schema=schema), sep="\n")
    return DONE


@command(CONFIGURATIONS, "overrides", "json")
def check(call: Call, configs: Configs) -> int:
    """Validate configurations and compute nothing; with -v say which names formulas know."""
    from fvi_cli.config.names import names_along
    from fvi_cli.scenes.problem import Problem

    rows = []
    for config in call.gather(configs):
        for one in config.experiments:
            row = {"valid": str(config.path), "experiment": one.name, "runs": len(one.runs())}
            if call.verbose and isinstance(one.problem, Problem):
                row["names"] = ", ".join(names_along(one.problem, one.problem.ready))
            rows.append(row)
    call.print_rows(experiments=rows)
    return DONE


@command(CONFIGURATIONS, "json")
def list_(call: Call) -> int:
    """List the configurations that come with the program, and what each shows."""
    from fvi_cli.config import shipped_titles

    titles = shipped_titles()
    call.print_rows(configurations=[{"name": n, "title": t} for n, t in titles.items()])
    return DONE


@command("Help")
def guide(
    call: Call,
    page: Annotated[
        str | None, typer.Argument(metavar="PAGE", help="A page; without it, list all.")
    ] = None,
) -> int:
    """Show a page of the guide, or list the pages."""
    from fvi_cli.config import guide_page, guide_pages

    if page is not None:
        print(guide_page(page))
        return DONE
    call.print_rows(
        pages=[
            {"group": group, "page": name, "title": title}
            for group, pages in guide_pages().items()
            for name, title in pages.items()
        ]
    )
    return DONE
