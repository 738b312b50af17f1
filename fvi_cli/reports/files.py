"""Write the files of a report, and compare its stored rows with what the program makes now."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from fvi_cli.reports.table import Report, Row, Sheet, Value, Within
from fvi_cli.reports.writers import as_value, as_word, csv_name, read_csv, rendered
from fvi_cli.storage.files import explain_os_error, replace_file

Key = tuple[str, ...]


def write(directory: Path, report: Report) -> list[Path]:
    """Write the files of a report into `directory`: their paths.

    All are made before the first is written, and each appears whole or not at all.

    Raises
    ------
    StorageError
        If the folder or a file cannot be written.
    """
    texts = {directory / name: text for name, text in rendered(report).items()}
    with explain_os_error(directory):
        directory.mkdir(parents=True, exist_ok=True)
    for place, text in texts.items():
        with explain_os_error(place):
            replace_file(place, text.encode("utf-8"))
    return list(texts)


def compare(directory: Path, report: Report) -> list[str]:
    """One line for every stored row that differs from `report`, within each column's tolerance."""
    found = []
    for sheet in report.sheets:
        path = directory / csv_name(report, sheet)
        if sheet.is_file and not path.is_file():
            found.append(f"{path}: missing")
        elif sheet.is_file:
            text = path.read_text(encoding="utf-8", errors="replace")
            found += [f"{path}: {line}" for line in _differences(text, sheet)]
    return found


def _differences(text: str, sheet: Sheet) -> Iterator[str]:
    names, lines = read_csv(text)
    columns = sheet.written
    if names != [one.name for one in columns] or any(len(line) != len(names) for line in lines):
        yield f"its columns are not {','.join(one.name for one in columns)}"
        return
    rows = [dict(zip(names, line, strict=True)) for line in lines]
    fresh = {_key(row, sheet): row for row in sheet.rows}
    stored = {tuple(row[name] for name in sheet.keys): row for row in rows}
    if len(stored) < len(rows):
        yield f"{len(rows) - len(stored)} rows are given twice"
    left = (key for key in stored if key not in fresh)
    yield from (f"{_place(key)}: stored, but not computed now" for key in left)
    for key, row in fresh.items():
        if key not in stored:
            yield f"{_place(key)}: not stored"
            continue
        old = {name: _read(word, row[name]) for name, word in stored[key].items()}
        left_out = sheet.below_floor(old, row)
        for one in columns:
            found, now = old[one.name], row[one.name]
            is_compared = one.compared is not None and one.name not in left_out
            if is_compared and not _agree(found, now, one.compared or Within()):
                yield f"{_place(key)}: {one.name}: {found!r} is stored, now {now!r}"


def _key(row: Row, sheet: Sheet) -> Key:
    columns = {one.name: one for one in sheet.columns}
    return tuple(as_word(row[name], columns[name]) for name in sheet.keys)


def _place(key: Key) -> str:
    return ": ".join(filter(None, key))


def _read(word: str, like: Value) -> Value:
    return None if like is None and not word else as_value(word, like)


def _agree(one: Value, other: Value, within: Within) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return within.holds(one, other)
    return type(one) is type(other) and one == other
