"""Whether stored tables are those that the program makes now."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TypeVar

from fvi_cli.reports.details import without_numbers
from fvi_cli.reports.files import rendered, table_paths
from fvi_cli.reports.json_table import from_json
from fvi_cli.studies.order import NEAR_FLOOR, OrderCase, OrderRow, OrderTable, fit_slope, is_usable

ERROR_TOLERANCE = 1e-3
"""Relative, for errors that are reliable."""

SLOPE_TOLERANCE = 0.01

RELIABLE = 2 * NEAR_FLOOR
"""Errors above this many floors are the same on every machine, to :data:`ERROR_TOLERANCE`.

Twice the limit below which rows are used for no order, so that an error beside that limit may lie
on either side of it.
"""

SAME_NUMBER = 1e-9
"""Relative, for numbers that do not depend on round-off: step sizes, expected orders."""

T = TypeVar("T")


def compare_with_tables(directory: Path, name: str, tables: Sequence[OrderTable]) -> list[str]:
    """One line for everything in which the files of `name` differ from `tables`.

    The JSON form is compared with `tables`, number by number (:func:`compare_tables`); the others
    must be, letter by letter, what is made of the numbers in the JSON form. So a change in any of
    the four is found, while another machine's round-off is not taken for a change.

    Parameters
    ----------
    directory
        Folder of the tables.
    name
        Name of the configuration.
    tables
        What the program makes now.

    Returns
    -------
    list of str
        Empty when the files are up to date.
    """
    paths = table_paths(directory, name)
    differences = [f"{path}: missing" for path in paths.values() if not path.is_file()]
    source = paths["json"]
    if not source.is_file():
        return differences
    try:
        stored = from_json(source.read_text(encoding="utf-8"))
    except (ValueError, OSError) as error:
        return [*differences, f"{source}: cannot be read: {error}"]
    differences += [f"{source}: {line}" for line in compare_tables(stored, tables)]
    for form, text in rendered(name, stored).items():
        path = paths[form]
        if not path.is_file():
            continue
        try:
            # without translation of line ends: they are part of the file
            found = path.read_bytes().decode("utf-8")
        except (ValueError, OSError) as error:
            differences.append(f"{path}: cannot be read: {error}")
            continue
        if found != text:
            compare = _compare_csv if form == "csv" else _compare_lines
            lines = list(compare(found, text, source.name)) or ["differs in quotes or line ends"]
            differences += [f"{path}: {line}" for line in lines]
    return differences


def compare_tables(stored: Sequence[OrderTable], fresh: Sequence[OrderTable]) -> list[str]:
    """One line for everything in which two lists of tables differ.

    Experiments, cases, rows, statuses and ``used_in_fit`` must be the same, and everything that is
    no measurement. Errors may differ by :data:`ERROR_TOLERANCE` where one is above
    :data:`RELIABLE` floors, and at will where none is; nor do ``ok`` and ``floor``, or whether a
    slope uses the row, tell anything there. Slopes may differ by :data:`SLOPE_TOLERANCE`; where
    rows below :data:`RELIABLE` floors took part in a fit, slopes are compared that are fitted to
    the others. Errors of runs that came to nothing say only how fast round-off grew: their status
    is compared. Numbers inside texts are ignored, and so are messages.
    """
    lines: list[str] = []
    old, new = ({table.title: table for table in tables} for tables in (stored, fresh))
    lines += _presence("experiment", old, new)
    for experiment in _common(old, new):
        lines += [f"{experiment}: {line}" for line in _tables(old[experiment], new[experiment])]
    if not lines and list(old) != list(new):
        lines.append("experiments are in another order")
    return lines


def _tables(stored: OrderTable, fresh: OrderTable) -> Iterator[str]:
    yield from _texts(stored, fresh, ("equation", "gamma", "norm"))
    if without_numbers(stored.reference) != without_numbers(fresh.reference):
        yield _differ("reference", stored.reference, fresh.reference)
    if not _close(stored.final_time, fresh.final_time, SAME_NUMBER):
        yield _differ("final time", stored.final_time, fresh.final_time)
    old, new = ({case.method.case: case for case in table.cases} for table in (stored, fresh))
    yield from _presence("case", old, new)
    for name in _common(old, new):
        yield from (f"{name}: {line}" for line in _cases(old[name], new[name]))
    if set(old) == set(new) and list(old) != list(new):
        yield "cases are in another order"


def _cases(stored: OrderCase, fresh: OrderCase) -> Iterator[str]:
    old, new = ({row.n_steps: row for row in case.rows} for case in (stored, fresh))
    yield from _presence("row N =", old, new)
    for n_steps in _common(old, new):
        yield from (f"N = {n_steps}: {line}" for line in _rows(old[n_steps], new[n_steps]))
    if stored.columns() != fresh.columns():
        yield _differ("method", stored.columns(), fresh.columns())
    if not _close(stored.claim, fresh.claim, SAME_NUMBER):
        yield _differ("stated", stored.claim, fresh.claim)
    if stored.expected_failure != fresh.expected_failure:
        yield _differ("expected failure", stored.expected_failure, fresh.expected_failure)
    used = [n for n, row in old.items() if row.used_in_fit]
    # whatever the rows: a slope belongs to the rows beside it
    own = _slope([old[n] for n in used])
    if not _near(stored.slope, own, SLOPE_TOLERANCE):
        yield f"slope: {stored.slope!r} is stored; its own rows give {own!r}"
    reliable = [n for n in used if n in new and _is_reliable(old[n]) and _is_reliable(new[n])]
    if not all(new[n].used_in_fit for n in reliable):
        return  # told above, row by row; slopes through other rows are other slopes
    slopes, what = (stored.slope, fresh.slope), "slope"
    if reliable != used or used != [n for n, row in new.items() if row.used_in_fit]:
        what = f"slope of the {len(reliable)} rows above {RELIABLE:g} floors"
        slopes = (_slope([old[n] for n in reliable]), _slope([new[n] for n in reliable]))
    if not _near(*slopes, SLOPE_TOLERANCE):
        yield _differ(what, *slopes)


def _slope(rows: Sequence[OrderRow]) -> float:
    return fit_slope([row.n_steps for row in rows], [row.error for row in rows])[0]


def _is_reliable(row: OrderRow) -> bool:
    return row.error > RELIABLE * row.floor


def _rows(stored: OrderRow, fresh: OrderRow) -> Iterator[str]:
    yield from _texts(stored, fresh, ("predicted",))
    is_round_off = all(
        row.status in ("ok", "floor") and row.error <= RELIABLE * row.floor
        for row in (stored, fresh)
    )
    if not is_round_off:
        yield from _texts(stored, fresh, ("status", "used_in_fit"))
    elif stored.used_in_fit != is_usable(stored.status, stored.error, stored.floor):
        yield f"used_in_fit: {stored.used_in_fit!r} is stored; its error and floor say otherwise"
    for name in ("step_size", "expected_order"):
        old, new = getattr(stored, name), getattr(fresh, name)
        if not _close(old, new, SAME_NUMBER):
            yield _differ(name, old, new)
    if stored.status == fresh.status and stored.status in ("ok", "floor"):
        is_reliable = _is_reliable(stored) or _is_reliable(fresh)
        if math.isnan(stored.error) != math.isnan(fresh.error) or (
            is_reliable and not _close(stored.error, fresh.error, ERROR_TOLERANCE)
        ):
            yield _differ("error", stored.error, fresh.error)
    old_remarks, new_remarks = (
        sorted(without_numbers(text) for text in row.remarks) for row in (stored, fresh)
    )
    if old_remarks != new_remarks:
        yield _differ("remarks", "; ".join(stored.remarks), "; ".join(fresh.remarks))


def _texts(stored: object, fresh: object, names: Sequence[str]) -> Iterator[str]:
    for name in names:
        old, new = getattr(stored, name), getattr(fresh, name)
        if old != new:
            yield _differ(name, old, new)


def _differ(what: str, stored: object, fresh: object) -> str:
    return f"{what}: {stored!r} is stored, now {fresh!r}"


def _presence(what: str, stored: Mapping[T, object], fresh: Mapping[T, object]) -> Iterator[str]:
    for key in stored:
        if key not in fresh:
            yield f"{what} {key}: stored, but not there now"
    for key in fresh:
        if key not in stored:
            yield f"{what} {key}: not stored"


def _common(stored: Mapping[T, object], fresh: Mapping[T, object]) -> list[T]:
    return [key for key in stored if key in fresh]


def _close(one: float, other: float, relative: float) -> bool:
    """Whether two numbers agree; nan with nan, an infinity with itself."""
    if math.isnan(one) or math.isnan(other):
        return math.isnan(one) and math.isnan(other)
    return math.isclose(one, other, rel_tol=relative, abs_tol=0.0)


def _near(one: float, other: float, absolute: float) -> bool:
    if math.isnan(one) or math.isnan(other):
        return math.isnan(one) and math.isnan(other)
    return one == other or abs(one - other) <= absolute


def _compare_csv(found: str, text: str, source: str) -> Iterator[str]:
    old, new = (list(csv.reader(io.StringIO(one, newline=""))) for one in (found, text))
    columns = new[0]
    if not old or old[0] != columns:
        yield f"its columns are not {','.join(columns)}"
        return
    if len(old) != len(new):
        yield f"{len(old) - 1} rows; {source} has {len(new) - 1}"
    n_steps = columns.index("n_steps")
    for row, expected in zip(old[1:], new[1:], strict=False):
        if len(row) != len(columns):
            yield f"{len(row)} fields in {row}"
            continue
        for column, one, other in zip(columns, row, expected, strict=True):
            if one != other:
                place = f"{expected[0]}: {expected[1]}: N = {expected[n_steps]}"
                yield f"{place}: {column}: {one!r}; {source} has {other!r}"


def _compare_lines(found: str, text: str, source: str) -> Iterator[str]:
    for k, (one, other) in enumerate(zip_longest(found.split("\n"), text.split("\n")), start=1):
        if one != other:
            yield f"line {k}: {one!r}; {source} gives {other!r}"
            return
