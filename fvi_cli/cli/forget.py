"""``fvi forget``: remove runs from a result file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import Overrides, Quiet, Verbose


@guarded
def forget(
    file: Annotated[Path, typer.Argument(metavar="FILE.h5", help="Results of `fvi run`.")],
    overrides: Overrides = None,
    case: Annotated[
        str | None,
        typer.Option("--case", help="Only runs of this method, such as bdf2 or gauss-s3-graded."),
    ] = None,
    others: Annotated[
        bool,
        typer.Option("--others", help="Runs that the file's configuration does not ask for."),
    ] = False,
    everything: Annotated[bool, typer.Option("--all", help="Every run; removes the file.")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="List what would be removed; no more.")
    ] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Remove runs from a result file: those of other values (--set), of a method, or all."""
    from fvi_cli.render.runs import locations_as_text
    from fvi_cli.runner.forget import forget_runs

    found = forget_runs(
        file,
        overrides=overrides or (),
        case=case,
        others=others,
        everything=everything,
        is_tried=dry_run,
    )
    print(locations_as_text(found))
    ending = "would be forgotten" if dry_run else "forgotten"
    print(f"{file}: {len(found)} run{'s' if len(found) > 1 else ''} {ending}")
    return DONE
