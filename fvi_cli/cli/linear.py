"""Commands for linear structures: ``modes``, ``response``."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.command import CONFIGURED, DRAWN, Call, command
from fvi_cli.cli.options import Configs


@command(*CONFIGURED, *DRAWN, "check")
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
    from fvi_cli.api.calls import modes as compute_modes
    from fvi_cli.runner.vibration.modes import linear_tasks

    call.gather(configs)
    if call.dry_run:
        return call.show_tasks(lambda request: linear_tasks(request, "modes"))
    return call.each(lambda request: compute_modes(request, count=count, near=near), call.show)


@command(*CONFIGURED, *DRAWN, "check")
def response(
    call: Call,
    configs: Configs,
    over: Annotated[
        str,
        typer.Option(
            "--over",
            metavar="frequency=FROM:TO:NUMBER[:log]",
            help="Frequencies in oscillations per unit of time, Hz for seconds.",
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
            help="Outputs to report: coordinates or combinations; repeatable. Default: the "
            "coordinate that moves most.",
        ),
    ] = None,
) -> int:
    """Compute steady responses: magnitude, phase, peaks, half-power loss factors."""
    from fvi_cli.api.calls import response as compute_response
    from fvi_cli.runner.vibration.modes import linear_tasks
    from fvi_cli.runner.vibration.response import frequencies

    # a mistake in it is reported before configurations are read
    frequencies(over)
    call.gather(configs)
    if call.dry_run:
        return call.show_tasks(lambda request: linear_tasks(request, "response"))
    return call.each(
        lambda request: compute_response(request, over=over, force=force or (), at=at or ()),
        call.show,
    )
