"""Sheets as CSV with numbers in full precision, and reading of CSV."""

from __future__ import annotations

import csv
import io

from fvi_cli.reports.table import Column, Sheet, Value


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


def read_csv(text: str) -> tuple[list[str], list[list[str]]]:
    """Names of the columns, and the words of every row."""
    lines = list(csv.reader(io.StringIO(text)))
    return (lines[0], lines[1:]) if lines else ([], [])
