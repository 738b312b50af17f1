"""``fvi response``: steady responses to harmonic forces."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded, verdict
from fvi_cli.cli.options import RESULTS, Check, Configs, Output, Overrides, Quiet, Verbose
from fvi_cli.cli.runs import tell


@guarded
def response(
    configs: Configs,
    over: Annotated[
        str,
        typer.Option(
            "--over",
            metavar="frequency=FROM:TO:NUMBER[:log]",
            help="Frequencies in oscillations per unit of time, Hz for seconds.",
        ),
    ],
    output: Output = RESULTS,
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
            help="What is told of: coordinates or combinations; repeatable. Default: the "
            "coordinate that moves most.",
        ),
    ] = None,
    check: Check = False,
    overrides: Overrides = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Compute steady responses: magnitude, phase, peaks, half-power loss factors."""
    from fvi_cli.runner.request import gather
    from fvi_cli.runner.vibration.response import frequencies, request_responses

    hertz = frequencies(over)
    differences: list[str] = []
    for request in gather(configs, overrides or ()):
        tables = request_responses(request, hertz, force or (), at or ())
        differences += tell(tables, request.name, output, is_check=check)
    return verdict(differences) if check else DONE
