"""``fvi plot``: figures."""

from __future__ import annotations

import functools
import logging
from collections.abc import Sequence
from contextlib import ExitStack
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
    Wait,
    Workers,
)
from fvi_cli.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fvi_cli.runner.outcome import Outcome

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
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", help="pdf, png or svg; several times for several."),
    ] = None,
    style: Annotated[
        Path | None,
        typer.Option("--style", metavar="FILE", help="Matplotlib style file: fonts, sizes, lines."),
    ] = None,
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
    """Draw figures, from stored runs where there are any; without argument those of the paper."""
    from fvi_cli import plotting
    from fvi_cli.render.plans import plans_as_text
    from fvi_cli.render.results import figures, studies
    from fvi_cli.runner.plan import plan_runs
    from fvi_cli.runner.request import gather
    from fvi_cli.runner.run import run_requests
    from fvi_cli.runner.settings import Settings

    for kind in formats or ():
        if kind not in plotting.FORMATS:
            raise RequestError(f"--format: {kind!r} is not one of {', '.join(plotting.FORMATS)}")
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
    requests = gather(sources or DEFAULT_FIGURES, overrides or (), allow_unstable=allow_unstable)
    if dry_run:
        print(plans_as_text(plan_runs(requests, settings), in_full=verbose))
        return DONE
    outcomes: list[Outcome] = []
    differences: list[str] = []
    draw = functools.partial(_draw, output=output, check=check, formats=formats or (), anew=fresh)
    with ExitStack() as styled:
        if style is not None:
            try:
                styled.enter_context(plotting.style_file(style))
            except ValueError as error:
                raise RequestError(f"--style: {error}") from None
        if not sources:
            differences += draw(plotting.sketches())
        for request, computed in run_requests(requests, settings):
            outcomes += computed
            if stops(settings, computed):
                break
            for line in plotting.left_out(studies(computed)):
                _logger.warning("%s", line)
            differences += draw(figures(computed, name=request.name))
    return (verdict(differences) if check else DONE) or exit_code(outcomes)


def _draw(
    figures: dict[str, Figure], *, output: Path, check: bool, formats: Sequence[str], anew: bool
) -> list[str]:
    """Write figures and print their paths, or tell in what the stored ones differ."""
    from fvi_cli.render.figures import compare_figures, write_figures

    if check:
        return compare_figures(figures, output, formats=formats or ("png",))
    for path in write_figures(figures, output, formats=formats, anew=anew):
        print(path)
    return []
