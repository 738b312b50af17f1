"""``fvi quantities``: tables of what is asked of a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import DONE, exit_code, guarded, stops, verdict
from fvi_cli.cli.options import (
    RESULTS,
    Configs,
    Dask,
    DryRun,
    FailFast,
    Fresh,
    Output,
    Overrides,
    Quiet,
    Verbose,
    Wait,
    Workers,
)

if TYPE_CHECKING:
    from fvi_cli.runner.outcome import Outcome


@guarded
def quantities(
    configs: Configs,
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
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Make tables of quantities (peak, its time, RMS) and events of every run."""
    from fvi_cli.render.plans import plans_as_text
    from fvi_cli.render.quantities import compare_quantities, show_quantities, write_quantities
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
    requests = gather(configs, overrides or ())
    if dry_run:
        print(plans_as_text(plan_runs(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    for request, computed in run_requests(requests, settings):
        outcomes += computed
        if stops(settings, computed):
            break
        if check:
            differences += compare_quantities(request.name, computed, output)
            continue
        written = write_quantities(request.name, computed, output, anew=fresh)
        show_quantities(request.name, computed)
        print(*written, "", sep="\n")
    return (verdict(differences) if check else DONE) or exit_code(outcomes)
