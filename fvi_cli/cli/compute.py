"""Commands that compute: runs, costs, stability, fits, modes and responses."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.cli.command import COMPUTED, CONFIGURED, Call, command
from fvi_cli.cli.options import Configs, Sources

if TYPE_CHECKING:
    from fvi_cli.runner.outcome import Outcome
    from fvi_cli.runner.request import Request
    from fvi_cli.studies.fits.result import FitResult

COMPUTE, LINEAR = "Compute", "Linear structures"


@command(
    COMPUTE,
    *COMPUTED,
    "shard",
    examples=("fvi run damped-oscillator", "fvi run mine.yaml -j 4 --set problem.stiffness=2"),
)
def run(
    call: Call,
    sources: Sources,
    prune: Annotated[
        bool, typer.Option("--prune", help="Drop stored runs that are no longer asked for.")
    ] = False,
) -> int:
    """Compute every method of a configuration on every step size; store what comes out."""
    from fvi_cli.render.json import finished_run
    from fvi_cli.render.runs import runs_as_text

    def show(request: Request, outcomes: list[Outcome]) -> None:
        if call.json:
            finished = [one for outcome in outcomes for one in outcome.finished]
            call.collect({"runs": list(map(finished_run, finished))})
        else:
            print(runs_as_text(outcomes, every_member=call.verbose))
        call.wrote([request.stored or call.output / f"{request.name}.h5"])

    call.gather(sources, stores_runs=True)
    return call.each(functools.partial(call.runs, prune=prune, keeps_motions=False), show)


@command(COMPUTE, *CONFIGURED, examples=("fvi cost damped-oscillator --repeats 9",))
def cost(
    call: Call,
    configs: Configs,
    repeats: Annotated[
        int, typer.Option("--repeats", min=1, metavar="N", help="How often every run is timed.")
    ] = 5,
) -> int:
    """Measure error, time and work of every method and baseline, one run after the other."""
    from fvi_cli.runner.cost import cost as measure
    from fvi_cli.runner.cost import cost_tasks, measurable

    measurable(call.gather(configs))
    compute = functools.partial(measure, repeats=repeats, progress=not call.quiet)
    return call.each(compute, tasks=cost_tasks)


@command(COMPUTE, *CONFIGURED, "check", examples=("fvi stability stability-bagley-torvik",))
def stability(call: Call, configs: Configs) -> int:
    """Predict the stability of every method over steps and parameters."""
    from fvi_cli.runner.stability import stability as study
    from fvi_cli.runner.stability import stability_tasks

    call.gather(configs)
    return call.each(functools.partial(study, progress=not call.quiet), tasks=stability_tasks)


@command(COMPUTE, *CONFIGURED, "check", examples=("fvi fit fit-response",))
def fit(call: Call, configs: Configs) -> int:
    """Fit numbers of a problem to measured motions, with confidence intervals.

    Writes tables, figures and a configuration with the numbers found. Exit code 1 when a fit does
    not converge; then the best point is reported, and why.
    """
    from fvi_cli.runner.fit import fit as fit_to
    from fvi_cli.runner.fit import fit_tasks, write_fitted

    def show(request: Request, results: list[FitResult]) -> None:
        call.show(request, results)
        if not call.check:
            call.wrote(write_fitted(request, results, call.output))

    call.gather(configs)
    return call.each(functools.partial(fit_to, progress=not call.quiet), show, tasks=fit_tasks)


@command(LINEAR, *CONFIGURED, "check", examples=("fvi modes ten-storeys --count 4",))
def modes(
    call: Call,
    configs: Configs,
    count: Annotated[
        int | None,
        typer.Option("--count", metavar="N", help="How many; default 10, or all if fewer."),
    ] = None,
    near: Annotated[
        float | None,
        typer.Option(
            "--near", metavar="HZ", help="Those nearest to a frequency; default: the lowest."
        ),
    ] = None,
) -> int:
    """Compute modes of linear scenes with their damping, and count whether any is missing.

    Exit code 1 where modes may be missing.
    """
    from fvi_cli.runner.vibration import linear_tasks
    from fvi_cli.runner.vibration import modes as compute_modes

    call.gather(configs)
    tasks = functools.partial(linear_tasks, action="modes")
    return call.each(functools.partial(compute_modes, count=count, near=near), tasks=tasks)


@command(
    LINEAR,
    *CONFIGURED,
    "check",
    examples=("fvi response ten-storeys --frequency 0.2:8:400 --force ground --at 'x10 - x9'",),
)
def response(
    call: Call,
    configs: Configs,
    frequency: Annotated[
        str,
        typer.Option(
            "--frequency",
            metavar="FROM:TO:N[:log]",
            help="Frequencies in oscillations per unit of time, Hz for seconds, as in 0.2:8:400.",
        ),
    ],
    force: Annotated[
        list[str] | None,
        typer.Option(
            "--force",
            metavar="WHERE[=AMPLITUDE]",
            help="A coordinate or a combination such as 'x2 - x1', or ground: an acceleration "
            "of 1; repeatable. Default: the ground, where it moves.",
        ),
    ] = None,
    at: Annotated[
        list[str] | None,
        typer.Option(
            "--at",
            metavar="WHERE",
            help="Outputs to report: coordinates, combinations, accelerations such as ax5, "
            "quantities; repeatable. Default: the coordinate that moves most.",
        ),
    ] = None,
) -> int:
    """Compute steady responses: magnitude, phase, peaks, half-power loss factors."""
    from fvi_cli.runner.vibration import frequencies, linear_tasks
    from fvi_cli.runner.vibration import response as compute_response

    # report mistakes in it before configurations are read
    frequencies(frequency)
    call.gather(configs)
    compute = functools.partial(
        compute_response, frequency=frequency, force=force or (), at=at or ()
    )
    return call.each(compute, tasks=functools.partial(linear_tasks, action="response"))
