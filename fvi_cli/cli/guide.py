"""``fvi guide``: the pages that come with the program."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.completion import names_of_pages
from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Verbose


@guarded
def guide(
    page: Annotated[
        str | None,
        typer.Argument(
            metavar="PAGE", help="Name of a page; none: all names.", autocompletion=names_of_pages
        ),
    ] = None,
    verbose: Verbose = False,
) -> int:
    """Show a page of the guide, or which there are."""
    from fvi_cli.config import guide_page, guide_pages
    from fvi_cli.render.runs import titles_as_text

    print(titles_as_text(guide_pages()) if page is None else guide_page(page))
    return DONE
