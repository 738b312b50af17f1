"""Samples from a CSV file, with complaints that name its lines."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.keys.complaints import excerpt, listed, suggestion
from fvi_cli.scenes.records.data_files import (
    DataFileError,
    check_lines,
    number_of,
    read_content,
)
from fvi_cli.scenes.records.samples import MOST_SAMPLES

LARGEST_FILE: Final = 20_000_000
MOST_MISTAKES: Final = 5
_DELIMITERS: Final = (",", ";", "\t")


@dataclass(frozen=True, kw_only=True, eq=False)
class CsvSamples:
    """Two columns of a file.

    Parameters
    ----------
    time, values
        As they stand in the file, shape ``(n,)``.
    sha256
        Of the bytes of the file.
    lines
        The line of every sample, counted from 1.
    """

    time: NDArray[np.float64]
    values: NDArray[np.float64]
    sha256: str
    lines: tuple[int, ...] = ()


def read_csv_samples(path: Path, name: str, time_column: str, column: str) -> CsvSamples:
    """Read a column and its times.

    The first line holds the names of the columns; between them stand commas, semicolons or
    tabulators. Empty lines and lines that begin with ``#`` are left out.

    Raises
    ------
    DataFileError
        ``<name>:<line>: what is wrong``: no such file or column, cells that are empty or not
        finite numbers, times that do not increase, or more than is allowed.
    """
    content = read_content(path, name, LARGEST_FILE)
    check_lines(content, name)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise DataFileError(f"{name}:{line}: not UTF-8; save the file as UTF-8") from None
    rows = _rows(text, name)
    line, header = next(rows, (1, []))
    places = [_place(header, wanted, f"{name}:{line}") for wanted in (time_column, column)]
    mistakes = _Mistakes(name=name)
    found: list[tuple[float, ...]] = []
    lines: list[int] = []
    for line, row in rows:
        if len(found) == MOST_SAMPLES:
            mistakes.add(line, f"more than {MOST_SAMPLES} samples are too many; thin them out")
            break
        cells = [row[place].strip() if place < len(row) else "" for place in places]
        numbers = tuple(number_or_nan(cell) for cell in cells)
        wrong = False
        for label, cell, number in zip((time_column, column), cells, numbers, strict=True):
            if not math.isfinite(number):
                mistakes.add(line, _complaint(label, cell))
                wrong = True
        if wrong:
            continue
        if found and not numbers[0] > found[-1][0]:
            mistakes.add(
                line,
                f"{time_column} = {numbers[0]:g} is not after {found[-1][0]:g} in line "
                f"{lines[-1]}; times must increase",
            )
            continue
        found.append(numbers)
        lines.append(line)
    if not found and not mistakes.messages:
        mistakes.add(line, "no samples below the names of the columns")
    mistakes.raise_if_any()
    table = np.array(found)
    return CsvSamples(
        time=table[:, 0],
        values=table[:, 1],
        sha256=hashlib.sha256(content).hexdigest(),
        lines=tuple(lines),
    )


def _rows(text: str, name: str) -> Iterator[tuple[int, list[str]]]:
    """Number and cells of every line that holds something; the first are the names."""
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
    """The number that a cell holds; nan where it holds none."""
    try:
        return number_of(cell)
    except ValueError:
        return math.nan


def _complaint(label: str, cell: str) -> str:
    if not cell:
        return f"column {label!r} is empty; every sample needs a value"
    bare = cell.replace(",", ".")
    hint = f"; write {bare}" if bare != cell and math.isfinite(number_or_nan(bare)) else ""
    return f"column {label!r} holds {excerpt(cell)!r}; it must be a finite number{hint}"


@dataclass(kw_only=True)
class _Mistakes:
    """The first mistakes of a file, and how many more there are."""

    name: str
    messages: list[str] = field(default_factory=list)
    more: int = 0

    def add(self, line: int, message: str) -> None:
        if len(self.messages) < MOST_MISTAKES:
            self.messages.append(f"{self.name}:{line}: {message}")
        else:
            self.more += 1

    def raise_if_any(self) -> None:
        if self.more:
            self.messages.append(f"{self.name}: and {self.more} more mistakes")
        if self.messages:
            raise DataFileError(*self.messages)
