"""``fvi schema``: the JSON schema of configurations."""

from __future__ import annotations

from fvi_cli.commands.exits import DONE, guarded
from fvi_cli.commands.options import Verbose


@guarded
def schema(verbose: Verbose = False) -> int:
    """Print the JSON schema of configurations, for editors."""
    import json

    from fvi_cli.config import json_schema

    print(json.dumps(json_schema(), indent=2))
    return DONE
