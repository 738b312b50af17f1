"""Samples from CSV files and accelerograms, with complaints that name lines."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import (
    MOST_SAMPLES,
    DataFileError,
    check_lines,
    parse_number,
    read_content,
)

LARGEST_FILE: Final = 20_000_000
MOST_MISTAKES: Final = 5
_DELIMITERS: Final = (",", ";", "\t")
_ARCHIVE: Final = b"PK\x03\x04"
"""First bytes of a file of a spreadsheet program."""
SPREADSHEETS: Final = (".xlsx", ".xls", ".xlsm", ".ods", ".numbers")
NO_TEXT: Final = "not a text but a spreadsheet; save the sheet as CSV, names of columns in line 1"


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvColumns:
    """Columns of numbers."""

    table: NDArray[np.float64]  # numbers in the order of the file, shape ``(n, columns)``
    lines: tuple[int, ...] = ()  # the line of every row, counted from 1


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvSamples:
    """Times and values of a file."""

    time: NDArray[np.float64]  # times in the order of the file, shape ``(n,)``
    values: NDArray[np.float64]
    lines: tuple[int, ...] = ()  # the line of every sample, counted from 1


def read_csv_samples(path: Path, name: str, time_column: str, column: str) -> CsvSamples:
    """Read a column and its times as :func:`read_csv_columns`; times must increase."""
    found = read_csv_columns(path, name, (time_column, column), increasing=time_column)
    time, values = found.table.T
    return CsvSamples(time=time, values=values, lines=found.lines)


def read_csv_columns(
    path: Path, name: str, columns: tuple[str, ...], *, increasing: str = ""
) -> CsvColumns:
    """Read columns of numbers; with `increasing`, the name of the first column, that must increase.

    The first line holds the names of the columns, separated by commas, semicolons or tabulators.
    Empty lines and lines that begin with ``#`` are ignored.

    Raises
    ------
    DataFileError
        With messages ``<name>:<line>: ...``: no such file or column, cells that are empty or not
        finite numbers, more cells than names, times that do not increase, or too many samples.
    """
    if path.suffix.lower() in SPREADSHEETS:
        raise DataFileError(f"{name}: {NO_TEXT}")
    content = read_content(path, name, LARGEST_FILE)
    check_lines(content, name)
    if content.startswith(_ARCHIVE):
        raise DataFileError(f"{name}: {NO_TEXT}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DataFileError(f"{name}:{line}: not UTF-8; save the file as UTF-8") from None
    rows = _rows(text, name)
    line, header = next(rows, (1, []))
    places = [_place(header, wanted, f"{name}:{line}") for wanted in columns]
    # the first mistakes only
    mistakes: list[str] = []
    count = 0
    found: list[tuple[float, ...]] = []
    lines: list[int] = []
    for line, row in rows:
        if any(cell.strip() for cell in row[len(header) :]):
            message = f"{len(row)} cells, but {len(header)} names of columns"
            raise DataFileError(f"{name}:{line}: {message}")
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        numbers = tuple(number_or_nan(cell) for cell in cells)
        wrong = [
            _complaint(label, cell)
            for label, cell, number in zip(columns, cells, numbers, strict=True)
            if not math.isfinite(number)
        ]
        is_number = not wrong
        if len(found) == MOST_SAMPLES:
            wrong = [f"more than {MOST_SAMPLES} samples are too many; thin them out"]
        elif increasing and found and is_number and not numbers[0] > found[-1][0]:
            # compare with the previous line only, so that one wrong time is one mistake
            wrong = [
                f"{increasing} = {numbers[0]:g} is not after {found[-1][0]:g} in line "
                f"{lines[-1]}; sort the lines, times must increase"
            ]
        count += len(wrong)
        mistakes += [f"{name}:{line}: {one}" for one in wrong[: MOST_MISTAKES - len(mistakes)]]
        if len(found) == MOST_SAMPLES:
            break
        if is_number:
            found.append(numbers)
            lines.append(line)
    if not found and not mistakes:
        mistakes = [f"{name}:{line}: no samples below the names of the columns"]
    if count > MOST_MISTAKES:
        mistakes.append(f"{name}: and {count - MOST_MISTAKES} more mistakes")
    if mistakes:
        raise DataFileError(*mistakes)
    return CsvColumns(table=np.array(found), lines=tuple(lines))


def _rows(text: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """(Line number, cells) of every line that is not empty; the first has the names."""
    first = next((line for line in io.StringIO(text) if line.strip() and line[0] != "#"), "")
    delimiter = max(_DELIMITERS, key=first.count)
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        for row in reader:
            if any(cell.strip() for cell in row) and not row[0].startswith("#"):
                yield reader.line_num, row
    except csv.Error as error:
        raise DataFileError(f"{name}:{reader.line_num}: {error}") from None


def _place(header: list[str], wanted: str, where: str) -> int:
    names = [cell.strip() for cell in header]
    if names.count(wanted) == 1:
        return names.index(wanted)
    if wanted in names:
        raise DataFileError(f"{where}: {names.count(wanted)} columns are called {wanted!r}")
    shown = [excerpt(name) for name in names[:10]]
    raise DataFileError(
        f"{where}: no column is called {excerpt(wanted)!r}{suggestion(wanted, shown)} "
        f"(columns: {listed(shown)}{', ...' if len(names) > len(shown) else ''})"
    )


def number_or_nan(cell: str) -> float:
    """The number in a cell; nan for any other cell."""
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan


def _complaint(label: str, cell: str) -> str:
    if not cell:
        return f"column {label!r} is empty; every sample needs a value"
    return f"column {label!r} holds {excerpt(cell)!r}; it must be a finite number"


SUFFIX: Final = ".at2"
HEADER_LINES: Final = 4
LONGEST_LINE: Final = 300
"""Most characters of the header line with NPTS and DT; records have some 80."""
_NUMBER: Final = r"([-+]?\d*\.?\d+(?:[eE][-+]?\d+)?)"
_NAMED: Final = re.compile(rf"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*{_NUMBER}", re.IGNORECASE)
_BEFORE: Final = re.compile(rf"(\d+)\s+{_NUMBER}\s+NPTS\s*,\s*DT", re.IGNORECASE)


def read_at2_samples(path: Path, name: str) -> CsvSamples:
    """Read a record: times k DT, and the accelerations in the file, in units of g.

    Four lines of header, the last of which has ``NPTS= 4000, DT= .0050 SEC`` (older files:
    ``4000 0.0050 NPTS, DT``), then NPTS numbers, several in a line.
    """
    content = read_content(path, name, LARGEST_FILE)
    check_lines(content, name)
    lines = content.decode("latin-1").splitlines()
    header = "\n".join(line for line in lines[:HEADER_LINES] if len(line) <= LONGEST_LINE)
    found = _NAMED.search(header) or _BEFORE.search(header)
    if found is None:
        raise DataFileError(
            f"{name}:{HEADER_LINES}: NPTS= and DT= are missing in the first {HEADER_LINES} lines; "
            "a record in AT2 has them in its fourth line"
        )
    count, step = int(found[1]), float(found[2])
    if not (step > 0 and 2 <= count <= MOST_SAMPLES and math.isfinite(count * step)):
        raise DataFileError(
            f"{name}:{HEADER_LINES}: {excerpt(found[1])} samples {step:g} apart are not allowed; "
            f"there must be 2 to {MOST_SAMPLES}, a positive time apart"
        )
    values: list[float] = []
    for number, line in enumerate(lines[HEADER_LINES:], start=HEADER_LINES + 1):
        for word in line.split():
            value = number_or_nan(word)
            if not math.isfinite(value):
                raise DataFileError(
                    f"{name}:{number}: {excerpt(word)!r} is not a finite number; below the "
                    "header only accelerations are allowed"
                )
            values.append(value)
        if len(values) > count:
            break
    if len(values) != count:
        there = f"more than {count}" if len(values) > count else str(len(values))
        raise DataFileError(
            f"{name}:{len(lines)}: {there} accelerations where the header says NPTS = "
            f"{count}; the record is cut off or has a gap"
        )
    digits = len(found[2].partition(".")[2]) if "e" not in found[2].lower() else 12
    time = np.round(step * np.arange(count), digits)
    if not np.all(np.diff(time) > 0):
        raise DataFileError(f"{name}:{HEADER_LINES}: DT = {step:g} is too short")
    return CsvSamples(time=time, values=np.array(values))
