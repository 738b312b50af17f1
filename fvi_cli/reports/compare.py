"""Compare the stored files of a report with what the program makes now, and write new ones."""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from fvi_cli.reports.document import blank
from fvi_cli.reports.table import Column, Report, Row, Sheet, Value, Within
from fvi_cli.reports.writers import csv_name, forms, rendered
from fvi_cli.reports.writers.data import FORMAT, as_value, as_word, csv_columns, read_csv
from fvi_cli.storage.atomic import explain_os_error, replace_file

MOST_LINES = 50
"""Differences of one file that are reported one by one."""

FOLLOWS = Within(relative=1e-6, absolute=1e-6)
"""For stored numbers that follow from other stored ones: slopes from errors."""

_ANY, _NEAR = "\u00fe", "\u00ff"
"""Stand for digits that may differ: any number, or one that is equal up to its last digit.

They are for numbers that no file has in full, and need no escape in any form.
"""
_NUMBER = r"\d+(?:\.\d+)?(?:e[+-]?\d+)?"

Key = tuple[str, ...]


def missing(directory: Path, name: str) -> list[str]:
    """One line for each file that is not there and without which nothing can be compared."""
    needed = (directory / f"{name}.csv", directory / f"{name}.md")
    return [f"{path}: missing" for path in needed if not path.is_file()]


Differences = dict[Path, list[str]]
"""Lines by file; none for a file that is up to date."""


def compare(directory: Path, report: Report) -> list[str]:
    """One line for everything in which stored files differ from `report`.

    Every row of the CSV files is compared with the fresh one within the tolerance of each column.
    Numbers that follow from others must follow from those stored beside them. The Markdown and
    LaTeX forms must be, letter by letter, those that the stored rows make, but for numbers that no
    file has in full: they may differ in their last digit, and in all where they are round-off. The
    LaTeX and JSON forms are compared where they are there.
    """
    found, _ = compare_files(directory, report)
    return [line for path, lines in found.items() for line in _first_lines(path, lines)]


def compare_files(directory: Path, report: Report) -> tuple[Differences, Report]:
    """What :func:`compare` finds in each file, and the report that the files should hold.

    Where the stored rows agree with the fresh ones it is the report on the stored rows.
    """
    found: Differences = {}
    stored: dict[str, dict[Key, Row]] = {}
    paths = {one.name: directory / csv_name(report, one) for one in report.sheets if one.is_file}
    for sheet in report.sheets:
        if sheet.is_file and (text := _read(paths[sheet.name], found)) is not None:
            found[paths[sheet.name]], stored[sheet.name] = _csv(text, sheet)
    try:
        expected = report.on([_laid_over(one, stored) for one in report.sheets])
    except LookupError:
        expected = None  # a row or a file of them is missing
    except ValueError as error:
        found[next(iter(paths.values()))].append(str(error))
        expected = None
    for place, sheet in enumerate(report.sheets):
        if rows := stored.get(sheet.name):
            remade = None if expected is None else expected.sheets[place]
            found[paths[sheet.name]] += _differences(rows, sheet, remade, report)
    is_same = not any(found.values())
    blocks = (expected or report).blocks
    marked = forms(report.name, blank(blocks, _ANY, _NEAR))
    for file, fresh in forms(report.name, blocks).items():
        path = directory / file
        text = _read(path, found, is_needed=file.endswith(".md"))
        if text is not None and expected is not None:
            found[path] = list(_words(text, fresh, marked.get(file, fresh)))
    path = directory / f"{report.name}.json"
    text = _read(path, found, is_needed=False)
    if text is not None:
        found[path] = _json(text, report)
    return found, expected if expected is not None and is_same else report


def _laid_over(sheet: Sheet, stored: Mapping[str, Mapping[Key, Row]]) -> Sheet:
    """The sheet with its stored rows; columns that only the JSON form has stay fresh."""
    if not sheet.is_file:
        return sheet
    rows, fresh = stored[sheet.name], _fresh(sheet)
    return replace(sheet, rows=tuple({**row, **rows[key]} for key, row in fresh.items()))


def _read(path: Path, found: Differences, *, is_needed: bool = True) -> str | None:
    if not path.is_file():
        found[path] = ["missing"] if is_needed else []
        return None
    try:
        return path.read_text(encoding="utf-8")
    except (ValueError, OSError) as error:
        found[path] = [f"cannot be read: {error}"]
        return None


def _first_lines(path: Path, lines: Sequence[str]) -> list[str]:
    more = [f"and {len(lines) - MOST_LINES} more"] if len(lines) > MOST_LINES else []
    return [f"{path}: {line}" for line in (*lines[:MOST_LINES], *more)]


def _fresh(sheet: Sheet) -> dict[Key, Row]:
    """The rows of a sheet by what identifies them."""
    return {_key(row, sheet): row for row in sheet.rows}


def _key(row: Row, sheet: Sheet) -> Key:
    return tuple(as_word(row[one.name], one) for one in sheet.columns if one.name in sheet.keys)


def _stored(rows: Iterable[Row], sheet: Sheet) -> dict[Key, Row]:
    """Rows of a file by what identifies them, their values of the kinds of the fresh ones."""
    fresh, columns = _fresh(sheet), {column.name: column for column in sheet.columns}

    def value(found: Value, column: Column, like: Value) -> Value:
        if found is None and isinstance(like, float):
            return math.nan  # JSON has none
        word = as_word(found, column)
        return None if like is None and word == column.missing else as_value(word, like)

    return {
        key: {name: value(one, columns[name], like.get(name)) for name, one in row.items()}
        for row in rows
        for key in (_key(row, sheet),)
        for like in (fresh.get(key, {}),)
    }


def _csv(text: str, sheet: Sheet) -> tuple[list[str], dict[Key, Row]]:
    """What is wrong with a file, and the rows in it."""
    names, lines = read_csv(text)
    columns = [column.name for column in csv_columns(sheet)]
    if names != columns:
        return [f"its columns are not {','.join(columns)}"], {}
    wrong = [line for line in lines if len(line) != len(columns)]
    if wrong:
        return [f"{len(line)} fields in {line}" for line in wrong], {}
    rows = _stored((dict(zip(columns, line, strict=True)) for line in lines), sheet)
    twice = len(lines) - len(rows)
    return [f"{twice} rows are given twice"] if twice else [], rows


def _json(text: str, report: Report) -> list[str]:
    try:
        content = json.loads(text)
        if content["format"] != FORMAT:
            return [f"format: {content['format']!r} is not {FORMAT}"]
        return [
            line
            for sheet in report.sheets
            for rows in (_stored(content["sheets"][sheet.name]["rows"], sheet),)
            for line in _differences(rows, sheet, None, report)
        ]
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        return [f"cannot be read: {type(error).__name__}: {error}"]


def _differences(
    stored: Mapping[Key, Row], sheet: Sheet, remade: Sheet | None, report: Report
) -> Iterator[str]:
    """Stored numbers that differ from the fresh ones, or from those `remade` of stored ones."""
    names = [column.name for column in sheet.columns if column.name in sheet.keys]
    fresh = _fresh(sheet)
    yield from (
        f"{_place(names, key)}: stored, but not computed now" for key in stored if key not in fresh
    )
    yield from (f"{_place(names, key)}: not stored" for key in fresh if key not in stored)
    for place, (key, row) in enumerate(fresh.items()):
        old = stored.get(key, {})
        round_off = sheet.below_floor(old, row) if old else ()
        for column in (column for column in sheet.columns if column.name in old):
            found, now, within = old[column.name], row[column.name], column.compared
            given = found
            if remade is not None and column.follows:
                given = remade.rows[place][column.name]
            if within and column.name not in round_off and not _agree(found, now, within):
                words = f"is stored, now {now!r}"
            elif not _agree(found, given, FOLLOWS):
                words = f"is stored; its own rows give {given!r}"
            else:
                continue
            yield f"{_place(names, key)}: {column.name}: {found!r} {words}"
    if stored.keys() == fresh.keys() and list(stored) != list(fresh):
        yield "its rows are in another order"


def _place(keys: Sequence[str], words: Key) -> str:
    parts = (
        f"{name} = {word}" if re.fullmatch(_NUMBER, word) else word
        for name, word in zip(keys, words, strict=True)
    )
    return ": ".join(part for part in parts if part)


def _agree(one: Value, other: Value, within: Within) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return within.holds(one, other)
    return type(one) is type(other) and one == other


def _words(found: str, text: str, marked: str) -> Iterator[str]:
    """The first line that is another one; `marked` has marks for numbers that may differ."""
    if found == text:
        return
    lines = (map(_squeezed, one.split("\n")) for one in (found, text, marked))
    shown = text.split("\n")
    for k, (one, other, pattern) in enumerate(zip_longest(*lines, fillvalue="")):
        if not _is_same(one, other, pattern):
            now = shown[k] if k < len(shown) else ""
            yield f"line {k + 1}: {one!r}; {now!r} belongs to the numbers"
            return


def _squeezed(line: str) -> str:
    """The line without the blanks and rules that depend on how long its entries are.

    Powers of ten are written as everywhere else.
    """
    plain = re.sub(r"\$(-?[\d.]+)\$", r"\1", re.sub(r"\\cdot10\^\{(-?\d+)\}", r"e\1", line))
    plain = re.sub(r"\$(-?[\d.]+e-?\d+)\$", r"\1", plain)
    return re.sub(r"-{2,}", "--", re.sub(r" +", " ", plain))


def _is_same(found: str, fresh: str, marked: str) -> bool:
    """Whether two lines are the same but for the numbers that are marked in a third one."""
    # a range, "1.2 to 1.3", is shown as one number, "1.2", where its ends are shown alike
    pattern = re.sub(f"{_ANY}+ to {_ANY}+", _ANY, re.escape(marked).replace(r"\ ", " "))
    pattern = re.sub(f"{_ANY}+", lambda _: f"{_NUMBER}(?: to {_NUMBER})?", pattern)
    pattern = re.sub(f"{_NEAR}+", lambda _: f"({_NUMBER})", pattern)
    matches = [re.fullmatch(pattern, one) for one in (found, fresh)]
    if not all(matches):
        return found == fresh
    pairs = zip(*(match.groups() for match in matches if match), strict=True)
    return all(one == other or _is_near(one, other) for one, other in pairs)


def _is_near(one: str, other: str) -> bool:
    """Whether two numbers differ by one and a half units of their last digit at most."""
    unit = max(_last_unit(one), _last_unit(other))
    is_whole = one.isdigit() and other.isdigit()
    return not is_whole and abs(float(one) - float(other)) <= 1.5 * unit


def _last_unit(word: str) -> float:
    """What one unit of the last digit is worth."""
    digits, _, exponent = word.partition("e")
    return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))


_logger = logging.getLogger("fvi_cli")


def write(directory: Path, report: Report, *, anew: bool = False) -> list[Path]:
    """Bring CSV, Markdown, LaTeX and JSON of a report in `directory` up to date: their paths.

    Stored rows that agree with the fresh ones (:func:`compare`) stay, and with them every file that
    they make, byte for byte, unless all are wanted `anew`: round-off differs from machine to
    machine, and a file that is written for that alone would be a change without a reason. All are
    made before the first is written, and each appears whole or not at all.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    is_new = anew or report.is_timed
    found, kept = ({}, report) if is_new else compare_files(directory, report)
    stale = {path for path, lines in found.items() if lines}
    texts = {directory / name: text for name, text in rendered(kept).items()}
    if not is_new and not stale:
        _logger.info("%s: agrees with what is computed, left as it is", directory / report.name)
    with explain_os_error(directory):
        directory.mkdir(parents=True, exist_ok=True)
    for place, text in texts.items():
        with explain_os_error(place):
            # if rows changed all files are written, else those that do not belong to the rows
            if kept is report or place in stale or not place.is_file():
                replace_file(place, text.encode("utf-8"))
    return list(texts)
