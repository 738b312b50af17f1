"""Runs of other values side by side in a file: where they lie, and what replaces them."""

import dataclasses
from pathlib import Path

import h5py
import pytest
from command_line import fvi

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


def run(*arguments: str, code: int = 0) -> None:
    fvi("run", "quick.yaml", *arguments, code=code)


def test_what_is_asked_for_lies_where_the_contract_says():
    run()
    run(*STIFF)
    with h5py.File(FILE) as file:
        case = "bdf1-nodes-s1-gauss1-none"
        (other,) = [name for name in file if name not in ("quick", "@index")]
        assert other.startswith("quick@")
        group, beside = file[f"quick/{case}/n000008"], file[f"{other}/{case}/n000008"]
        assert '"stiffness":2.0' in group.attrs["specification"]
        assert '"stiffness":1.0' in beside.attrs["specification"]
        assert group["position"][()].tolist() != beside["position"][()].tolist()
    assert len(list_runs(Path(FILE)).runs) == 8
    run(*STIFF, "--prune")
    assert len(list_runs(Path(FILE)).runs) == 4
    assert not any(one.variant for one in list_runs(Path(FILE)).runs)


def test_an_interrupted_command_drops_nothing(monkeypatch):
    run()

    def interrupted(job, references):
        raise KeyboardInterrupt

    monkeypatch.setattr(compute, "execute_job", interrupted)
    run(*STIFF, "--prune", code=130)
    assert len(list_runs(Path(FILE)).runs) == 4


def test_fresh_replaces_run_by_run(monkeypatch):
    """What is interrupted has lost nothing that was finished before."""
    run()
    real, calls = compute.execute_job, []

    def interrupted(job, references):
        calls.append(job)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return [dataclasses.replace(one, error=0.5) for one in real(job, references)]

    monkeypatch.setattr(compute, "execute_job", interrupted)
    run("--fresh", code=130)
    found = [run.error == 0.5 for run in list_runs(Path(FILE)).runs]
    assert sorted(found) == [False, False, True, True]
