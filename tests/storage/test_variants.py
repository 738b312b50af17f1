"""Runs of other values side by side in a file: listed, picked, exported, forgotten."""

import csv
import dataclasses
from pathlib import Path

import command_line
import h5py
import pytest

import fvi_cli as api
from fvi_cli.runner import compute
from fvi_cli.storage import list_runs

CONFIG = """\
name: quick
problem:
  kind: damped-oscillator
  initial: {position: 1.0}
  final_time: 1.0
method: {bdf: [1, 2], sampling: nodes}
ladder: {steps: [4, 8]}
"""
STIFF = ("--set", "problem.stiffness=2")
FILE = "results/quick.h5"


FILES = {"quick.yaml": CONFIG}
pytestmark = pytest.mark.usefixtures("folder")


def fvi(*arguments: object, code: int = 0):
    return command_line.fvi(*arguments, code=code)


def told(*arguments: str) -> str:
    return fvi("run", "quick.yaml", *arguments).stderr


def errors(*arguments: str) -> list[str]:
    """The errors in the table of orders."""
    fvi("convergence", *arguments, "--output", "made")
    with Path("made/tables/quick.csv").open() as file:
        return [row["error"] for row in csv.DictReader(file)]


def test_runs_of_other_values_stay_and_are_taken_again():
    assert "4 runs, 0 of them stored" in told()
    assert "4 runs, 0 of them stored" in told(*STIFF)
    assert "4 runs, 4 of them stored" in told()
    assert "4 runs, 4 of them stored" in told(*STIFF)
    listed = fvi("show", FILE).stdout
    assert listed.count("problem.stiffness = 1") == 4
    told()
    assert fvi("show", FILE).stdout.count("problem.stiffness = 2") == 4
    # a change of the text is a change like any other
    Path("quick.yaml").write_text(CONFIG.replace("position: 1.0", "position: 0.5"))
    assert "4 runs, 0 of them stored" in told()
    variants = {run.variant for run in list_runs(Path(FILE)).runs}
    assert variants == {
        "",
        "problem.initial.position = 1",
        "problem.initial.position = 1, problem.stiffness = 2",
    }


def test_a_file_stands_for_its_own_configuration_unless_other_values_are_set():
    told(*STIFF)
    told()
    assert errors(FILE) == errors("quick.yaml")
    stiff = errors("quick.yaml", *STIFF)
    assert stiff != errors("quick.yaml")
    told()
    assert errors(FILE, *STIFF) == stiff
    missing = fvi("convergence", FILE, "--set", "problem.stiffness=3", "--output", "made", code=2)
    assert "none of the 4 runs of quick can be used" in missing.stderr
    assert "changed: problem.stiffness" in missing.stderr
    wrong = fvi("convergence", FILE, "--set", "problem.stifness=3", code=2)
    assert "stiffness" in wrong.stderr


def test_what_is_asked_for_lies_where_the_contract_says_and_all_is_exported():
    told()
    told(*STIFF)
    with h5py.File(FILE) as file:
        case = "bdf1-nodes-s1-gauss1-none"
        (other,) = [name for name in file if name not in ("quick", "@index")]
        assert other.startswith("quick@")
        group, beside = file[f"quick/{case}/n000008"], file[f"{other}/{case}/n000008"]
        assert '"stiffness":2.0' in group.attrs["specification"]
        assert '"stiffness":1.0' in beside.attrs["specification"]
        assert group["position"][()].tolist() != beside["position"][()].tolist()
        assert file[f"{other}/{case}/convergence/error"].shape == (2,)
    fvi("export", FILE, "--to", "csv")
    names = {path.name for path in Path("results/export/quick").iterdir()}
    assert {f"quick-{case}-n000008.csv", f"{other}-{case}-n000008.csv"} < names
    assert len([name for name in names if name.endswith(".csv")]) == 8


def test_what_is_forgotten_is_listed_first_and_nothing_else_goes():
    told()
    told(*STIFF)
    before = Path(FILE).read_bytes()
    tried = fvi("forget", FILE, *STIFF, "--case", "bdf1", "--dry-run")
    assert f"{FILE}: 2 runs would be forgotten" in tried.stdout
    assert "/quick/bdf1-nodes-s1-gauss1-none/n000004" in tried.stdout
    assert Path(FILE).read_bytes() == before
    done = fvi("forget", FILE, *STIFF, "--case", "bdf1")
    assert f"{FILE}: 2 runs forgotten" in done.stdout
    assert "4 runs, 2 of them stored" in fvi("run", "quick.yaml", *STIFF).stderr
    fvi("forget", FILE, "--others")
    assert {run.variant for run in list_runs(Path(FILE)).runs} == {""}
    assert "4 runs, 4 of them stored" in fvi("run", "quick.yaml", *STIFF).stderr
    assert "4 runs, 0 of them stored" in told()
    # control: from Python the same
    assert api.forget(FILE, overrides=["problem.stiffness=2"]) == 4
    assert len(list_runs(Path(FILE)).runs) == 4
    fvi("forget", FILE, "--all")
    assert sorted(path.name for path in Path("results").iterdir()) == [".quick.h5.lock"]


MISTAKES = [
    ((), "say which runs: --set KEY.PATH=VALUE, --case, --others or --all"),
    (("--all", "--case", "bdf1"), "--all: means every run"),
    (("--others", *STIFF), "--set and --others: give one of them"),
    (("--case", "bdf7"), "no run matches"),
    (("--set", "problem.stiffness=7"), "no run matches"),
    (("--set", "problem.stifness=7"), "stiffness"),
]


def test_a_mistake_forgets_nothing():
    told()
    before = Path(FILE).read_bytes()
    for arguments, words in MISTAKES:
        assert words in fvi("forget", FILE, *arguments, code=2).stderr
    assert Path(FILE).read_bytes() == before
    assert "no such file" in fvi("forget", "results/other.h5", "--all", code=2).stderr
    assert "such as quick.h5" in fvi("forget", "quick.yaml", "--all", code=2).stderr


def test_fresh_replaces_run_by_run(monkeypatch):
    """What is interrupted has lost nothing that was finished before."""
    told()
    real, calls = compute.execute_job, []

    def interrupted(job, references, checkpoints):
        calls.append(job)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return [dataclasses.replace(one, error=0.5) for one in real(job, references, checkpoints)]

    monkeypatch.setattr(compute, "execute_job", interrupted)
    fvi("run", "quick.yaml", "--fresh", code=130)
    found = [run.error == 0.5 for run in list_runs(Path(FILE)).runs]
    assert sorted(found) == [False, False, True, True]
