"""``fvi convergence``: tables of orders."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import DONE, exit_code, guarded, stops, verdict
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    Dask,
    DryRun,
    FailFast,
    Fresh,
    Output,
    Overrides,
    Quiet,
    Sources,
    Verbose,
    Workers,
)

if TYPE_CHECKING:
    from fvi_cli.runner.campaign import Outcome

DEFAULT_TABLES = ("table-1", "table-2", "full-order")


@guarded
def convergence(
    sources: Sources = None,
    output: Output = RESULTS,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with the stored tables and write nothing."),
    ] = False,
    overrides: Overrides = None,
    workers: Workers = 1,
    dask: Dask = None,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Make tables of orders; without argument those of the paper and of full order."""
    from fvi_cli import reports as tables
    from fvi_cli.render import runs as reports
    from fvi_cli.runner import campaign

    directory = output / "tables"
    settings = campaign.Settings(
        output=output,
        workers=workers,
        dask=dask,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
    )
    requests = campaign.gather(
        sources or DEFAULT_TABLES, overrides or (), allow_unstable=allow_unstable
    )
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        if stops(settings, computed):
            break
        made = reports.order_tables(computed)
        if check:
            differences += tables.compare_with_tables(directory, request.name, made)
        else:
            written = tables.write_tables(directory, request.name, made)
            print(tables.summary_text(request.name, made), *written, "", sep="\n")
    return (verdict(differences) if check else DONE) or exit_code(outcomes)
