"""Commands that compute: ``run``, ``cost``, ``stability``, ``fit``, ``hard-cases``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.command import COMPUTED, CONFIGURED, DRAWN, Call, command
from fvi_cli.cli.completion import methods_of_hard_cases, names_of_hard_cases
from fvi_cli.cli.options import Configs, Sources, UsualConfigs

if TYPE_CHECKING:
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.request import Request
    from fvi_cli.studies.cost import CostTable
    from fvi_cli.studies.fits.result import FitResult


@command(
    *COMPUTED,
    "shard",
    "checkpoint_every",
    examples="""
    fvi run damped-oscillator
    fvi run mine.yaml -j 4 --set problem.stiffness=2
    fvi run mine.yaml --dry-run
    """,
)
def run(call: Call, sources: Sources) -> int:
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli.render.results import json_rows
    from fvi_cli.render.runs import runs_as_text
    from fvi_cli.runner.parts.shard import shard_named

    shard = shard_named(call.shard)

    def show(outcomes: list[Outcome], request: Request) -> None:
        call.note(outcomes)
        path = request.stored or call.output / shard.file_name(request.name)
        call.files.append(path)
        if call.json:
            call.collect(json_rows(outcomes))
        else:
            print(runs_as_text(outcomes, every_member=call.verbose), path, sep="\n")

    call.gather(sources)
    if call.dry_run:
        return call.show_plans()
    return call.each(lambda request: call.run(request, keeps_motions=False), show)


@command(
    *CONFIGURED,
    *DRAWN,
    "allow_unstable",
    examples="""
    fvi cost damped-oscillator
    fvi cost mine.yaml --set 'ladder.steps=[64, 128, 256]' --format svg
    """,
)
def cost(
    call: Call,
    configs: UsualConfigs = None,
    peers: Annotated[
        bool,
        typer.Option("--peers", help="Measure the methods of pycaputo too, if it is installed."),
    ] = False,
) -> int:
    """Measure error, time, memory and work of every method; without arguments, remake the page."""
    from fvi_cli.api.calls import cost as measure
    from fvi_cli.render.cost import PAGE_CONFIGS, write_page
    from fvi_cli.runner.cost import measurable

    finished: dict[str, list[CostTable]] = {}

    def show(tables: list[CostTable], request: Request) -> None:
        finished[request.name] = tables
        is_whole = not configs and len(finished) == len(call.requests)
        call.show(
            tables,
            request,
            also=lambda: [write_page(call.output, finished)] if is_whole else [],
        )

    call.requests = measurable(call.gather(configs or PAGE_CONFIGS), peers=peers)
    if call.dry_run:
        return call.show_plans(fresh=True)
    return call.each(lambda request: measure(request, progress=not call.quiet), show)


@command(*CONFIGURED, *DRAWN, "check")
def stability(
    call: Call,
    configs: Configs,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            metavar="KEY=FROM:TO:NUMBER[:log]",
            help="Vary an entry of the problem, as in problem.stiffness=1:1e6:40:log, in place of "
            "the configuration's own `sweep`; once or twice.",
        ),
    ] = None,
    observe: Annotated[
        bool | None,
        typer.Option(
            "--observe/--no-observe",
            help="Run every method from random data and compare; default: as configured, yes.",
        ),
    ] = None,
) -> int:
    """Predict the stability of every method over steps and parameters, and compare with runs.

    Exit code 3 when a prediction is not what is observed, 1 when a run failed unexpectedly.
    """
    from fvi_cli.api.calls import stability as study

    call.gather(configs, over or ())
    if call.dry_run:
        return call.show_plans(fresh=True)
    return call.each(
        lambda request: study(request, observe=observe, progress=not call.quiet), call.show
    )


@command(
    *CONFIGURED,
    *DRAWN,
    "check",
    examples="""
    fvi fit fit-response
    fvi fit mine.yaml --set 'fit.parameters={problem.stiffness: {from: 1, to: 10}}'
    """,
)
def fit(call: Call, configs: Configs) -> int:
    """Fit numbers of a problem to measured motions, with confidence intervals.

    Writes tables, figures and a configuration with the numbers found. Exit code 1 when a fit does
    not converge; then the best point is reported, and why.
    """
    from fvi_cli.api.calls import fit as fit_to
    from fvi_cli.runner.fits.fit import fit_tasks, write_fitted

    def show(results: list[FitResult], request: Request) -> None:
        call.show(results, request, also=lambda: write_fitted(request, results, call.output))

    call.gather(configs)
    if call.dry_run:
        return call.show_tasks(fit_tasks)
    return call.each(lambda request: fit_to(request, progress=not call.quiet), show)


@command("output", "check", "json")
def hard_cases(
    call: Call,
    case: Annotated[
        list[str] | None,
        typer.Option(
            "--case",
            metavar="NAME",
            help="Only this case; repeatable. The report is printed, not written.",
            autocompletion=names_of_hard_cases,
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            metavar="NAME",
            help="Only this method, as it is called in the report; repeatable. The report is "
            "printed, not written.",
            autocompletion=methods_of_hard_cases,
        ),
    ] = None,
) -> int:
    """Measure every method on hard cases and report what holds; Gauss3 must hold everywhere."""
    from fvi_cli.api.calls import hard_cases as examine
    from fvi_cli.reports import missing

    absent = missing(call.output, "hard-cases") if call.check else []
    if absent:
        call.differences += absent
        return call.close()
    report = examine(cases=case or (), methods=method or (), progress=not call.quiet)
    call.show(report, is_kept=not (case or method))
    return call.close()
