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
    Wait,
    Workers,
)

if TYPE_CHECKING:
    from fvi_cli.runner.outcome import Outcome

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
    wait: Wait = False,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Make tables of orders; without argument those of the paper and of full order."""
    from fvi_cli.render.plans import plans_as_text
    from fvi_cli.render.results import compare, order_tables, show, write
    from fvi_cli.reports import missing
    from fvi_cli.runner.plan import plan_runs
    from fvi_cli.runner.request import gather
    from fvi_cli.runner.run import run_requests
    from fvi_cli.runner.settings import Settings

    settings = Settings(
        output=output,
        workers=workers,
        dask=dask,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
        waits=wait,
    )
    requests = gather(sources or DEFAULT_TABLES, overrides or (), allow_unstable=allow_unstable)
    if dry_run:
        print(plans_as_text(plan_runs(requests, settings), in_full=verbose))
        return DONE
    absent = [line for one in requests for line in missing(output / "tables", one.name)]
    if check and absent:
        return verdict(absent)
    outcomes: list[Outcome] = []
    differences: list[str] = []
    for request, computed in run_requests(requests, settings):
        outcomes += computed
        if stops(settings, computed):
            break
        tables = order_tables(computed)
        if check:
            differences += compare(tables, output, name=request.name)
        else:
            written = write(tables, output, name=request.name, anew=fresh)
            show(tables, name=request.name)
            print(*written, "", sep="\n")
    return (verdict(differences) if check else DONE) or exit_code(outcomes)
