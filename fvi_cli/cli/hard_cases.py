"""``fvi hard-cases``: what holds where integrators usually fail."""

from __future__ import annotations

from typing import Annotated

import typer

from fvi_cli.cli.completion import methods_of_hard_cases, names_of_hard_cases
from fvi_cli.cli.exits import CHECK_FAILED, DONE, guarded, verdict
from fvi_cli.cli.options import RESULTS, Check, Output, Quiet, Verbose


@guarded
def hard_cases(
    output: Output = RESULTS,
    check: Check = False,
    case: Annotated[
        list[str] | None,
        typer.Option(
            "--case",
            metavar="NAME",
            help="Only this case; repeatable. Nothing is written.",
            autocompletion=names_of_hard_cases,
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            metavar="NAME",
            help="Only this method, as it is called in the report; repeatable. Nothing is written.",
            autocompletion=methods_of_hard_cases,
        ),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure every method on hard cases, and tell what holds; Gauss3 must hold everywhere."""
    from fvi_cli.render.results import compare, show, write
    from fvi_cli.reports import missing
    from fvi_cli.reports.kinds.hard_cases import failures
    from fvi_cli.runner.hard_cases import examine_named

    absent = missing(output, "hard-cases")
    if check and absent:
        return verdict(absent)
    report = examine_named(case or (), method or (), show_progress=not quiet)
    if check:
        return verdict([*compare(report, output), *failures(report)])
    show(report)
    if not (case or method):
        print("", *write(report, output), sep="\n")
    return CHECK_FAILED if failures(report) else DONE
