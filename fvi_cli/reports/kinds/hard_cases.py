"""The report on hard cases: measured numbers, their limits, and where each method fails."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from fvi_cli.reports.document import Block, Heading, Paragraph
from fvi_cli.reports.table import (
    Column,
    Report,
    Row,
    Sheet,
    Within,
    Words,
    number_of,
    pivot,
)
from fvi_cli.studies.hard_cases.case import FLAGSHIP, Finding, HardCaseReport

NAME = "hard-cases"

ROUND_OFF = 1e-9
"""Smaller numbers are round-off, or so near to it that only verdicts are compared."""

NEAR_THE_LIMIT = 10.0
"""Numbers that depend on round-off may lie on either side of a limit within this factor."""

COLUMNS = (
    Column("case", "name of the case"),
    Column("quantity", "what is measured"),
    Column("method", "name of the method"),
    Column(
        "measured",
        "the number; infinite where a run did not come to its end",
        compared=Within(relative=1e-3, absolute=ROUND_OFF),
    ),
    Column("limit", "what it is held against"),
    Column("sense", "whether it must be at most or at least the limit"),
    Column("holds", "whether it is"),
    Column("status", "the worst status of the runs"),
    Column("predicted", "the worst stability prediction for the runs"),
    Column("is_comparable", "whether every machine measures the same number"),
)


def hard_case_report(found: HardCaseReport) -> Report:
    """The report on the hard cases that were examined, or on a part of them."""
    return Report(
        name=NAME,
        sheets=(
            Sheet.of(
                "findings",
                COLUMNS,
                found.findings,
                ("case", "quantity", "method"),
                below_floor=_below_floor,
            ),
        ),
        words=lambda sheets: _words(found),
        remake=lambda sheets: hard_case_report(_with_rows(found, sheets["findings"].rows)),
        is_partial=found.is_partial,
    )


def _words(found: HardCaseReport) -> Words:
    summary, details = summary_blocks(found), list(_details(found))
    title = Heading(level=1, words="Hard cases")
    # on a terminal the summary comes last, where it is seen
    return [title, *details, *summary], [title, *summary, *details]


def _with_rows(found: HardCaseReport, rows: Sequence[Row]) -> HardCaseReport:
    findings = []
    for finding, row in zip(found.findings, rows, strict=True):
        measured, holds = row["measured"], row["holds"]
        if isinstance(measured, float) and isinstance(holds, bool):
            finding = replace(finding, measured=measured, holds=holds)
        findings.append(finding)
    return replace(found, findings=tuple(findings))


def _below_floor(stored: Row, fresh: Row) -> set[str]:
    """Columns not compared: numbers of runs that grow from round-off, verdicts on round-off."""
    if fresh["predicted"] == "unstable":
        return {"measured", "status", "holds"}
    free = set()
    if not fresh["is_comparable"] or fresh["status"] != "ok":
        free.add("measured")
    if _is_left_to_chance(stored, fresh):
        free.add("holds")
    return free


def _is_left_to_chance(stored: Row, fresh: Row) -> bool:
    """Whether round-off may put both numbers on different sides of the limit."""
    one, other, limit = (
        number_of(value) for value in (stored["measured"], fresh["measured"], fresh["limit"])
    )
    near = all(1.0 / NEAR_THE_LIMIT < x / limit < NEAR_THE_LIMIT for x in (one, other) if limit)
    return limit > 0 and near and (max(one, other) < ROUND_OFF or not fresh["is_comparable"])


def summary_blocks(report: HardCaseReport) -> list[Block]:
    """For every method the number of claims that hold, and the cases in which some do not."""

    def cells(method: str) -> tuple[str, str, str]:
        own = [finding for finding in report.findings if finding.method == method]
        wrong = [finding for finding in own if not finding.holds]
        unstable = {f.case for f in wrong if f.status != "ok" or f.predicted == "unstable"}
        inaccurate = {finding.case for finding in wrong} - unstable
        return (
            f"{len(own) - len(wrong)} of {len(own)}",
            f"{len(inaccurate)} of {len(report.cases)} cases",
            ", ".join(case.name for case in report.cases if case.name in unstable) or "-",
        )

    return [
        Heading(level=2, words="Where each method fails"),
        pivot(
            (((method,), "all", cells(method)) for method in report.methods),
            corner=("method",),
            headings={"all": ("holds", "too inaccurate in", "blows up in")},
            text_columns=4,
        ),
    ]


def _details(report: HardCaseReport) -> Iterator[Block]:
    for case in report.cases:
        findings = report.of(case.name)
        yield Heading(level=2, words=f"{case.name}: {case.title}")
        yield Paragraph(words=f"{case.description}. Truth: {case.reference}.")
        limits = {one.quantity: f"{one.sense} {one.limit:g}" for one in reversed(findings)}
        yield pivot(
            (((f.quantity, limits[f.quantity]), f.method, (_cell(f),)) for f in findings),
            corner=("measured", "must be"),
            headings={method: (method,) for method in report.methods},
            name=case.name,
        )
        unstable = dict.fromkeys(f.method for f in findings if f.predicted == "unstable")
        if unstable:
            yield Paragraph(words=f"Unstable by prediction: {', '.join(unstable)}.")


def _cell(finding: Finding) -> str:
    if finding.status != "ok":
        return finding.status
    number = "0" if finding.measured == 0 else f"{finding.measured:.1e}"
    return number if finding.holds else f"{number} NO"


def failures(report: HardCaseReport) -> list[str]:
    """One line for every claim that fails with the method for which all must hold."""
    return [
        f"{f.case}: {f.quantity}: {f.measured:.3g} ({f.status}) with {f.method}; it must be "
        f"{f.sense} {f.limit:g}"
        for f in report.findings
        if f.method == FLAGSHIP and not f.holds
    ]
