"""Samples from CSV files and accelerograms, with complaints that name lines."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import (
    MOST_SAMPLES,
    DataFileError,
    check_lines,
    parse_number,
    read_content,
)

LARGEST_FILE: Final = 20_000_000
MOST_MISTAKES: Final = 5
MOST_HEADERS: Final = 100
"""Rows among which the names of the columns are looked for."""
SPREADSHEETS: Final = (".xlsx", ".xls", ".xlsm", ".ods", ".numbers")
NO_TEXT: Final = "not a text but a spreadsheet; save the sheet as CSV with a line of names"
_ARCHIVE: Final = b"PK\x03\x04"
"""First bytes of a file of a spreadsheet program."""
_OTHER_FORMATS: Final = (
    (re.compile(r"\s*Origin Time\b"), "K-NET"),
    (re.compile(r".*\bCOSMOS\b", re.IGNORECASE), "COSMOS"),
    (re.compile(r"\s*\d?\s*(UN)?CORRECTED ACCEL", re.IGNORECASE), "SMC or a Volume 2 file"),
)
"""First lines of records that are not read, and the names of their formats."""
_MISSING: Final = ("-", "nan", "n/a", "na", "null", "none", "inf")


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


Row = tuple[int, list[str]]
"""Line number, from 1, and cells."""


def read_csv_samples(
    path: Path, name: str, time_column: str, column: str, *, decimal: str = "."
) -> CsvSamples:
    """Read a column and its times as :func:`read_csv_columns`; times must increase."""
    columns = (time_column, column)
    found = read_csv_columns(path, name, columns, increasing=time_column, decimal=decimal)
    time, values = found.table.T
    return CsvSamples(time=time, values=values, lines=found.lines)


def read_csv_columns(
    path: Path, name: str, columns: tuple[str, ...], *, increasing: str = "", decimal: str = "."
) -> CsvColumns:
    """Read columns of numbers; with `increasing`, the name of the first column, that must increase.

    Cells are separated by commas, semicolons or tabulators. Empty lines, lines that begin with
    ``#``, lines above the names of the columns and a line of units below them are left out.

    Raises
    ------
    DataFileError
        With messages ``<name>:<line>: ...``: no such file or column, cells that are empty or not
        finite numbers, more cells than names, times that do not increase, or too many samples.
    """
    rows = _rows(_text_of(path, name), name, decimal)
    names = _names(rows[:MOST_HEADERS], columns, decimal)
    line, header = rows[names]
    places = [_place(header, wanted, f"{name}:{line}") for wanted in columns]
    body = rows[names + 1 :]
    if body and _is_units(body[0][1]):
        body = body[1:]
    if len(body) > MOST_SAMPLES:
        message = f"more than {MOST_SAMPLES} samples are too many; thin them out"
        raise DataFileError(f"{name}:{body[MOST_SAMPLES][0]}: {message}")
    mistakes: list[str] = []
    found: list[tuple[float, ...]] = []
    lines: list[int] = []
    for line, row in body:
        if any(cell.strip() for cell in row[len(header) :]):
            message = f"{len(row)} cells, but {len(header)} names of columns"
            raise DataFileError(f"{name}:{line}: {message}")
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        numbers = tuple(_number(cell, decimal) for cell in cells)
        wrong = [
            _complaint(label, cell, decimal)
            for label, cell, number in zip(columns, cells, numbers, strict=True)
            if not math.isfinite(number)
        ]
        is_number = not wrong
        if increasing and found and is_number and not numbers[0] > found[-1][0]:
            # compare with the previous line only, so that one wrong time is one mistake
            wrong = [_order(increasing, numbers[0], found[-1][0], lines[-1])]
        mistakes += [f"{name}:{line}: {one}" for one in wrong]
        if is_number:
            found.append(numbers)
            lines.append(line)
    if not found and not mistakes:
        mistakes = [f"{name}:{line}: no samples below the names of the columns"]
    if mistakes:
        more = len(mistakes) - MOST_MISTAKES
        rest = [f"{name}: and {more} more mistakes"] if more > 0 else []
        raise DataFileError(*mistakes[:MOST_MISTAKES], *rest)
    return CsvColumns(table=np.array(found), lines=tuple(lines))


def _text_of(path: Path, name: str) -> str:
    """The text of a file; refuses spreadsheets and records of other formats."""
    content = read_content(path, name, LARGEST_FILE)
    if path.suffix.lower() in SPREADSHEETS or content.startswith(_ARCHIVE):
        raise DataFileError(f"{name}: {NO_TEXT}")
    check_lines(content, name)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DataFileError(f"{name}:{line}: not UTF-8; save the file as UTF-8") from None
    _refuse_other_formats(text, name)
    return text


def _refuse_other_formats(text: str, name: str) -> None:
    first = text.lstrip().partition("\n")[0]
    for begin, other in _OTHER_FORMATS:
        if begin.match(first):
            raise DataFileError(
                f"{name}: a record in the format of {other}; convert it to CSV, or to AT2 in g"
            )


def _rows(text: str, name: str, decimal: str) -> list[Row]:
    """Every line that is neither empty nor a comment, cut at the delimiter of the numbers."""
    lines = [one for one in io.StringIO(text) if one.strip() and not one.startswith("#")]
    body = lines[len(lines) // 2 :][:20]
    delimiter = next((one for one in "\t;" if all(one in line for line in body)), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        found = [
            (reader.line_num, row)
            for row in reader
            if any(cell.strip() for cell in row) and not row[0].startswith("#")
        ]
    except csv.Error as error:
        raise DataFileError(f"{name}:{reader.line_num}: {error}") from None
    if not found:
        raise DataFileError(f"{name}:1: the file is empty; it needs a line of names and samples")
    return found


def _names(rows: Sequence[Row], columns: Sequence[str], decimal: str) -> int:
    """Which row has the names: the first with all that are wanted, else the one to complain of."""
    cells = [[cell.strip() for cell in row] for _, row in rows]
    for k, row in enumerate(cells):
        if set(columns) <= set(row):
            return k
    samples = (k for k, row in enumerate(cells) if math.isfinite(_number(row[0], decimal)))
    above = range(max(next(samples, 1), 1))
    return max(above, key=lambda k: len(cells[k]))


def _is_units(row: Sequence[str]) -> bool:
    """Whether a row below the names holds units: words, and neither numbers nor missing values."""
    words = [cell.strip() for cell in row if cell.strip()]
    return all(
        word.lower() not in _MISSING and (word[0].isalpha() or word[0] in "([%°") for word in words
    )


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


def _number(cell: str, decimal: str = ".") -> float:
    """The number in a cell; nan for any other cell."""
    if decimal == ",":
        # a point beside decimal commas separates thousands, or is a mistake
        cell = "" if "." in cell else cell.replace(",", ".")
    try:
        return parse_number(cell)
    except ValueError:
        return math.nan


def _complaint(label: str, cell: str, decimal: str) -> str:
    if not cell:
        return f"column {label!r} is empty; every sample needs a value"
    has_comma = decimal == "." and math.isfinite(_number(cell, ","))
    hint = "; for decimal commas write decimal: ','" if has_comma else ""
    return f"column {label!r} holds {excerpt(cell)!r}; it must be a finite number{hint}"


def _order(label: str, time: float, before: float, line: int) -> str:
    if time == before:
        return (
            f"{label} = {time:g} is the time of line {line} too; write times with more digits, or "
            "one line for each"
        )
    return f"{label} = {time:g} is not after {before:g} in line {line}; sort the lines"


SUFFIX: Final = ".at2"
HEADER_LINES: Final = 5
LONGEST_LINE: Final = 300
"""Most characters of the header line with NPTS and DT; records have some 80."""
_REAL: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_NAMED: Final = re.compile(rf"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*({_REAL})", re.IGNORECASE)
_BEFORE: Final = re.compile(rf"(\d+)\s+({_REAL})\s+NPTS\s*,\s*DT", re.IGNORECASE)
# fixed columns leave no blank before a minus sign
_TOUCHING: Final = re.compile(r"(?<=[\d.])(?<![eE])(?=[-+])")
_MOTION: Final = re.compile(r"\b(VELOCITY|DISPLACEMENT)\b", re.IGNORECASE)


def read_at2_samples(path: Path, name: str) -> CsvSamples:
    """Read a record: times k DT, and the accelerations in the file, in units of g.

    Up to five lines of header, the last of which has ``NPTS= 4000, DT= .0050 SEC`` (older files:
    ``4000 0.0050 NPTS, DT``), then NPTS numbers, several in a line.
    """
    content = read_content(path, name, LARGEST_FILE)
    check_lines(content, name)
    text = content.decode("latin-1")
    _refuse_other_formats(text, name)
    lines = text.splitlines()
    heads = [line if len(line) <= LONGEST_LINE else "" for line in lines[:HEADER_LINES]]
    every = [(k, _NAMED.search(one) or _BEFORE.search(one)) for k, one in enumerate(heads, 1)]
    last, found = next(((k, one) for k, one in every if one), (0, None))
    if found is None:
        raise DataFileError(
            f"{name}:1: NPTS= and DT= are missing in the first {HEADER_LINES} lines; a record in "
            "AT2 has them in the last line of its header"
        )
    for number, line in enumerate(heads[:last], start=1):
        if other := _MOTION.search(line):
            raise DataFileError(
                f"{name}:{number}: a record of the {other[0].lower()} of the ground; give that of "
                "its acceleration"
            )
    count, step = int(found[1]), float(found[2])
    if not (step > 0 and 2 <= count <= MOST_SAMPLES and math.isfinite(count * step)):
        raise DataFileError(
            f"{name}:{last}: {excerpt(found[1])} samples {step:g} apart are not allowed; "
            f"there must be 2 to {MOST_SAMPLES}, a positive time apart"
        )
    values: list[float] = []
    for number, line in enumerate(lines[last:], start=last + 1):
        for word in _TOUCHING.sub(" ", line).split():
            values.append(_number(word))
            if not math.isfinite(values[-1]):
                raise DataFileError(
                    f"{name}:{number}: {excerpt(word)!r} is not a finite number; below the "
                    "header only accelerations are allowed"
                )
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
        raise DataFileError(f"{name}:{last}: DT = {step:g} is too short")
    return CsvSamples(time=time, values=np.array(values))
