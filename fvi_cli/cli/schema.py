"""``fvi schema``: the keys of configurations, for editors and for people."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Verbose


@guarded
def schema(
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the reference of all keys as Markdown.")
    ] = False,
    verbose: Verbose = False,
) -> int:
    """Print the JSON schema of configurations, for editors, or the reference of all keys."""
    from fvi_cli.config import configuration_reference, schema_text

    print(configuration_reference() if markdown else schema_text(), end="")
    return DONE
