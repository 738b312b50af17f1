"""Rows of tables are compared with what is stored: what means something is told, else nothing."""

import dataclasses
import math
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest
from made_runs import STEPS, made_run, one_case, powers, row, table_of

from fvi_cli import reports
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.order import OrderTable

BASE = table_of()


def write(directory: Path, made: OrderTable) -> list[Path]:
    return reports.write(directory, order_report("made-up", [made]))


def compare(directory: Path, made: OrderTable) -> list[str]:
    """What is told, without the folder."""
    told = reports.compare(directory, order_report("made-up", [made]))
    return [line.removeprefix(f"{directory}/made-up.") for line in told]


def differences(stored: OrderTable, made: OrderTable) -> str:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), stored)
        return "\n".join(compare(Path(folder), made))


# --- files ----------------------------------------------------------------------------------------


def test_a_missing_file_is_told_and_nothing_is_written(tmp_path):
    assert compare(tmp_path, BASE) == ["csv: missing"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda lines: lines[:-1], "7 rows are stored, now there are 8"),
        (lambda lines: [*lines, lines[-1]], "9 rows are stored, now there are 8"),
        (lambda lines: [*lines, "a,b\n"], "its columns are not experiment,case"),
        (lambda lines: ["a,b\n", *lines[1:]], "its columns are not experiment,case"),
        (lambda lines: [], "its columns are not experiment,case"),
    ],
)
def test_a_file_that_has_other_rows_or_columns_is_told(tmp_path, change, told):
    write(tmp_path, BASE)
    path = tmp_path / "made-up.csv"
    path.write_text("".join(change(path.read_text().splitlines(keepends=True))))
    (line,) = compare(tmp_path, BASE)
    assert line.startswith(f"csv:1: {told}")


def test_a_changed_digit_and_a_changed_status_are_told(tmp_path):
    """The control of the check, in the file itself."""
    write(tmp_path, BASE)
    path = tmp_path / "made-up.csv"
    text = path.read_text()
    for old, new, told in (
        (",0.25,0.25,", ",0.25,0.2511,", "csv:3: error: 0.2511 is stored, now 0.25"),
        (",ok,", ",failed,", "status: failed is stored, now ok"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1))
        (line,) = compare(tmp_path, BASE)
        assert told in line
        path.write_text(text)
    assert compare(tmp_path, BASE) == []


# --- values ---------------------------------------------------------------------------------------


def altered(made: OrderTable = BASE, at: int = 1, **changes: Any) -> OrderTable:
    """The table with a row of its first case changed."""
    rows = list(made.cases[0].rows)
    rows[at] = dataclasses.replace(rows[at], **changes)
    return with_case(made, rows=tuple(rows))


def with_case(made: OrderTable = BASE, **changes: Any) -> OrderTable:
    case = dataclasses.replace(made.cases[0], **changes)
    return dataclasses.replace(made, cases=(case, *made.cases[1:]))


ROW = "csv:3: "


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (altered(error=0.25 * 1.0011), f"{ROW}error: 0.250275 is stored, now 0.25"),
        (altered(error=math.nan), f"{ROW}error: nan is stored"),
        (altered(status="floor"), f"{ROW}status: floor is stored, now ok"),
        (altered(order_smooth=1.5), f"{ROW}order_smooth: 1.5 is stored"),
        (altered(order_smooth=math.nan), f"{ROW}order_smooth: nan is stored"),
        (with_case(rows=BASE.cases[0].rows[:-1]), "7 rows are stored, now there are 8"),
        (table_of(norm="l2"), "norm"),
        (table_of(name="another"), "experiment: another is stored, now made-up"),
        (dataclasses.replace(BASE, cases=BASE.cases[:1]), "4 rows are stored, now there are 8"),
    ],
)
def test_every_change_of_a_table_is_told(changed, told):
    assert re.search(told, differences(changed, BASE))


def slow(run: Run) -> FinishedRun:
    return made_run(run, powers(run).error, order_smooth=powers(run).order_smooth, **SECONDS)


SECONDS = {"seconds": 99.0, "remarks": ("no start series",)}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (BASE, BASE),
        (BASE, altered(error=0.25 * 1.0009)),
        (BASE, altered(floor=2e-13)),
        (BASE, table_of(slow)),
    ],
)
def test_changes_that_mean_nothing_are_not_told(one, other):
    assert differences(one, other) == ""


def near_the_floor(factor: float) -> OrderTable:
    """The finest error is 1500 floors; round-off may have changed it."""

    def make(run: Run) -> FinishedRun:
        last = run.n_steps == STEPS[-1]
        exact = powers(run)
        floor = exact.error / 1500 if last else 1e-13
        error = exact.error * (factor if last else 1.0)
        return made_run(run, error, floor=floor, order_smooth=exact.order_smooth)

    return table_of(make)


def test_errors_near_the_floor_may_differ_and_the_slopes_through_them():
    one, other = near_the_floor(1.0), near_the_floor(1.3)
    assert abs(one.cases[0].slope - other.cases[0].slope) > 0.01
    assert differences(one, other) == ""
    # control: an error above 2000 floors in one of the two is reliable
    assert "error" in differences(one, near_the_floor(2.1))
    # control: the errors of the others are compared all the same
    changed = altered(one, 0, error=0.5 * 1.1)
    assert "csv:2: error: 0.55 is stored, now 0.5" in differences(changed, one)


def diverging(error: float, status: str = "diverged") -> OrderTable:
    return one_case(row(2, 0.5), row(4, error, status=status), row(8, math.nan, status="failed"))


def test_how_far_a_run_diverged_is_not_compared_but_that_it_did_is():
    assert differences(diverging(3e25), diverging(7e31)) == ""
    assert "status" in differences(diverging(3e25), diverging(3e25, "failed"))
