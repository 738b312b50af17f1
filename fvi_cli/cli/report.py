"""Commands that report on runs: ``convergence``, ``plot``, ``quantities``."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from typing import TYPE_CHECKING

from fvi_cli.cli.command import COMPUTED, Call, command
from fvi_cli.cli.options import Sources, UsualSources

if TYPE_CHECKING:
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.request import Request

_logger = logging.getLogger("fvi_cli")

REPORT = "Report"
TABLES = ("table-1", "table-2", "full-order")
FIGURES = (
    "saturation",
    "damped-oscillator-comparison",
    "damped-oscillator",
    "bagley-torvik-1-2",
    "bagley-torvik-3-2",
    "bagley-torvik-3-2-long",
    "corrected-bdf3",
)
"""Configurations of the paper."""


@command(
    REPORT,
    *COMPUTED,
    "check",
    examples=("fvi convergence damped-oscillator", "fvi convergence results/mine.h5"),
)
def convergence(call: Call, sources: UsualSources = None) -> int:
    """Make tables of orders; without arguments, those of the paper and of full order."""
    from fvi_cli.render.results import order_tables

    call.gather(sources or TABLES, stores_runs=True)
    return call.each(lambda request: order_tables(call.runs(request)))


@command(
    REPORT,
    *COMPUTED,
    "formats",
    "style",
    examples=("fvi plot damped-oscillator", "fvi plot results/mine.h5 --style thesis.mplstyle"),
)
def plot(call: Call, sources: UsualSources = None) -> int:
    """Draw figures, from stored runs where there are any; without arguments, the paper's."""
    from fvi_cli import plotting
    from fvi_cli.render.figures import write_figures
    from fvi_cli.render.results import studies

    def show(request: Request, outcomes: list[Outcome]) -> None:
        found = studies(outcomes)
        drawn = plotting.figures_for(found, name=request.name)
        if not sources and request is call.requests[0]:
            drawn = {"interpolation": plotting.interpolation_figure(), **drawn}
        for line in plotting.left_out(found):
            _logger.warning("%s", line)
        call.wrote(write_figures(drawn, call.output, formats=call.formats or ()))

    call.gather(sources or FIGURES, stores_runs=True)
    with nullcontext() if call.style is None else plotting.styled(call.style):
        return call.each(call.runs, show)


@command(REPORT, *COMPUTED, "check", examples=("fvi quantities three-designs",))
def quantities(call: Call, sources: Sources) -> int:
    """Make tables of quantities (peak, its time, RMS) and events of every run."""
    from fvi_cli.render.results import quantities as observed

    call.gather(sources, stores_runs=True)
    return call.each(lambda request: observed(call.runs(request), name=request.name))
