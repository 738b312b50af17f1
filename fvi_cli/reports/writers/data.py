"""Sheets as CSV and JSON with numbers in full precision, and reading of CSV."""

from __future__ import annotations

import csv
import io
import json
import math

from fvi_cli.reports.table import Column, Report, Sheet, Value

FORMAT = 2
"""Number of the layout of the JSON form."""


def to_csv(sheet: Sheet) -> str:
    """A line for every row under the names of the columns.

    A float is written as its ``repr``, from which the same number is read back; nan means that
    there is no number. Lines end with a newline only.
    """
    columns = csv_columns(sheet)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in columns])
    writer.writerows([as_word(row[c.name], c) for c in columns] for row in sheet.rows)
    return text.getvalue()


def csv_columns(sheet: Sheet) -> list[Column]:
    """The columns that the CSV form has."""
    return [column for column in sheet.columns if not column.is_extra]


def as_word(value: Value, column: Column) -> str:
    """The text of a value in the CSV form."""
    if value is None:
        return column.missing
    if isinstance(value, bool):
        return "yes" if value else "no"
    # `float` also converts NumPy's numbers
    return repr(float(value)) if isinstance(value, float) else str(value)


def as_value(word: str, like: Value) -> Value:
    """The value of `word` if it can be read with the type of `like`; otherwise the word."""
    try:
        if isinstance(like, bool):
            return {"yes": True, "no": False}.get(word, word)
        if isinstance(like, float):
            return float(word)
        return int(word) if isinstance(like, int) else word
    except ValueError:
        return word


def to_json(report: Report) -> str:
    """All sheets with the meaning of their columns, one row in a line.

    Missing values and nan become null, infinities the texts ``inf`` and ``-inf``.
    """
    sheets = ",\n".join(f" {_quoted(sheet.name)}: {_sheet(sheet)}" for sheet in report.sheets)
    head = f'{{"format": {FORMAT},\n"name": {_quoted(report.name)},\n"sheets": {{\n'
    return f"{head}{sheets}\n}}}}\n"


def _sheet(sheet: Sheet) -> str:
    columns = ",\n".join(f"   {_quoted(c.name)}: {_quoted(c.meaning)}" for c in sheet.columns)
    rows = ",\n".join(
        "   " + _quoted({c.name: _json(row[c.name]) for c in sheet.columns}) for row in sheet.rows
    )
    return f'{{\n  "columns": {{\n{columns}}},\n  "rows": [\n{rows}]}}'


def _json(value: Value) -> Value:
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return repr(float(value)) if math.isinf(value) else float(value)
    return value


def _quoted(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)


def read_csv(text: str) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and the words of every row."""
    lines = list(csv.reader(io.StringIO(text)))
    return (lines[0], lines[1:]) if lines else ([], [])
