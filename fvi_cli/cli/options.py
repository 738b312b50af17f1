"""Arguments and options that several commands share, and how a shell completes them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def shipped_names(incomplete: str) -> list[str]:
    """Names of shipped configurations; if none fits, the shell completes names of files."""
    from fvi_cli.config import shipped_configs

    return [name for name in shipped_configs() if name.startswith(incomplete)]


_sources = typer.Argument(
    metavar="CONFIG|FILE.h5",
    help="Files, names of shipped configurations, or results of `fvi run`.",
    autocompletion=shipped_names,
)
_configs = typer.Argument(
    metavar="CONFIG",
    help="Files, or names of shipped configurations.",
    autocompletion=shipped_names,
)
Configs = Annotated[list[str], _configs]
Sources = Annotated[list[str], _sources]
UsualSources = Annotated[list[str] | None, _sources]
"""The same for commands that have defaults."""

Output = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for all that is written.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY.PATH=VALUE",
        help="Change an entry of the configuration, null leaves it out; repeatable.",
    ),
]
Workers = Annotated[
    int, typer.Option("-j", "--workers", min=1, metavar="N", help="Processes on this machine.")
]
Dask = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Compute on a Dask scheduler, such as tcp://host:8786."),
]
Shard = Annotated[
    str,
    typer.Option(metavar="I/N", help="Compute only the I-th of N parts, into one folder of parts."),
]
Fresh = Annotated[bool, typer.Option("--fresh", help="Compute again what is stored already.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="List what would be done, and stop.")]
Check = Annotated[bool, typer.Option("--check", help="Compare with stored tables; write nothing.")]
Formats = Annotated[
    list[str] | None,
    typer.Option("--format", metavar="png|pdf|svg", help="Format of figures; repeatable."),
]
Style = Annotated[
    str | None, typer.Option(metavar="STYLE", help="A Matplotlib style: its name, or a file.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document instead of text.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Only results and errors.")]
Verbose = Annotated[
    bool, typer.Option("-v", "--verbose", help="Say more: every run, and tracebacks.")
]
