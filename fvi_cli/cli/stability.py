"""``fvi stability``: what is predicted and seen over steps and parameters."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.exits import CHECK_FAILED, DONE, RUN_FAILED, guarded, verdict
from fvi_cli.cli.options import RESULTS, Check, Configs, Output, Overrides, Quiet, Verbose
from fvi_cli.cli.runs import tell


@guarded
def stability(
    configs: Configs,
    output: Output = RESULTS,
    over: Annotated[
        list[str] | None,
        typer.Option(
            "--over",
            metavar="KEY=FROM:TO:NUMBER[:log]",
            help="Vary an entry of the problem, as in problem.stiffness=1:1e6:40:log; once or "
            "twice. The configuration's own `sweep` gives way.",
        ),
    ] = None,
    observe: Annotated[
        bool | None,
        typer.Option(
            "--observe/--no-observe",
            help="Run every method from random data and compare; default: as configured, yes.",
        ),
    ] = None,
    check: Check = False,
    overrides: Overrides = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Predict the stability of every method over steps and parameters, and compare with runs.

    Exit code 3 when a prediction is not what is observed, 1 when the program itself made a mistake.
    """
    from fvi_cli.runner.stability import gather_over, study_stability

    crashed = failed = 0
    differences: list[str] = []
    for request in gather_over(configs, overrides or (), over or ()):
        tables = study_stability(request, is_observed=observe, show_progress=not quiet)
        differences += tell(tables, request.name, output, is_check=check)
        failed += sum(len(table.disagreements) for table in tables)
        crashed += sum(bool(row.failure) for table in tables for row in table.rows)
    if crashed:
        return RUN_FAILED
    return (verdict(differences) if check else DONE) or (CHECK_FAILED if failed else DONE)
