"""``fvi cost``: what accuracy costs."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import DONE, RUN_FAILED, guarded
from fvi_cli.cli.options import (
    RESULTS,
    AllowUnstable,
    DryRun,
    FailFast,
    Output,
    Overrides,
    Quiet,
    UsualConfigs,
    Verbose,
)
from fvi_cli.cli.runs import tell

if TYPE_CHECKING:
    from fvi_cli.studies.cost import CostTable

_logger = logging.getLogger("fvi_cli")


@guarded
def cost(
    configs: UsualConfigs = None,
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
    from fvi_cli.render.cost import PAGE_CONFIGS, write_page
    from fvi_cli.render.plans import plans_as_text
    from fvi_cli.runner import cost as runner
    from fvi_cli.runner.plan import plan_runs
    from fvi_cli.runner.request import gather
    from fvi_cli.runner.settings import Settings

    settings = Settings(
        output=output, fresh=True, fail_fast=fail_fast, show_progress=not quiet, keep=False
    )
    requests = gather(configs or PAGE_CONFIGS, overrides or (), allow_unstable=allow_unstable)
    runner.refuse_what_has_no_price(requests)
    if peers:
        requests = runner.with_peers(requests)
    if dry_run:
        print(plans_as_text(plan_runs(requests, settings), in_full=verbose))
        return DONE
    failures: list[str] = []
    finished: dict[str, list[CostTable]] = {}
    for request in requests:
        tables = runner.measure_request(request, settings)
        finished[request.name] = tables
        tell(tables, request.name, output, is_check=False)
        lines = runner.unexpected(request, tables)
        for line in lines:
            _logger.warning("%s", line)
        failures += lines
        if failures and fail_fast:
            break
    else:
        if not configs:
            print(write_page(output, finished))
    if failures:
        _logger.error("%d runs failed and their configuration did not expect it", len(failures))
    return RUN_FAILED if failures else DONE
