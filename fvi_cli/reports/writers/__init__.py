"""One writer for each form of a report: text, CSV, Markdown, LaTeX."""

from __future__ import annotations

from fvi_cli.reports.table import Report, Sheet
from fvi_cli.reports.writers.data import to_csv
from fvi_cli.reports.writers.latex import to_latex
from fvi_cli.reports.writers.text import to_markdown


def csv_name(report: Report, sheet: Sheet) -> str:
    """Name of the CSV file of a sheet."""
    is_first = sheet is report.sheets[0]
    return f"{report.name}.csv" if is_first else f"{report.name}-{sheet.name}.csv"


def rendered(report: Report) -> dict[str, str]:
    """The text of every file, by its name: CSV, Markdown, and LaTeX where the report has it."""
    texts = {csv_name(report, sheet): to_csv(sheet) for sheet in report.sheets if sheet.is_file}
    texts[f"{report.name}.md"] = to_markdown(report.blocks)
    if report.has_latex:
        texts[f"{report.name}.tex"] = to_latex(report.blocks)
    return texts
