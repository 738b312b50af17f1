"""A sweep from the command line: few lines, all members stored, resumed, listed and exported."""

import csv
import json

import command_line
import h5py
import pytest

CONFIG = (
    command_line.MANY
    + """\
method: {rk: gauss, degree: 2}
ladder: {steps: [4, 8, 16]}
sweep: {problem.stiffness: {from: 1, to: 4, number: 12}}
"""
)


@pytest.fixture
def fvi(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "many.yaml").write_text(CONFIG)

    def call(*arguments, expected=0):
        return command_line.fvi(*arguments, code=expected).stdout

    return call


def test_a_sweep_is_told_in_few_lines_unless_all_are_asked_for(fvi, tmp_path):
    lines = fvi("run", "many.yaml").splitlines()
    assert len(lines) == 1 + 3 + 1
    assert all("12" in line and "stiffness = 4" in line for line in lines[1:4])
    with h5py.File(tmp_path / "results" / "many.h5") as file:
        assert file["/many/gauss-s2-graded/n000016/position"].shape == (12, 17, 1)
    planned = fvi("run", "many.yaml", "--dry-run").splitlines()
    assert len(planned) == 1 + 3
    assert all("reuse 12 members" in line for line in planned[1:])
    assert sum("stiffness =" in line for line in fvi("run", "many.yaml", "-v").splitlines()) > 36


def test_members_that_are_missing_are_planned_and_computed(fvi):
    fvi("run", "many.yaml")
    longer = ("--set", "sweep.problem.stiffness.number=23")
    planned = fvi("run", "many.yaml", "--dry-run", *longer)
    # every other one of 23 equal steps is one of the 12
    assert planned.count("reuse 12 members") == 3
    assert planned.count("compute 11 members") == 3
    assert "  23  " in fvi("run", "many.yaml", *longer)
    assert "compute" not in fvi("run", "many.yaml", "--dry-run", *longer)


def test_a_stored_sweep_is_shown_tabled_drawn_and_exported(fvi, tmp_path):
    fvi("run", "many.yaml")
    shown = fvi("show", "results/many.h5")
    assert "many: 12 members, problem.stiffness = 1 ... 4 (12 values)" in shown
    fvi("convergence", "results/many.h5")
    fvi("convergence", "--check", "results/many.h5")
    with (tmp_path / "results" / "tables" / "many.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 36
    assert len({row["problem.stiffness"] for row in rows}) == 12
    fvi("plot", "results/many.h5")
    fvi("plot", "--check", "results/many.h5")
    assert (tmp_path / "results" / "figures" / "many-convergence.png").is_file()
    for form in ("csv", "npz", "mat"):
        fvi("export", "results/many.h5", "--to", form)


def test_a_mistake_in_a_sweep_is_told_and_nothing_is_computed(fvi, tmp_path):
    result = command_line.fvi("run", "many.yaml", "--set", "sweep.problem.stifness=[1]", code=2)
    assert "did you mean 'stiffness'" in result.stderr
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("times", "stop"),
    [
        ("[4.0]", False),
        ("[0.1, 0.7, 3.99]", True),
        pytest.param("[0.0]", True, marks=pytest.mark.slow),
        pytest.param("[0.7]", False, marks=pytest.mark.slow),
        pytest.param("[0, 4]", True, marks=pytest.mark.slow),
    ],
)
def test_a_sweep_stores_the_output_times_that_are_asked_for(fvi, tmp_path, times, stop):
    more = ["--set", f"output.times={times}", "--set", "sweep.problem.stiffness.number=2"]
    if stop:
        more += ["--set", "events={half: {when: x - 0.5, stop: true}}"]
    fvi("run", "many.yaml", *more)
    # a second command recalls what was stored
    assert "reuse 2 members" in fvi("run", "many.yaml", "--dry-run", *more)
    asked = json.loads(times)
    with h5py.File(tmp_path / "results" / "many.h5") as file:
        group = file["/many/gauss-s2-graded/n000016"]
        time, position = group["time"][()], group["position"][()]
    (tmp_path / "one.yaml").write_text(CONFIG.rpartition("sweep")[0])
    most = 0
    for member, stiffness in enumerate((1.0, 4.0)):
        own = ["--set", f"problem.stiffness={stiffness}", "-o", f"one{member}"]
        fvi("run", "one.yaml", *own, *more[:2], *more[4:])
        with h5py.File(tmp_path / f"one{member}" / "many.h5") as file:
            exact = file["/many/gauss-s2-graded/n000016/position"][()]
        most = max(most, len(exact))
        found = position[member, : len(exact)]
        assert found[: len(asked)] == pytest.approx(exact[: len(asked)], abs=1e-12)
    assert time[: len(asked)].tolist() == asked[: len(time)]
    assert len(time) == most
