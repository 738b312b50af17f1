"""``fvi run``: compute and store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from fvi_cli.cli.exits import DONE, exit_code, guarded, stops
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    Configs,
    Dask,
    DryRun,
    FailFast,
    Fresh,
    Output,
    Overrides,
    Quiet,
    Verbose,
    Workers,
)

if TYPE_CHECKING:
    from fvi_cli.runner.campaign import Outcome


@guarded
def run(
    configs: Configs,
    output: Output = RESULTS,
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
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli.render import runs as reports
    from fvi_cli.runner import campaign

    settings = campaign.Settings(
        output=output,
        workers=workers,
        dask=dask,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
    )
    requests = campaign.gather(configs, overrides or (), allow_unstable=allow_unstable)
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        print(reports.runs_as_text(computed, every_member=verbose))
        print(settings.path_of(request))
        if stops(settings, computed):
            break
    return exit_code(outcomes)
