"""Whether stored files are those that the program makes now."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

from fvi_cli.reports.document import Block, blank_rough
from fvi_cli.reports.table import Report, Row, Sheet, Value, Within
from fvi_cli.reports.writers import csv_name
from fvi_cli.reports.writers.data import FORMAT, as_value, as_word, csv_columns, read_csv
from fvi_cli.reports.writers.latex import to_latex
from fvi_cli.reports.writers.markdown import to_markdown

MOST_LINES = 50
"""Differences of one file that are told one by one."""

FOLLOWS = Within(relative=1e-6, absolute=1e-6)
"""For stored numbers that follow from other stored ones: slopes from errors."""

_MARK = "\u00fe\u00fe\u00fe"
"""Stands for a number that is not compared, and needs no escape in any form."""

_NUMBER = r"(?:\d+(?:\.\d+)?(?:e[+-]?\d+)?)"

_SHOWN = re.compile(rf"(?<![\w.])[+-]?{_NUMBER}")
"""A number with its sign; digits inside of names are none."""

Key = tuple[str, ...]


def missing(directory: Path, name: str) -> list[str]:
    """One line for each file that is not there and without which nothing can be compared."""
    needed = (directory / f"{name}.csv", directory / f"{name}.md")
    return [f"{path}: missing" for path in needed if not path.is_file()]


def compare(directory: Path, report: Report) -> list[str]:
    """One line for everything in which stored files differ from `report`.

    Every row of the CSV files is compared with the fresh one, column by column, as far as the
    column asks for it, and what follows from other numbers must follow from those beside it. The
    words of the Markdown form must be, letter by letter, those on the stored numbers. The LaTeX and
    JSON forms are compared where they are there.

    Parameters
    ----------
    directory
        Folder of the files.
    report
        What the program makes now.

    Returns
    -------
    list of str
        Empty when the files are up to date.
    """
    differences: list[str] = []
    expected: Report | None = None
    for sheet in report.sheets:
        path = directory / csv_name(report, sheet)
        text = _read(path, differences) if sheet.is_file else None
        if text is None:
            continue
        lines, rows = _csv(text, sheet, is_part=report.is_part)
        if sheet is report.sheets[0] and rows is not None and report.with_rows is not None:
            try:
                expected = report.with_rows(rows)
                lines += _own(rows, expected.sheets[0], lines)
            except ValueError as error:
                lines.append(str(error))
        differences += _first_lines(path, lines)
    for ending, write in ((".md", to_markdown), (".tex", to_latex)):
        path = directory / f"{report.name}{ending}"
        text = _read(path, differences, is_needed=ending == ".md")
        if text is not None and not report.is_part:
            differences += _first_lines(path, list(_words(text, report, expected, write)))
    path = directory / f"{report.name}.json"
    text = _read(path, differences, is_needed=False)
    if text is not None:
        differences += _first_lines(path, _json(text, report))
    return differences


def _read(path: Path, differences: list[str], *, is_needed: bool = True) -> str | None:
    if not path.is_file():
        differences += [f"{path}: missing"] * is_needed
        return None
    try:
        return path.read_text(encoding="utf-8")
    except (ValueError, OSError) as error:
        differences.append(f"{path}: cannot be read: {error}")
        return None


def _first_lines(path: Path, lines: Sequence[str]) -> list[str]:
    more = [f"and {len(lines) - MOST_LINES} more"] if len(lines) > MOST_LINES else []
    return [f"{path}: {line}" for line in (*lines[:MOST_LINES], *more)]


def _csv(text: str, sheet: Sheet, *, is_part: bool) -> tuple[list[str], list[Row] | None]:
    """What differs, and the stored rows in the order of the fresh ones, if all are there."""
    names, lines = read_csv(text)
    columns = csv_columns(sheet)
    if names != [column.name for column in columns]:
        return [f"its columns are not {','.join(column.name for column in columns)}"], None
    wrong = [line for line in lines if len(line) != len(columns)]
    if wrong:
        return [f"{len(line)} fields in {line}" for line in wrong], None
    fresh = {
        tuple(as_word(row[c.name], c) for c in columns if c.name in sheet.keys): row
        for row in sheet.rows
    }
    stored: dict[Key, Row] = {}
    for line in lines:
        key = tuple(w for w, c in zip(line, columns, strict=True) if c.name in sheet.keys)
        like = fresh.get(key, {})
        stored[key] = {
            c.name: None if w == c.missing and known is None else as_value(w, known)
            for w, c, known in zip(line, columns, (like.get(c.name) for c in columns), strict=True)
        }
    twice = len(lines) - len(stored)
    messages = [f"{twice} rows stand in it twice"] if twice else []
    if is_part:
        stored = {key: stored[key] for key in fresh if key in stored}
    messages += _rows(stored, fresh, sheet)
    return messages, [stored[key] for key in fresh] if fresh.keys() <= stored.keys() else None


def _json(text: str, report: Report) -> list[str]:
    try:
        content = json.loads(text)
        if content["format"] != FORMAT:
            return [f"format: {content['format']!r} is not {FORMAT}"]
        lines: list[str] = []
        for sheet in report.sheets:
            columns = [c for c in sheet.columns if c.name in sheet.keys]
            fresh = {tuple(as_word(row[c.name], c) for c in columns): row for row in sheet.rows}
            stored = {}
            for row in content["sheets"][sheet.name]["rows"]:
                key = tuple(as_word(row[c.name], c) for c in columns)
                stored[key] = {n: _number(v, fresh.get(key, {}).get(n)) for n, v in row.items()}
            if report.is_part:
                stored = {key: stored[key] for key in fresh if key in stored}
            lines += _rows(stored, fresh, sheet)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        return [f"cannot be read: {type(error).__name__}: {error}"]
    return lines


def _number(value: Value, like: Value) -> Value:
    if not isinstance(like, float) or isinstance(value, bool):
        return value
    return math.nan if value is None else as_value(str(value), like)


def _rows(stored: Mapping[Key, Row], fresh: Mapping[Key, Row], sheet: Sheet) -> Iterator[str]:
    keys = [column.name for column in sheet.columns if column.name in sheet.keys]
    yield from (
        f"{_place(keys, key)}: stored, but not there now" for key in stored if key not in fresh
    )
    yield from (f"{_place(keys, key)}: not stored" for key in fresh if key not in stored)
    for key, row in fresh.items():
        old = stored.get(key)
        if old is not None:
            free = sheet.left_to_round_off(old, row)
            for column in sheet.columns:
                name = column.name
                if name not in old or name in free or column.compared is None:
                    continue
                if not _agree(old[name], row[name], column.compared):
                    yield f"{_place(keys, key)}: {name}: {old[name]!r} is stored, now {row[name]!r}"
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


def _own(rows: Sequence[Row], expected: Sheet, messages: Sequence[str]) -> list[str]:
    """Numbers that do not follow from those beside them, unless they are told already."""
    lines = []
    keys = [column.name for column in expected.columns if column.name in expected.keys]
    for stored, row in zip(rows, expected.rows, strict=True):
        for column in csv_columns(expected):
            one, other = stored[column.name], row[column.name]
            if not _agree(one, other, FOLLOWS):
                columns = {c.name: c for c in expected.columns}
                place = _place(keys, tuple(as_word(row[k], columns[k]) for k in keys))
                start = f"{place}: {column.name}: {one!r} is stored"
                if not any(line.startswith(start) for line in messages):
                    lines.append(f"{start}; its own rows give {other!r}")
    return lines


def _words(
    found: str, report: Report, expected: Report | None, write: Callable[[Sequence[Block]], str]
) -> Iterator[str]:
    """The first line that is another one."""
    blocks = (expected or report).blocks
    text = write(blocks)
    if found == text:
        return
    if expected is None:
        pairs = zip_longest(_squeezed(found), _squeezed(text), fillvalue="")
        differs: Callable[[str, str], bool] = partial(
            _numbers_differ, compared=list(_compared(report))
        )
    else:
        pairs = zip_longest(
            found.split("\n"), write(blank_rough(blocks, _MARK)).split("\n"), fillvalue=""
        )
        differs = _is_other
    shown = text.split("\n")
    for k, (one, other) in enumerate(pairs):
        if differs(one, other):
            now = shown[k] if k < len(shown) else ""
            yield f"line {k + 1}: {one!r}; {now!r} belongs to the numbers"
            return


def _is_other(found: str, pattern: str) -> bool:
    # of a range whose ends are shown alike there is one number
    escaped = re.escape(pattern.replace(f"{_MARK} to {_MARK}", _MARK))
    return not re.fullmatch(escaped.replace(_MARK, f"{_NUMBER}(?: to {_NUMBER})?"), found)


def _squeezed(text: str) -> list[str]:
    """Lines without the blanks and rules that depend on how long their entries are.

    Powers of ten are written as everywhere else.
    """
    plain = re.sub(r"\\cdot10\^\{(-?\d+)\}", r"e\1", text)
    return [re.sub(r"-{2,}", "--", re.sub(r" +", " ", line)) for line in plain.split("\n")]


def _compared(report: Report) -> Iterator[tuple[float, Within | None]]:
    """Every finite number of the rows, and how far a stored one may be from it."""
    for sheet in report.sheets:
        for row in sheet.rows:
            for column in sheet.columns:
                value = row[column.name]
                if isinstance(value, int | float) and math.isfinite(value):
                    yield float(value), column.compared


def _numbers_differ(
    found: str, fresh: str, compared: Sequence[tuple[float, Within | None]]
) -> bool:
    """Whether two lines differ in words, or in a number by more than its column permits.

    A number that is in no column may differ by one and a half units of its last digit, a whole
    one not at all.
    """
    if found == fresh:
        return False
    if _SHOWN.sub(_MARK, found) != _SHOWN.sub(_MARK, fresh):
        return True
    pairs = zip(_SHOWN.findall(found), _SHOWN.findall(fresh), strict=True)
    return any(one != other and _is_another(one, other, compared) for one, other in pairs)


def _is_another(one: str, other: str, compared: Sequence[tuple[float, Within | None]]) -> bool:
    stored, now = float(one), float(other)
    unit = max(_last_unit(one), _last_unit(other))
    # of 0 no digit says which column it is from
    rules = [
        rule
        for value, rule in compared
        if value == now or (now and abs(value - now) <= 0.51 * unit < abs(now))
    ]
    if None in rules:
        return False
    known = [rule for rule in rules if rule is not None]
    if any(rule.holds(stored, now) for rule in known):
        return False
    is_whole = one.lstrip("+-").isdigit() and other.lstrip("+-").isdigit()
    return is_whole or abs(stored - now) > 1.5 * unit


def _last_unit(word: str) -> float:
    """What one unit of the last digit is worth."""
    digits, _, exponent = word.partition("e")
    return 10.0 ** (int(exponent or 0) - len(digits.partition(".")[2]))
