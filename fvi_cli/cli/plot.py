"""``fvi plot``: figures."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.exits import guarded
from fvi_cli.cli.options import Check, UsualSources
from fvi_cli.cli.runs import Runs, with_runs
from fvi_cli.errors import RequestError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
@with_runs
def plot(
    runs: Runs,
    sources: UsualSources = None,
    check: Check = False,
    formats: Annotated[
        list[str] | None,
        typer.Option("--format", help="pdf, png or svg; several times for several."),
    ] = None,
    style: Annotated[
        Path | None,
        typer.Option("--style", metavar="FILE", help="Matplotlib style file: fonts, sizes, lines."),
    ] = None,
) -> int:
    """Draw figures, from stored runs where there are any; without argument those of the paper."""
    from fvi_cli import plotting
    from fvi_cli.render.figures import compare_figures, write_figures
    from fvi_cli.render.results import figures, studies

    for kind in formats or ():
        if kind not in plotting.FORMATS:
            raise RequestError(f"--format: {kind!r} is not one of {', '.join(plotting.FORMATS)}")
    runs.gather(sources or DEFAULT_FIGURES)
    if runs.is_dry:
        return runs.show_plans()
    output, anew = runs.settings.output, runs.settings.fresh

    def tell(drawn: dict[str, Figure]) -> None:
        if check:
            runs.differences += compare_figures(drawn, output, formats=formats or ("png",))
        else:
            print(*write_figures(drawn, output, formats=formats or (), anew=anew), sep="\n")

    with ExitStack() as styled:
        if style is not None:
            try:
                styled.enter_context(plotting.style_file(style))
            except ValueError as error:
                raise RequestError(f"--style: {error}") from None
        if not sources:
            tell({"interpolation": plotting.interpolation_figure()})
        for name, outcomes in runs.succeeded():
            for line in plotting.left_out(studies(outcomes)):
                _logger.warning("%s", line)
            tell(figures(outcomes, name=name))
    return runs.code
