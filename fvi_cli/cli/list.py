"""``fvi list``: the configurations that come with the program."""

from __future__ import annotations

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Json, Verbose


@guarded
def list(json: Json = False, verbose: Verbose = False) -> int:  # noqa: A001 - the command's name
    """List the configurations that come with the program, and what each shows."""
    from fvi_cli.config import shipped_titles
    from fvi_cli.render.json import shipped_as_json
    from fvi_cli.render.runs import titles_as_text

    titles = shipped_titles()
    print(shipped_as_json(titles) if json else titles_as_text(titles))
    return DONE
