"""The report on the hard cases as Markdown, CSV and JSON; whether the stored one is up to date."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from fvi_cli.errors import StorageError
from fvi_cli.reports.document import Block, Grid, Heading, Paragraph
from fvi_cli.reports.markdown import to_markdown
from fvi_cli.reports.plain_text import to_text
from fvi_cli.storage.atomic import replace_file
from fvi_cli.studies.hard_cases.case import CaseText, Finding, HardCaseReport
from fvi_cli.studies.hard_cases.suite import FLAGSHIP

NAME = "hard-cases"
COLUMNS = tuple(field.name for field in fields(Finding))
TITLE = Heading(level=1, words="Hard cases")

SAME_NUMBER = 1e-3
"""Relative, for numbers that every machine measures alike."""

ROUND_OFF = 1e-9
"""Below it numbers are round-off, or so near that only their verdicts are compared."""

NEAR_THE_LIMIT = 10.0
"""Numbers that round-off decides may lie on either side of a limit within this factor."""

FORMAT = 1


def report_paths(directory: Path) -> dict[str, Path]:
    """Where the forms of the report are, by suffix."""
    return {form: directory / f"{NAME}.{form}" for form in ("md", "csv", "json")}


def rendered_report(report: HardCaseReport) -> dict[str, str]:
    """The text of every form."""
    return {
        "md": to_markdown([TITLE, *summary_blocks(report), *_details(report)]),
        "csv": _to_csv(report),
        "json": _to_json(report),
    }


def report_text(report: HardCaseReport) -> str:
    """What a terminal shows: every case, and the summary at the end, where it is seen."""
    return to_text([TITLE, *_details(report), *summary_blocks(report)])


def summary_blocks(report: HardCaseReport) -> list[Block]:
    """For every method how much holds, and in which cases something does not."""
    rows = []
    for method in report.methods:
        own = [finding for finding in report.findings if finding.method == method]
        wrong = [finding for finding in own if not finding.holds]
        unstable = {f.case for f in wrong if f.status != "ok" or f.predicted == "unstable"}
        inaccurate = {finding.case for finding in wrong} - unstable
        blown = [case.name for case in report.cases if case.name in unstable]
        rows.append(
            (
                method,
                f"{len(own) - len(wrong)} of {len(own)}",
                f"{len(inaccurate)} of {len(report.cases)} cases",
                ", ".join(blown) or "-",
            )
        )
    return [
        Heading(level=2, words="Where each method fails"),
        Grid(
            header=("method", "holds", "too inaccurate in", "blows up in"),
            rows=tuple(rows),
            text_columns=4,
            key_columns=4,
        ),
    ]


def _details(report: HardCaseReport) -> Iterator[Block]:
    for case in report.cases:
        findings = report.of(case.name)
        yield Heading(level=2, words=f"{case.name}: {case.title}")
        yield Paragraph(words=f"{case.description}. Truth: {case.reference}.")
        quantities = dict.fromkeys(finding.quantity for finding in findings)
        by_place = {(finding.quantity, finding.method): finding for finding in findings}
        rows = []
        for quantity in quantities:
            some = by_place[quantity, report.methods[0]]
            rows.append(
                (
                    quantity,
                    f"{some.sense} {some.limit:g}",
                    *(_cell(by_place[quantity, method]) for method in report.methods),
                )
            )
        yield Grid(
            header=("measured", "must be", *report.methods),
            rows=tuple(rows),
            text_columns=2,
            key_columns=2,
        )
        unstable = dict.fromkeys(f.method for f in findings if f.predicted == "unstable")
        if unstable:
            yield Paragraph(words=f"Unstable by prediction: {', '.join(unstable)}.")


def _cell(finding: Finding) -> str:
    if finding.status != "ok":
        return finding.status
    number = "0" if finding.measured == 0 else f"{finding.measured:.1e}"
    return number if finding.holds else f"{number} NO"


def _to_csv(report: HardCaseReport) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for finding in report.findings:
        writer.writerow({name: _word(value) for name, value in asdict(finding).items()})
    return text.getvalue()


def _word(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return repr(value) if isinstance(value, float) else str(value)


def _to_json(report: HardCaseReport) -> str:
    cases = [json.dumps(asdict(case)) for case in report.cases]
    # a line for each: changes are read line by line
    findings = [
        json.dumps(
            {name: _number(value) for name, value in asdict(finding).items()}, allow_nan=False
        )
        for finding in report.findings
    ]
    return "".join(
        (
            f'{{"format": {FORMAT},\n"cases": [\n',
            ",\n".join(cases),
            '\n],\n"findings": [\n',
            ",\n".join(findings),
            "\n]}\n",
        )
    )


def _number(value: object) -> object:
    # JSON has no word for these
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def report_from_json(text: str) -> HardCaseReport:
    """The report that was written as JSON.

    Raises
    ------
    ValueError
        If it is none of ours.
    """
    content: Any = json.loads(text)
    try:
        if content["format"] != FORMAT:
            raise ValueError(f"format {content['format']!r} is not {FORMAT}")
        findings = tuple(
            Finding(**{**entry, "measured": float(entry["measured"])})
            for entry in content["findings"]
        )
        return HardCaseReport(
            cases=tuple(CaseText(**entry) for entry in content["cases"]), findings=findings
        )
    except (KeyError, TypeError) as error:
        raise ValueError(f"no report on hard cases: {error}") from None


def write_report(directory: Path, report: HardCaseReport) -> list[Path]:
    """Write the three forms into `directory`, each whole or not at all; returns the paths.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    paths = report_paths(directory)
    place = directory
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for form, text in rendered_report(report).items():
            place = paths[form]
            replace_file(place, text.encode("utf-8"))
    except OSError as error:
        raise StorageError(f"{place}: cannot be written: {error.strerror}") from None
    return list(paths.values())


def failures(report: HardCaseReport) -> list[str]:
    """One line for every claim that does not hold with the method for which all must."""
    return [
        f"{f.case}: {f.quantity}: {f.measured:.3g} ({f.status}) with {f.method}; it must be "
        f"{f.sense} {f.limit:g}"
        for f in report.findings
        if f.method == FLAGSHIP and not f.holds
    ]


def compare_with_report(directory: Path, fresh: HardCaseReport) -> list[str]:
    """One line for everything in which the stored report differs from `fresh`.

    The JSON form is compared with `fresh`; the others must be, letter by letter, what is made of
    it. Cases and methods that are not in `fresh` are not looked at.
    """
    paths = report_paths(directory)
    missing = [f"{path}: missing" for path in paths.values() if not path.is_file()]
    if missing:
        return missing
    try:
        stored = report_from_json(paths["json"].read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        return [f"{paths['json']}: cannot be read: {error}"]
    differences = [f"{paths['json']}: {line}" for line in compare_reports(stored, fresh)]
    for form, text in rendered_report(stored).items():
        if paths[form].read_bytes() != text.encode("utf-8"):
            differences.append(f"{paths[form]}: is not what {paths['json'].name} gives")
    return differences


def compare_reports(stored: HardCaseReport, fresh: HardCaseReport) -> Iterator[str]:
    """One line for every finding of `fresh` that is another one in `stored`.

    Limits, predictions and verdicts must be the same, and numbers within a thousandth where every
    machine measures the same. Where round-off decides, a number may change sides within a factor
    of ten of its limit. Runs that are predicted to blow up grow from round-off: of them only the
    prediction is compared.
    """
    texts = {case.name: case for case in stored.cases}
    for case in fresh.cases:
        if texts.get(case.name) != case:
            yield f"{case.name}: described differently"
    methods = set(fresh.methods)
    names = {case.name for case in fresh.cases}
    old = _by_place([f for f in stored.findings if f.method in methods and f.case in names])
    new = _by_place(fresh.findings)
    for place in old:
        if place not in new:
            yield f"{': '.join(place)}: stored, but not there now"
    for place, finding in new.items():
        if place not in old:
            yield f"{': '.join(place)}: not stored"
        else:
            line = _difference(old[place], finding)
            if line:
                yield f"{': '.join(place)}: {line}"


def _by_place(findings: Sequence[Finding]) -> Mapping[tuple[str, str, str], Finding]:
    return {(f.case, f.quantity, f.method): f for f in findings}


def _difference(stored: Finding, fresh: Finding) -> str:
    for name in ("limit", "sense", "predicted", "is_comparable"):
        old, new = getattr(stored, name), getattr(fresh, name)
        if old != new:
            return f"{name}: {old!r} is stored, now {new!r}"
    if fresh.predicted == "unstable":
        return ""
    if stored.status != fresh.status:
        return f"status: {stored.status} is stored, now {fresh.status}"
    old_number, new_number = stored.measured, fresh.measured
    if stored.holds != fresh.holds and not _is_left_to_chance(stored, fresh):
        return f"holds: {stored.holds} at {old_number:.3g} is stored, now {new_number:.3g}"
    if not stored.is_comparable or fresh.status != "ok":
        return ""
    alike = math.isclose(old_number, new_number, rel_tol=SAME_NUMBER, abs_tol=ROUND_OFF)
    return "" if alike else f"measured: {old_number!r} is stored, now {new_number!r}"


def _is_left_to_chance(stored: Finding, fresh: Finding) -> bool:
    """Whether round-off may have put these two numbers on different sides of the limit."""
    near = all(
        1.0 / NEAR_THE_LIMIT < finding.measured / finding.limit < NEAR_THE_LIMIT
        for finding in (stored, fresh)
        if finding.limit
    )
    is_small = max(stored.measured, fresh.measured) < ROUND_OFF
    return stored.limit > 0 and near and (is_small or not stored.is_comparable)
