"""Stored rows against what the program makes now."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

from fvi_cli.reports.table import Report, Sheet, Value, Within
from fvi_cli.reports.write import as_word, csv_name


def compare(directory: Path, report: Report) -> list[str]:
    """One line for every stored number that differs from `report` by more than its tolerance."""
    found = []
    for sheet in report.sheets:
        path = directory / csv_name(report, sheet)
        if sheet.is_file and not path.is_file():
            found.append(f"{path}: missing")
        elif sheet.is_file:
            text = path.read_text(encoding="utf-8", errors="replace")
            found += [f"{path}:{line}" for line in _differences(text, sheet)]
    return found


def _differences(text: str, sheet: Sheet) -> Iterator[str]:
    names = [one.name for one in sheet.written]
    header, *stored = list(csv.reader(io.StringIO(text))) or [[]]
    if header != names or any(len(line) != len(names) for line in stored):
        yield f"1: its columns are not {','.join(names)}"
    elif len(stored) != len(sheet.items):
        yield f"1: {len(stored)} rows are stored, now there are {len(sheet.items)}"
    else:
        for number, (words, item) in enumerate(zip(stored, sheet.items, strict=True), start=2):
            ignored = sheet.is_round_off(item, dict(zip(names, words, strict=True)))
            for column, word in zip(sheet.written, words, strict=True):
                is_compared = column.within is not None and column.name not in ignored
                now = column.of(item)
                if is_compared and not _agree(word, now, column.within or Within()):
                    yield f"{number}: {column.name}: {word} is stored, now {as_word(now)}"


def _agree(word: str, now: Value, within: Within) -> bool:
    if not isinstance(now, float):
        return word == as_word(now)
    try:
        return within.holds(float(word), now)
    except ValueError:
        return False
