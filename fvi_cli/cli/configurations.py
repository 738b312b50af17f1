"""Commands for configurations, ``new``, ``check``, ``list``, and the ``guide``."""

from __future__ import annotations

import textwrap
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import Configs
from fvi_cli.errors import RequestError

CONFIGURATIONS = "Configurations"


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
        requests = call.gather(configs)
    except RequestError as error:
        if call.json:
            print(document(valid=False, configurations=[], complaints=error.complaints))
        raise
    found = [
        {
            "file": str(one.loaded.path),
            "name": one.name,
            "experiments": [
                {"name": e.name, "runs": len(e.runs())} for e in one.loaded.experiments
            ],
        }
        for one in requests
    ]
    if call.json:
        print(document(valid=True, configurations=found, complaints=[]))
        return DONE
    for request in requests:
        experiments = request.loaded.experiments
        runs = sum(len(one.runs()) for one in experiments)
        print(f"{request.loaded.path}: valid, experiments: {len(experiments)}, runs: {runs}")
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
