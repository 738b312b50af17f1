"""One writer for each form of a report: text, CSV and JSON, Markdown, LaTeX."""

from __future__ import annotations

from collections.abc import Sequence

from fvi_cli.reports.document import Block
from fvi_cli.reports.table import Report, Sheet
from fvi_cli.reports.writers.data import to_csv, to_json
from fvi_cli.reports.writers.latex import to_latex, to_tabulars
from fvi_cli.reports.writers.text import to_markdown


def csv_name(report: Report, sheet: Sheet) -> str:
    """Name of the CSV file of a sheet."""
    is_first = sheet is report.sheets[0]
    return f"{report.name}.csv" if is_first else f"{report.name}-{sheet.name}.csv"


TEXT = "text"
"""End of the name of the LaTeX file that also has headings and words."""


def forms(name: str, blocks: Sequence[Block]) -> dict[str, str]:
    """The texts of a report for readers, by the names of files.

    They are Markdown, LaTeX, and for every table a file with this LaTeX table alone.
    """
    texts = {f"{name}.md": to_markdown(blocks), f"{name}-{TEXT}.tex": to_latex(blocks)}
    for own, text in to_tabulars(blocks).items():
        # do not repeat the name of the report if that of an experiment begins with it
        whole = own if f"{own}-".startswith(f"{name}-") else "-".join(filter(None, (name, own)))
        texts[f"{whole}-table.tex" if f"{whole}.tex" in texts else f"{whole}.tex"] = text
    return texts


def rendered(report: Report) -> dict[str, str]:
    """The text of every file, by its name: CSV, Markdown, LaTeX and JSON."""
    return {
        **{csv_name(report, sheet): to_csv(sheet) for sheet in report.sheets if sheet.is_file},
        **forms(report.name, report.blocks),
        f"{report.name}.json": to_json(report),
    }
