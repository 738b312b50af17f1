"""Commands for configurations, ``new``, ``check``, ``list``, and the ``guide``."""

from __future__ import annotations

import textwrap
from typing import Annotated

import typer

from fvi_cli.cli.command import Call, command
from fvi_cli.cli.completion import kinds_of_problems, names_of_pages
from fvi_cli.cli.exits import DONE
from fvi_cli.cli.options import Configs
from fvi_cli.errors import RequestError


@command()
def new(
    call: Call,
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
    schema: Annotated[
        bool, typer.Option("--schema", help="Write the JSON schema for editors beside it.")
    ] = False,
) -> int:
    """Write a commented configuration NAME.yaml to start from."""
    from fvi_cli.render.starter import write_starter

    print(*write_starter(name, kind, schema=schema), sep="\n")
    return DONE


@command("overrides", "json")
def check(call: Call, configs: Configs) -> int:
    """Validate configurations and compute nothing."""
    try:
        requests = call.gather(configs)
    except RequestError as error:
        if call.json:
            from fvi_cli.render.json import checked_as_json

            print(checked_as_json((), error.complaints))
        raise
    if call.json:
        from fvi_cli.render.json import checked_as_json

        print(checked_as_json(requests))
        return DONE
    for request in requests:
        experiments = request.loaded.experiments
        runs = sum(len(one.runs()) for one in experiments)
        what = f"{_counted(len(experiments), 'experiment')}, {_counted(runs, 'run')}"
        print(f"{request.loaded.path}: valid, {what}")
    return DONE


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


@command("json")
def list_(call: Call) -> int:
    """List the configurations that come with the program, and what each shows."""
    from fvi_cli.config import shipped_titles
    from fvi_cli.render.json import shipped_as_json
    from fvi_cli.render.runs import titles_as_text

    titles = shipped_titles()
    print(shipped_as_json(titles) if call.json else titles_as_text(titles))
    return DONE


@command()
def guide(
    call: Call,
    page: Annotated[
        str | None,
        typer.Argument(
            metavar="PAGE",
            help="Name of a page; without it, list all names.",
            autocompletion=names_of_pages,
        ),
    ] = None,
) -> int:
    """Show a page of the guide, or list the pages."""
    from fvi_cli.config import guide_page, guide_pages
    from fvi_cli.render.runs import titles_as_text

    if page is not None:
        print(guide_page(page))
        return DONE
    for group, pages in guide_pages().items():
        print(f"{group}:\n{textwrap.indent(titles_as_text(pages), '  ')}\n")
    return DONE
