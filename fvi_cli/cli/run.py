"""``fvi run``: compute and store."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import DONE, exit_code, guarded
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    CheckpointEvery,
    Configs,
    Dask,
    DryRun,
    FailFast,
    Fresh,
    Json,
    Output,
    Overrides,
    Quiet,
    Verbose,
    Wait,
    Workers,
)

if TYPE_CHECKING:
    from pathlib import Path

    from fvi_cli.runner.outcome import Outcome


@guarded
def run(
    configs: Configs,
    output: Output = RESULTS,
    overrides: Overrides = None,
    workers: Workers = 1,
    checkpoint_every: CheckpointEvery = 60.0,
    dask: Dask = None,
    shard: Annotated[
        str,
        typer.Option(
            metavar="I/N",
            help="Compute the I-th of N parts alone, into a file of its own; see `fvi merge`.",
        ),
    ] = "1/1",
    wait: Wait = False,
    dry_run: DryRun = False,
    fresh: Fresh = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli.render.json import outcomes_as_json, plans_as_json
    from fvi_cli.render.plans import plans_as_text
    from fvi_cli.render.runs import runs_as_text
    from fvi_cli.runner.parts.shard import shard_named
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
        checkpoint_seconds=checkpoint_every,
        waits=wait,
        keeps_motions=False,
        shard=shard_named(shard),
    )
    requests = gather(
        configs,
        overrides or (),
        allow_unstable=allow_unstable,
        checks_member=settings.shard.checks_member,
    )
    if dry_run and json:
        print(plans_as_json(plan_runs(requests, settings)))
        return DONE
    if dry_run:
        print(plans_as_text(plan_runs(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    paths: list[Path] = []
    for request, computed in run_requests(requests, settings):
        outcomes += computed
        paths.append(settings.path_of(request))
        if not json:
            print(runs_as_text(computed, every_member=verbose), paths[-1], sep="\n")
    if json:
        print(outcomes_as_json(outcomes, paths))
    return exit_code(outcomes)
