"""``fvi hard-cases``: what holds where integrators usually fail."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from fvi_cli.commands.exits import CHECK_FAILED, DONE, guarded, verdict
from fvi_cli.commands.options import RESULTS, Output, Quiet, Verbose

if TYPE_CHECKING:
    from fvi_cli.experiments.hard_cases.case import HardCaseReport


@guarded
def hard_cases(
    output: Output = RESULTS,
    check: Annotated[
        bool,
        typer.Option("--check", help="Compare with the stored report and write nothing."),
    ] = False,
    case: Annotated[
        list[str] | None,
        typer.Option(
            "--case", metavar="NAME", help="Only this case; repeatable. Nothing is written."
        ),
    ] = None,
    method: Annotated[
        list[str] | None,
        typer.Option(
            "--method",
            metavar="NAME",
            help="Only this method, as it is called in the report; repeatable. Nothing is written.",
        ),
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure every method on hard cases, and tell what holds; Gauss3 must hold everywhere."""
    from fvi_cli.output.tables import hard_cases as tables

    report = _report(case or (), method or (), show_progress=not quiet)
    if check:
        return verdict([*tables.compare_with_report(output, report), *tables.failures(report)])
    print(tables.report_text(report))
    if not (case or method):
        print("", *tables.write_report(output, report), sep="\n")
    return CHECK_FAILED if tables.failures(report) else DONE


def _report(cases: Sequence[str], methods: Sequence[str], *, show_progress: bool) -> HardCaseReport:
    """The named cases with the named methods; where nothing is named, all of them."""
    from fvi_cli.errors import RequestError
    from fvi_cli.experiments.hard_cases.case import Finding, HardCaseReport, examine
    from fvi_cli.experiments.hard_cases.suite import examined_methods, hard_cases
    from fvi_cli.progress import progress_bar

    known = hard_cases()
    named = {method.name: method for method in examined_methods()}
    complaints = [
        f"{option} {name!r} is not one of {', '.join(allowed)}"
        for option, names, allowed in (("--case", cases, known), ("--method", methods, named))
        for name in names
        if name not in allowed
    ]
    if complaints:
        raise RequestError(*complaints)
    chosen = [case for name, case in known.items() if not cases or name in cases]
    by = [method for name, method in named.items() if not methods or name in methods]
    findings: list[Finding] = []
    with progress_bar("hard cases", len(chosen) * len(by), wanted=show_progress) as advance:
        for case in chosen:
            for method in by:
                findings += examine([case], [method])
                advance(f"{case.name} {method.name}")
    return HardCaseReport(cases=tuple(case.text for case in chosen), findings=tuple(findings))
