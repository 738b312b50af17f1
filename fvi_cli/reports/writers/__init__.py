"""One writer for each form of a report: text, CSV and JSON, Markdown, LaTeX."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from fvi_cli.reports.document import Block
from fvi_cli.reports.table import Report, Sheet
from fvi_cli.reports.writers.data import to_csv, to_json
from fvi_cli.reports.writers.latex import to_latex, to_tabulars
from fvi_cli.reports.writers.text import to_markdown


def csv_name(report: Report, sheet: Sheet) -> str:
    """Name of the CSV file of a sheet."""
    is_first = sheet is report.sheets[0]
    return f"{report.name}.csv" if is_first else f"{report.name}-{sheet.name}.csv"


FORMS: Mapping[str, Callable[[Sequence[Block]], str]] = {
    ".md": to_markdown,
    ".tex": to_tabulars,
    "-text.tex": to_latex,
}
"""What people read of a report, by the ending of its file; ``.tex`` has the tables alone."""


def rendered(report: Report) -> dict[str, str]:
    """The text of every file, by its name: CSV, Markdown, LaTeX and JSON."""
    return {
        **{csv_name(report, sheet): to_csv(sheet) for sheet in report.sheets if sheet.is_file},
        **{f"{report.name}{ending}": write(report.blocks) for ending, write in FORMS.items()},
        f"{report.name}.json": to_json(report),
    }
