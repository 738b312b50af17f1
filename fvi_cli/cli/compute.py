"""Commands that compute: runs with their tables and figures, and other studies."""

from __future__ import annotations

import logging
from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.command import RUNS, STUDY, Call, command
from fvi_cli.cli.options import Configs, Sources, UsualSources

if TYPE_CHECKING:
    from fvi_cli.config import LoadedConfig
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.studies.fits.result import FitResult

_logger = logging.getLogger("fvi_cli")

COMPUTE, REPORT, LINEAR = "Compute", "Report", "Linear structures"
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


@command(COMPUTE, *RUNS)
def run(
    call: Call,
    sources: Sources,
    prune: Annotated[
        bool, typer.Option("--prune", help="Drop stored runs that are no longer asked for.")
    ] = False,
) -> int:
    """Compute every method of a configuration on every step size; store what comes out.

    For example: fvi run mine.yaml -j 4 --set problem.stiffness=2
    """
    from fvi_cli.render.json import finished_run
    from fvi_cli.render.runs import runs_as_text
    from fvi_cli.runner.request import file_of

    def show(config: LoadedConfig, outcomes: list[Outcome]) -> None:
        if call.json:
            found = [finished_run(one) for outcome in outcomes for one in outcome.finished]
            call.collect("runs", found)
        else:
            print(runs_as_text(outcomes, verbose=call.verbose))
        path = file_of(config, call.output)
        call.wrote([] if path is None else [path])

    return call.runs(sources, show, prune=prune, keeps_motions=False)


@command(REPORT, *RUNS, "check")
def convergence(call: Call, sources: UsualSources = None) -> int:
    """Make tables of orders; without arguments, those of the paper and of full order."""
    from fvi_cli.render.results import order_tables

    return call.runs(sources or TABLES, lambda one, found: call.show(one, order_tables(found)))


@command(REPORT, *RUNS, "formats", "style")
def plot(call: Call, sources: UsualSources = None) -> int:
    """Draw figures, from stored runs where there are any; without arguments, the paper's.

    For example: fvi plot results/mine.h5 --style thesis.mplstyle
    """
    from fvi_cli import plotting
    from fvi_cli.render.results import studies, write_figures

    def show(config: LoadedConfig, outcomes: list[Outcome]) -> None:
        found = studies(outcomes)
        drawn, reasons = plotting.draw_figures(found, name=config.name)
        if not sources and config.name == FIGURES[0]:
            drawn = {"interpolation": plotting.interpolation_figure(), **drawn}
        for line in reasons:
            _logger.warning("%s", line)
        call.wrote(write_figures(drawn, call.output, formats=call.formats or ()))

    with nullcontext() if call.style is None else plotting.styled(call.style):
        return call.runs(sources or FIGURES, show)


@command(REPORT, *RUNS, "check")
def quantities(call: Call, sources: Sources) -> int:
    """Make tables of quantities (peak, its time, RMS) and events of every run."""
    from fvi_cli.render.results import quantities as observed

    return call.runs(sources, lambda one, found: call.show(one, observed(found, name=one.name)))


@command(COMPUTE, *STUDY)
def cost(
    call: Call,
    configs: Configs,
    repeats: Annotated[int, typer.Option(min=1, help="How often every run is timed.")] = 5,
) -> int:
    """Measure error, time and work of every method and baseline, one run after the other."""
    from fvi_cli.runner import studies

    return call.each(configs, studies.cost_tasks, studies.cost, repeats=repeats)


@command(COMPUTE, *STUDY)
def stability(call: Call, configs: Configs) -> int:
    """Predict the stability of every method over steps and parameters."""
    from fvi_cli.runner import studies

    return call.each(configs, studies.stability_tasks, studies.stability)


@command(COMPUTE, *STUDY)
def fit(call: Call, configs: Configs) -> int:
    """Fit numbers of a problem to measured motions, with confidence intervals."""
    from fvi_cli.runner import studies

    def show(config: LoadedConfig, found: list[FitResult]) -> None:
        call.show(config, found)
        if not call.check:
            call.wrote(studies.write_fitted(config, found, call.output))

    return call.each(configs, studies.fit_tasks, studies.fit, show)


@command(LINEAR, *STUDY)
def modes(
    call: Call,
    configs: Configs,
    count: Annotated[int | None, typer.Option(help="How many; default 10.")] = None,
    near: Annotated[
        float | None, typer.Option(help="Those nearest to a frequency; default: the lowest.")
    ] = None,
) -> int:
    """Compute modes of linear scenes with their damping, and count whether any is missing."""
    from fvi_cli.runner import vibration as study

    return call.each(configs, study.modes_tasks, study.modes, count=count, near=near)


@command(LINEAR, *STUDY)
def response(
    call: Call,
    configs: Configs,
    frequency: Annotated[
        str, typer.Option(metavar="FROM:TO:N[:log]", help="In Hz, where time is in seconds.")
    ],
    force: Annotated[
        list[str] | None,
        typer.Option(metavar="WHERE[=SIZE]", help="Such as x1, x2 - x1, or ground; repeatable."),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="WHERE", help="Outputs such as x5, ax5, drift_1; repeatable."),
    ] = None,
) -> int:
    """Compute steady responses: magnitude, phase, peaks, half-power loss factors.

    For example: fvi response ten-storeys --frequency 0.2:8:400 --force ground --at 'x10 - x9'
    """
    from fvi_cli.runner import vibration as study

    return call.each(
        configs,
        study.response_tasks,
        study.response,
        frequency=frequency,
        force=force or (),
        at=at or (),
    )
