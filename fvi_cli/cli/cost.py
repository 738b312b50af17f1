"""``fvi cost``: what accuracy costs."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.completion import shipped_names
from fvi_cli.cli.exits import DONE, RUN_FAILED, guarded
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    DryRun,
    FailFast,
    Output,
    Overrides,
    Quiet,
    Verbose,
)

if TYPE_CHECKING:
    from fvi_cli.studies.cost import CostTable

_logger = logging.getLogger("fvi_cli")


@guarded
def cost(
    configs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="CONFIG",
            help="Files, or names of shipped configurations.",
            autocompletion=shipped_names,
        ),
    ] = None,
    output: Output = RESULTS,
    peers: Annotated[
        bool,
        typer.Option("--peers", help="Beside them the methods of pycaputo, if it is installed."),
    ] = False,
    overrides: Overrides = None,
    dry_run: DryRun = False,
    fail_fast: FailFast = False,
    allow_unstable: AllowUnstable = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure error, time, memory and work of every method; without argument make the page."""
    from fvi_cli.render import cost as cost_reports
    from fvi_cli.render import runs as reports
    from fvi_cli.runner import campaign
    from fvi_cli.studies.cost_goals import GOAL_CONFIGS

    settings = campaign.Settings(
        output=output, fresh=True, fail_fast=fail_fast, show_progress=not quiet, keep=False
    )
    requests = campaign.gather(
        configs or GOAL_CONFIGS, overrides or (), allow_unstable=allow_unstable
    )
    cost_reports.refuse_what_has_no_price(requests)
    if peers:
        requests = cost_reports.with_peers(requests)
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings), in_full=verbose))
        return DONE
    failures: list[str] = []
    finished: dict[str, list[CostTable]] = {}
    for request in requests:
        tables = cost_reports.measured(request, settings)
        finished[request.name] = tables
        print(cost_reports.costs_as_text(request.name, tables), end="\n\n")
        print(*cost_reports.write_costs(output, request.name, tables), "", sep="\n")
        lines = cost_reports.unexpected(request, tables)
        for line in lines:
            _logger.warning("%s", line)
        failures += lines
        if failures and fail_fast:
            break
    else:
        if not configs:
            print(cost_reports.write_page(output, finished))
    if failures:
        _logger.error("%d runs failed and their configuration did not expect it", len(failures))
    return RUN_FAILED if failures else DONE
