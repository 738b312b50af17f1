"""A sweep from the command line: few lines, all members stored, resumed, listed and exported."""

import json
import re

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


@pytest.mark.few(1)
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
    planned = fvi("run", "many.yaml", "--dry-run", *more)
    assert re.search(r"reuse +\S.*, 2 members", planned)
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
