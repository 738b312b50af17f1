"""Commands that report on runs: ``convergence``, ``plot``, ``quantities``."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fvi_cli.cli.command import COMPUTED, Call, command
from fvi_cli.cli.options import Sources, UsualSources

if TYPE_CHECKING:
    from fvi_cli.runner.request import Request
    from fvi_cli.studies.experiment import Experiment, FinishedRun

    Studies = Sequence[tuple[Experiment, Sequence[FinishedRun]]]

_logger = logging.getLogger("fvi_cli")

DEFAULT_TABLES = ("table-1", "table-2", "full-order")
DEFAULT_FIGURES = (
    "saturation",
    "damped-oscillator-comparison",
    "damped-oscillator",
    "bagley-torvik-1-2",
    "bagley-torvik-3-2",
    "bagley-torvik-3-2-long",
    "corrected-bdf3",
)


@command(
    *COMPUTED,
    "check",
    examples="""
    fvi convergence
    fvi convergence damped-oscillator -j 2
    fvi convergence results/damped-oscillator.h5
    """,
)
def convergence(call: Call, sources: UsualSources = None) -> int:
    """Make tables of orders; without arguments, those of the paper and of full order."""
    from fvi_cli.render.results import order_tables
    from fvi_cli.runner.compute import run

    call.gather(sources or DEFAULT_TABLES)
    return call.each(run, report=lambda outcomes, request: order_tables(outcomes))


@command(
    *COMPUTED,
    "formats",
    "style",
    examples="""
    fvi plot damped-oscillator
    fvi plot results/damped-oscillator.h5 --format svg --style thesis.mplstyle
    """,
)
def plot(call: Call, sources: UsualSources = None) -> int:
    """Draw figures, from stored runs where there are any; without arguments, the paper's."""
    from fvi_cli import plotting
    from fvi_cli.render.results import studies
    from fvi_cli.runner.compute import run

    def show(found: Studies, request: Request) -> None:
        if not sources and request is call.requests[0]:
            call.show_figures({"interpolation": plotting.interpolation_figure()})
        for line in plotting.left_out(found):
            _logger.warning("%s", line)
        call.show_figures(plotting.figures_for(found, name=request.name))

    call.gather(sources or DEFAULT_FIGURES)
    return call.each(run, show, report=lambda outcomes, request: studies(outcomes))


@command(*COMPUTED, "check", examples="fvi quantities three-designs")
def quantities(call: Call, sources: Sources) -> int:
    """Make tables of quantities (peak, its time, RMS) and events of every run."""
    from fvi_cli.render.results import quantities as observed
    from fvi_cli.runner.compute import run

    call.gather(sources)
    return call.each(run, report=lambda outcomes, request: observed(outcomes, name=request.name))
