"""The hard cases, as ``fvi hard-cases`` measures them."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.config.hard_cases import hard_cases as named_cases
from fvi_cli.errors import RequestError
from fvi_cli.runner.progress import progress_bar
from fvi_cli.studies.hard_cases.case import Finding, HardCaseReport, examine, examined_methods


def hard_cases(
    *, cases: Sequence[str] = (), methods: Sequence[str] = (), progress: bool = False
) -> HardCaseReport:
    """Which claims hold in the hard cases with every method, as ``fvi hard-cases`` measures it.

    Parameters
    ----------
    cases, methods
        Names, as in the report; empty: all of them.
    progress
        As for :func:`stability`.

    Raises
    ------
    RequestError
        For names that do not exist.
    """
    known = named_cases()
    named = examined_methods()
    complaints = [
        f"{option} {name!r} is not one of {', '.join(allowed)}"
        for option, names, allowed in (("--case", cases, known), ("--method", methods, named))
        for name in names
        if name not in allowed
    ]
    if complaints:
        raise RequestError(*complaints)
    chosen = [case for name, case in known.items() if not cases or name in cases]
    by = [name for name in named if not methods or name in methods]
    findings: list[Finding] = []
    with progress_bar("hard cases", len(chosen) * len(by), wanted=progress) as advance:
        for case in chosen:
            for name in by:
                findings += examine(case, name, named[name])
                advance(f"{case.name} {name}")
    is_partial = len(chosen) < len(known) or len(by) < len(named)
    return HardCaseReport(cases=tuple(chosen), findings=tuple(findings), is_partial=is_partial)
