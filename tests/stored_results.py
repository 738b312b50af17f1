"""Committed results, read back."""

import csv
from pathlib import Path

from fvi_cli.config.hard_cases import hard_cases
from fvi_cli.studies.hard_cases.case import Finding, HardCaseReport

RESULTS = Path(__file__).parents[1] / "results"


def stored_hard_cases() -> HardCaseReport:
    """The committed report; words are those of the cases."""
    with (RESULTS / "hard-cases.csv").open(encoding="utf-8") as file:
        findings = tuple(
            Finding(
                **{
                    **row,
                    "measured": float(row["measured"]),
                    "limit": float(row["limit"]),
                    "holds": row["holds"] == "yes",
                    "is_comparable": row["is_comparable"] == "yes",
                }
            )
            for row in csv.DictReader(file)
        )
    return HardCaseReport(cases=tuple(hard_cases().values()), findings=findings)
