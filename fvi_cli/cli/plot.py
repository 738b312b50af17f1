"""``fvi plot``: figures."""

from __future__ import annotations

import logging
from pathlib import Path
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
    from matplotlib.figure import Figure

    from fvi_cli.runner.campaign import Outcome

_logger = logging.getLogger("fvi_cli")

DEFAULT_FIGURES = (
    "saturation",
    "damped-oscillator-comparison",
    "damped-oscillator",
    "bagley-torvik-1-2",
    "bagley-torvik-3-2",
    "bagley-torvik-3-2-long",
    "corrected-bdf3",
)


@guarded
def plot(
    sources: Sources = None,
    output: Output = RESULTS,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with what the stored figures show; write nothing."),
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
    """Draw figures, from stored runs where there are any; without argument those of the paper."""
    from fvi_cli import plotting
    from fvi_cli.render import runs as reports
    from fvi_cli.runner import campaign

    settings = campaign.Settings(
        output=output,
        workers=workers,
        dask=dask,
        fresh=fresh,
        fail_fast=fail_fast,
        show_progress=not quiet,
        keep=not check,
        may_replace=False,
    )
    requests = campaign.gather(
        sources or DEFAULT_FIGURES, overrides or (), allow_unstable=allow_unstable
    )
    if dry_run:
        print(reports.plans_as_text(campaign.plan(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    if not sources:
        differences += _draw(plotting.sketches(), output, check=check)
    for request in requests:
        computed = campaign.answer(request, settings)
        outcomes += computed
        if stops(settings, computed):
            break
        studies = reports.studies(computed)
        for line in plotting.left_out(studies):
            _logger.warning("%s", line)
        drawn = plotting.figures_for(studies, name=request.name)
        differences += _draw(drawn, output, check=check)
    return (verdict(differences) if check else DONE) or exit_code(outcomes)


def _draw(figures: dict[str, Figure], output: Path, *, check: bool) -> list[str]:
    """Write figures and print their paths, or tell in what the stored ones differ."""
    from fvi_cli.render import runs as reports

    if check:
        return reports.compare_figures(figures, output)
    for path in reports.write_figures(figures, output):
        print(path)
    return []
