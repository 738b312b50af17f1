"""Tables are compared with what is stored: what means something is told, and nothing else."""

import dataclasses
import math
import re
import tempfile
from pathlib import Path
from typing import Any

import pytest
from made_runs import BDF2, STEPS, made_run, one_case, powers, row, table_of

from fvi_cli import reports
from fvi_cli.errors import StorageError
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.studies.experiment import FinishedRun, Run
from fvi_cli.studies.order import OrderTable

BASE = table_of()
SMALL = one_case(row(2, 0.25), row(4, 0.0625), row(8, math.nan))
FORMS = ("csv", "md", "text.tex", "tex", "runs.tex", "json")


def write(directory: Path, made: OrderTable) -> list[Path]:
    return reports.write(directory, order_report("made-up", [made]))


def compare(directory: Path, made: OrderTable) -> list[str]:
    """What differs, a line for each, behind what the file has behind the name."""
    found = reports.compare(directory, order_report("made-up", [made]))
    return [line.removeprefix(f"{directory}/made-up")[1:] for line in found]


def one_way(stored: OrderTable, fresh: OrderTable) -> list[str]:
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder), stored)
        for ending in ("tex", "json"):
            (Path(folder) / f"made-up.{ending}").unlink()
        return compare(Path(folder), fresh)


def differences(stored: OrderTable, fresh: OrderTable) -> str:
    found = one_way(stored, fresh)
    # what differs differs whichever is stored
    assert bool(found) == bool(one_way(fresh, stored))
    return "\n".join(found)


def edit(path: Path, old: str, new: str, count: int = 1) -> None:
    text = path.read_bytes().decode()
    assert old in text
    path.write_bytes(text.replace(old, new, count).encode())


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.iterdir()}


# --- files ----------------------------------------------------------------------------------------


def test_all_files_are_written_and_nothing_else_is_left(tmp_path):
    directory = tmp_path / "results" / "tables"
    for _ in range(2):
        paths = write(directory, SMALL)
    assert [path.suffix for path in paths] == [".csv", ".md", ".tex", ".tex", ".tex", ".json"]
    assert sorted(directory.iterdir()) == sorted(paths)
    made = reports.rendered(order_report("made-up", [SMALL]))
    assert {path.name: path.read_bytes().decode() for path in paths} == made
    assert {path.stat().st_mode & 0o444 for path in paths} == {
        (tmp_path / "results").stat().st_mode & 0o444
    }


def test_a_write_that_fails_leaves_the_old_file_whole(tmp_path, monkeypatch):
    write(tmp_path, SMALL)
    before = contents(tmp_path)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("fvi_cli.storage.atomic.os.fsync", full)
    with pytest.raises(StorageError, match=r"made-up\.csv: cannot be written: No space"):
        write(tmp_path, BASE)
    assert contents(tmp_path) == before


def test_files_that_agree_are_left_as_they_are(tmp_path):
    write(tmp_path, BASE)
    (tmp_path / "made-up.tex").unlink()
    before = contents(tmp_path)
    written = write(tmp_path, altered(error=0.25 * 1.0001))
    assert {path: path.read_bytes() for path in before} == before
    assert all(path.is_file() for path in written)
    # control: what does not agree is replaced
    write(tmp_path, altered(error=0.25 * 1.01))
    assert (tmp_path / "made-up.csv").read_bytes() != before[tmp_path / "made-up.csv"]


@pytest.mark.parametrize("form", ["csv", "md"])
def test_a_missing_file_is_told_and_nothing_is_written(tmp_path, form):
    write(tmp_path, BASE)
    (tmp_path / f"made-up.{form}").unlink()
    before = sorted(tmp_path.iterdir())
    assert compare(tmp_path, BASE) == [f"{form}: missing"]
    assert sorted(tmp_path.iterdir()) == before
    assert len(compare(tmp_path / "nowhere", BASE)) == 2
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize(
    ("form", "old", "new", "told"),
    [
        ("csv", ",0.25,0.25,", ",0.25,0.251,", "error: 0.251 is stored, now 0.25"),
        ("csv", ",1.0,yes,", ",1.1,yes,", "pairwise_order: 1.1 is stored; its own rows give 1.0"),
        ("csv", ",yes,", ",no,", "used_in_fit: False is stored, now True"),
        ("csv", ",yes,", ",maybe,", "used_in_fit: 'maybe' is stored, now True"),
        ("csv", ",0.25,0.25,", ",0.25,a,", "error: 'a' is stored, now 0.25"),
        ("csv", ",0.25,0.25,", ",0.25,0.25,,", "20 fields"),
        ("csv", ",status", ",state", "columns"),
        ("md", "2.50e-01", "2.51e-01", "2.51e-01"),
        ("tex", "toprule", "midrule", "midrule"),
        ("runs.tex", r"\cdot", r"\times", r"\\times"),
        ("md", "T = 1", "T = 2", "T = 2"),
        ("json", '"error": 0.25', '"error": 0.26', "error: 0.26 is stored, now 0.25"),
        ("json", "{", "", "cannot be read"),
        ("json", '"format": 2', '"format": 1', "format: 1 is not 2"),
    ],
)
def test_a_change_of_any_file_is_told(tmp_path, form, old, new, told):
    write(tmp_path, BASE)
    path = next(p for p in tmp_path.iterdir() if p.name in (f"made-up.{form}", f"made-up-{form}"))
    edit(path, old, new)
    lines = compare(tmp_path, BASE)
    assert any(line.startswith(f"{form}: ") and told in line for line in lines), lines


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            lambda lines: lines[:-1],
            "made-up: bdf2-nodes-s1-gauss1-none: n_steps = 16: not stored",
        ),
        (lambda lines: [*lines, lines[-1]], "1 rows are given twice"),
    ],
)
def test_a_row_that_is_cut_off_or_stands_twice_is_told(tmp_path, change, told):
    write(tmp_path, BASE)
    path = tmp_path / "made-up.csv"
    path.write_text("".join(change(path.read_text().splitlines(keepends=True))))
    assert compare(tmp_path, BASE) == [f"csv: {told}"]


@pytest.mark.parametrize("slope", [1.011, 7.0, math.nan])
@pytest.mark.parametrize("is_near_the_floor", [False, True])
def test_a_slope_that_does_not_belong_to_its_rows_is_told(tmp_path, slope, is_near_the_floor):
    made = near_the_floor(1.0) if is_near_the_floor else BASE
    write(tmp_path, made)
    edit(tmp_path / "made-up.csv", f",{made.cases[0].slope!r},", f",{slope},", -1)
    told = [line for line in compare(tmp_path, made) if f"slope: {slope} is stored" in line]
    assert len(told) == len(STEPS)


# --- values ---------------------------------------------------------------------------------------


def altered(made: OrderTable = BASE, at: int = 1, **changes: Any) -> OrderTable:
    """The table with a row of its first case changed."""
    rows = list(made.cases[0].rows)
    rows[at] = dataclasses.replace(rows[at], **changes)
    return with_case(made, rows=tuple(rows))


def with_case(made: OrderTable = BASE, **changes: Any) -> OrderTable:
    case = dataclasses.replace(made.cases[0], **changes)
    return dataclasses.replace(made, cases=(case, *made.cases[1:]))


def with_table(**changes: Any) -> OrderTable:
    return dataclasses.replace(BASE, **changes)


ROW = "csv: made-up: bdf1-nodes-s1-gauss1-none: n_steps = 4: "


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (altered(error=0.25 * 1.0011), f"{ROW}error: 0.250275 is stored, now 0.25"),
        (altered(error=math.nan), f"{ROW}error: nan is stored"),
        (altered(status="floor"), f"{ROW}status: 'floor' is stored, now 'ok'"),
        (altered(predicted="unstable"), f"{ROW}predicted: 'unstable' is stored"),
        (altered(expected_order=1.5), f"{ROW}expected_order: 1.5 is stored"),
        (altered(expected_order=math.nan), f"{ROW}expected_order: nan is stored"),
        (altered(step_size=0.2501), f"{ROW}step_size: 0.2501 is stored"),
        (altered(remarks=("no start series",)), r"md: line \d+.*no start series"),
        (with_case(claim=1.0), "stated"),
        (with_case(expected_failure=True), "expects failures"),
        (with_case(rows=BASE.cases[0].rows[:-1]), "n_steps = 16: not stored"),
        (with_table(norm="l2"), "norm"),
        (with_table(gamma="0.5"), "gamma"),
        (with_table(equation="x = 0"), "Equation: `x = 0`"),
        (with_table(reference="closed form"), "closed form"),
        (with_table(final_time=2.0), "T = 2"),
        (
            with_table(experiment="another"),
            "another: bdf1-nodes-s1-gauss1-none: n_steps = 2: stored, but",
        ),
        (
            with_table(cases=BASE.cases[:1]),
            "bdf2-nodes-s1-gauss1-none: n_steps = 2: not stored",
        ),
        (with_table(cases=BASE.cases[::-1]), "order"),
    ],
)
def test_every_change_of_a_table_is_told(changed, told):
    assert re.search(told, differences(changed, BASE))


def remarked(number: str) -> OrderTable:
    made = altered(remarks=(f"less than 4 steps of {number}",))
    return dataclasses.replace(made, reference=f"refined run (estimated error {number})")


def slow(run: Run) -> FinishedRun:
    return made_run(run, powers(run).error, expected_order=powers(run).expected_order, **SECONDS)


SECONDS = {"setup_seconds": 9.0, "stepping_seconds": 99.0}


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (BASE, BASE),
        (BASE, altered(error=0.25 * 1.0009)),
        (BASE, altered(floor=2e-13)),
        # numbers of remarks and references, and timings
        (remarked("1.1e-16"), remarked("0.3")),
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
        return made_run(run, error, floor=floor, expected_order=exact.expected_order)

    return table_of(make)


def test_errors_near_the_floor_may_differ_and_the_slopes_through_them(tmp_path):
    one, other = near_the_floor(1.0), near_the_floor(1.3)
    assert abs(one.cases[0].slope - other.cases[0].slope) > 0.01
    assert differences(one, other) == ""
    # below 1000 floors it is used for no slope, which tells nothing either
    below = near_the_floor(0.6)
    assert not below.cases[0].rows[-1].used_in_fit
    assert math.isnan(below.cases[0].pairwise_order(len(STEPS) - 1))
    assert differences(one, below) == ""
    write(tmp_path, below)
    edit(tmp_path / "made-up.csv", ",no,", ",yes,", -1)
    told = "used_in_fit: True is stored; its own rows give False"
    assert told in "\n".join(compare(tmp_path, one))
    # control: an error above 2000 floors in one of the two is reliable
    assert "error" in differences(one, near_the_floor(2.1))
    # control: the errors of the others are compared all the same
    changed = altered(one, 0, error=0.5 * 1.1)
    assert "n_steps = 2: error: 0.55 is stored, now 0.5" in differences(changed, one)


def diverging(error: float, status: str = "diverged") -> OrderTable:
    return one_case(row(2, 0.5), row(4, error, status=status), row(8, math.nan, status="failed"))


def test_how_far_a_run_diverged_is_not_compared_but_that_it_did_is():
    assert differences(diverging(3e25), diverging(7e31)) == ""
    assert "status" in differences(diverging(3e25), diverging(3e25, "failed"))


def test_another_bound_of_the_same_errors_is_no_difference(tmp_path):
    """Floors by a refined run have other digits on other machines; words have not."""

    def near(floor: float) -> OrderTable:
        def make(run: Run) -> FinishedRun:
            return made_run(run, 1e-10 * (run.n_steps == 16) + 1.0 / run.n_steps**9, floor=floor)

        return table_of(make, BDF2)

    stored = near(1.3e-13)
    write(tmp_path, stored)
    assert "(below 1.3e-10)" in (tmp_path / "made-up.md").read_text()
    assert compare(tmp_path, near(1.6e-13)) == []
    for name in ("made-up.md", "made-up-runs.tex"):
        edit(tmp_path / name, "(below", "(above", -1)
        assert compare(tmp_path, stored)
        edit(tmp_path / name, "(above", "(below", -1)
