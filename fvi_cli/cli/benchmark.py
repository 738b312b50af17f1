"""``fvi benchmark``: what the engine takes."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.exits import DONE, guarded
from fvi_cli.cli.options import RESULTS, Output, Quiet, Verbose


@guarded
def benchmark(
    output: Output = RESULTS,
    exponent: Annotated[
        int,
        typer.Option(
            "--exponent",
            min=8,
            max=22,
            metavar="E",
            help="Linear scenes take 2^E steps; fewer than 2^20 are a trial.",
        ),
    ] = 20,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure time, error and memory of the engine on this machine, beside the figures to meet."""
    from fvi_cli.render.runs import write_benchmark

    print(*write_benchmark(output, exponent), sep="\n")
    return DONE
