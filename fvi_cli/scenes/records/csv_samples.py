"""Columns of numbers from CSV files, and accelerograms; complaints name lines."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from decimal import Decimal as Exact
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.errors import excerpt, listed, suggestion
from fvi_cli.scenes.keys.values import key
from fvi_cli.scenes.records.inputs import DataFileError, read_text

Decimal = Literal[".", ","]
DECIMAL: Final = key("What begins the decimals: a point, or a comma.", ".")

_OTHER_FORMATS: Final = (
    (re.compile(r"PK\x03\x04"), "a spreadsheet"),
    (re.compile(r"\s*Origin Time\b"), "a record in the format of K-NET"),
    (re.compile(r".*\bCOSMOS\b", re.IGNORECASE), "a record in the format of COSMOS"),
    (
        re.compile(r"\s*\d?\s*(UN)?CORRECTED ACCEL", re.IGNORECASE),
        "a record in the format of SMC or a Volume 2 file",
    ),
)
"""Beginnings of files that are not read."""
_MISSING: Final = ("nan", "n/a", "na", "null", "none", "inf")


Table = tuple[NDArray[np.float64], Sequence[int]]
"""Columns of numbers, ``(n, columns)``, and the line of every row, counted from 1."""


def read_csv_samples(
    path: Path, name: str, time_column: str, column: str, *, decimal: str = "."
) -> Table:
    """Read times, which must increase, and a column as :func:`read_csv_columns`."""
    table, lines = read_csv_columns(path, name, (time_column, column), decimal=decimal)
    time = table[:, 0]
    for k in np.flatnonzero(np.diff(time) <= 0).tolist():
        how = "is the time of" if time[k + 1] == time[k] else f"is before the {time[k]:g} of"
        words = f"{time_column} = {time[k + 1]:g} {how} line {lines[k]}; times must increase"
        raise DataFileError(f"{name}:{lines[k + 1]}: {words}")
    return table, lines


def read_csv_columns(path: Path, name: str, columns: Sequence[str], *, decimal: str = ".") -> Table:
    """Read columns of numbers.

    Cells are separated by commas, semicolons or tabulators. Empty lines, lines that begin with
    ``#``, lines above the names of the columns and a line of units below them are left out.

    Raises
    ------
    DataFileError
        As ``<name>:<line>: ...``: no such file or column, a cell that is empty or not a finite
        number, or more cells than names.
    """
    rows = _rows(_text_of(path, name), name)
    named = (k for k, (_, row) in enumerate(rows) if {*columns} <= {*row})
    start = next(named, max(range(len(rows)), key=lambda k: len(rows[k][1])))
    first, header = rows[start]
    places = [_place(header, wanted, f"{name}:{first}") for wanted in columns]
    body = rows[start + 1 :]
    if body and _is_units(body[0][1]):
        del body[0]
    if not body:
        raise DataFileError(f"{name}:{first}: no samples below the names of the columns")
    found = np.empty((len(body), len(columns)))
    for number, (line, row) in enumerate(body):
        if any(row[len(header) :]):
            words = f"{len(row)} cells, but {len(header)} names of columns"
            raise DataFileError(f"{name}:{line}: {words}")
        for k, place in enumerate(places):
            cell = row[place] if place < len(row) else ""
            found[number, k] = _number(cell, decimal)
            if not math.isfinite(found[number, k]):
                raise DataFileError(f"{name}:{line}: {_complaint(columns[k], cell, decimal)}")
    return found, [line for line, _ in body]


def _text_of(path: Path, name: str, encoding: str = "utf-8-sig") -> str:
    """The text of a file; refuses other formats by their names."""
    text = read_text(path, name, encoding)
    first = text[:1000].lstrip().partition("\n")[0]
    for begin, other in _OTHER_FORMATS:
        if begin.match(first):
            raise DataFileError(f"{name}: {other}; save it as CSV with a line of names, or as AT2")
    return text


def _rows(text: str, name: str) -> list[tuple[int, list[str]]]:
    """Line and cells of every line that is neither empty nor a comment."""
    lines = [one for one in io.StringIO(text) if one.strip() and not one.startswith("#")]
    # the numbers tell the delimiter: names and units may hold commas
    body = lines[len(lines) // 2 :][:20]
    delimiter = next((one for one in "\t;" if all(one in line for line in body)), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter)
    try:
        found = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    except csv.Error as error:
        raise DataFileError(f"{name}:{reader.line_num}: {error}") from None
    found = [(line, row) for line, row in found if any(row) and not row[0].startswith("#")]
    if not found:
        raise DataFileError(f"{name}:1: the file is empty; it needs a line of names and samples")
    return found


def _is_units(row: Sequence[str]) -> bool:
    """Whether a row below the names holds units: words, and neither numbers nor missing values."""
    words = [cell for cell in row if cell]
    return all(
        word.lower() not in _MISSING and (word[0].isalpha() or word[0] in "([%°") for word in words
    )


def _place(header: Sequence[str], wanted: str, where: str) -> int:
    if header.count(wanted) == 1:
        return header.index(wanted)
    shown = [excerpt(one) for one in header[:10]]
    words = f"{header.count(wanted) or 'no'} columns are called {excerpt(wanted)!r}"
    words += f"{suggestion(wanted, shown)} (columns: {listed(shown)})"
    raise DataFileError(f"{where}: {words}")


def _number(cell: str, decimal: str = ".") -> float:
    """The number in a cell; nan for any other cell."""
    if decimal == ",":
        # a point beside decimal commas separates thousands, or is a mistake
        cell = "" if "." in cell else cell.replace(",", ".")
    try:
        # Python also accepts 1_000
        return math.nan if "_" in cell else float(cell)
    except ValueError:
        return math.nan


def _complaint(label: str, cell: str, decimal: str) -> str:
    has_comma = decimal == "." and math.isfinite(_number(cell, ","))
    hint = "; for decimal commas write decimal: ','" if has_comma else ""
    return f"column {label!r} holds {excerpt(cell)!r}; it must be a finite number{hint}"


SUFFIX: Final = ".at2"
HEADER_LINES: Final = 5
_REAL: Final = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"
_COUNTS: Final = (
    re.compile(rf"NPTS\s*=\s*(\d+)\s*,?\s*DT\s*=\s*({_REAL})", re.IGNORECASE),
    re.compile(rf"(\d+)\s+({_REAL})\s+NPTS\s*,\s*DT", re.IGNORECASE),
)
# fixed columns leave no blank before a minus sign
_TOUCHING: Final = re.compile(r"(?<=[\d.])(?<![eE])(?=[-+])")
_MOTION: Final = re.compile(r"\b(VELOCITY|DISPLACEMENT)\b", re.IGNORECASE)


def read_at2_samples(path: Path, name: str) -> NDArray[np.float64]:
    """Read a record, ``(n, 2)``: times k DT, and the accelerations in the file, in units of g.

    Up to five lines of header, the last of which has ``NPTS= 4000, DT= .0050 SEC`` (older files:
    ``4000 0.0050 NPTS, DT``), then NPTS numbers, several in a line.
    """
    lines = _text_of(path, name, "latin-1").splitlines()
    for last, line in enumerate(lines[:HEADER_LINES], start=1):
        if other := _MOTION.search(line):
            motion = f"a record of the {other[0].lower()} of the ground"
            raise DataFileError(f"{name}:{last}: {motion}; give that of its acceleration")
        if found := _COUNTS[0].search(line[:300]) or _COUNTS[1].search(line[:300]):
            break
    else:
        raise DataFileError(
            f"{name}:1: NPTS= and DT= are missing in the first {HEADER_LINES} lines; a record in "
            "AT2 has them in the last line of its header"
        )
    count, step = int(found[1]), Exact(found[2])
    if count < 2 or not 0 < float(step) < math.inf:
        words = f"{count} samples {step} apart; two or more are needed, a positive time apart"
        raise DataFileError(f"{name}:{last}: {words}")
    values: list[float] = []
    for number, line in enumerate(lines[last:], start=last + 1):
        for word in _TOUCHING.sub(" ", line).split():
            values.append(_number(word))
            if not math.isfinite(values[-1]):
                raise DataFileError(
                    f"{name}:{number}: {excerpt(word)!r} is not a finite number; below the "
                    "header only accelerations are allowed"
                )
    if len(values) != count:
        raise DataFileError(
            f"{name}:{len(lines)}: {len(values)} accelerations where the header says NPTS = "
            f"{count}; the record is cut off or has a gap"
        )
    return np.column_stack([[float(k * step) for k in range(count)], values])
