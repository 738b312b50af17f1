"""What errors are measured against is found once for every scene, and stored."""

import dataclasses
import functools
import os

import numpy as np
import pytest
from command_line import fvi

import fvi_cli
from fvi_cli.config import parse_config
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess
from fvi_cli.runner.executors.jobs import jobs_of
from fvi_cli.runner.executors.processes import LocalProcesses
from fvi_cli.storage import list_runs, read_results
from fvi_cli.studies.reference import reference_of

MEMBERS, PACKS = 130, 15
SWEPT = f"""\
name: swept
problem:
  kind: pendulum
  damping: [{{order: 0.5, coefficient: 0.1}}]
  initial: {{position: 1.0}}
  final_time: 0.25
method: {{rk: gauss, degree: 1}}
ladder: {{steps: [2, 4, 8, 16]}}
sweep: {{problem.omega: {{from: 0.5, to: 1, number: {MEMBERS}}}}}
"""
FEW = SWEPT.replace(f"number: {MEMBERS}", "number: 5")


def experiment(text):
    return parse_config(text, "swept.yaml").experiments[0]


def noted(folder, job, references):
    """Computes a job, and notes references that are found, by whoever it is."""
    if job.is_reference:
        name = "-".join(str(run.member.number) for run in job.runs)
        with (folder / name).open("a", encoding="ascii") as file:
            file.write(f"{os.getpid()}\n")
    elif not job.runs[0].problem.exact:
        assert all(one is not None for one in references)
    return execute_job(job, references)


@pytest.mark.processes
@pytest.mark.parametrize("executor", [InProcess(), LocalProcesses(workers=2)])
def test_every_reference_is_found_once(tmp_path, executor):
    jobs = jobs_of(experiment(SWEPT).runs())
    held = {}

    def lookup(run):
        return held[run.member]

    finished = []
    for one in executor.compute(jobs, functools.partial(noted, tmp_path), lookup):
        if one.job.is_reference:
            members = (run.member for run in one.job.runs)
            held.update(zip(members, one.results, strict=True))
        else:
            finished += one.finished
    assert len(finished) == 4 * MEMBERS
    assert {one.status for one in finished} == {"ok"}
    marks = list(tmp_path.iterdir())
    assert len(marks) == PACKS
    assert all(len(mark.read_text().split()) == 1 for mark in marks)


@pytest.mark.few(1)
@pytest.mark.parametrize("more", ["", "ladder: {steps: [2, 4], grading: 2}"])
def test_a_stored_reference_serves_further_methods(tmp_path, monkeypatch, more):
    monkeypatch.chdir(tmp_path)
    text = FEW if not more else FEW.replace("ladder: {steps: [2, 4, 8, 16]}", more)
    (tmp_path / "swept.yaml").write_text(text)
    fvi("run", "swept.yaml", code=0)
    one = experiment(text)
    with read_results(tmp_path / "results" / "swept.h5") as store:
        for run in one.runs()[:5]:
            kept, own = store.reference(run), reference_of(run)
            assert (kept.error, kept.source) == (own.error, own.source)
            for n in one.steps:
                times = dataclasses.replace(run, n_steps=n).times
                np.testing.assert_allclose(kept.values(times), own.values(times), atol=1e-12)
        assert len(store.entries()) == len(one.runs())
    # no run of the listing is one
    assert len(list_runs(tmp_path / "results" / "swept.h5").runs) == len(one.steps)

    def found_anew(runs):
        raise AssertionError(f"{runs[0]} needs a reference")

    monkeypatch.setattr("fvi_cli.runner.executors.execute.refined_references", found_anew)
    further = fvi("run", "swept.yaml", "--set", "method.degree=[1, 2]", code=0)
    assert "failed" not in further.stdout
    # control: other scenes have others
    other = fvi("run", "swept.yaml", "--set", "problem.final_time=0.5", code=1)
    assert "needs a reference" in other.stderr


def test_a_run_says_that_its_error_is_not_known_where_the_reference_ends_early(tmp_path):
    """x'' = x^3 from 1 with the velocity 1 is infinite at t = 1.31."""
    initial = {"position": 1.0, "velocity": 1.0}
    problem = {"kind": "lagrangian", "coordinates": ["x"], "lagrangian": "vx**2/2 + x**4/4"}
    for final_time, count in ((1.0, 0), (1.5, 1)):
        config = {
            "name": "up",
            "problem": {**problem, "initial": initial, "final_time": final_time},
            "method": {"rk": "gauss", "degree": 1},
            "ladder": {"steps": [3]},
        }
        (outcome,) = fvi_cli.run(config, output=tmp_path)
        remarks = outcome.finished[0].trajectory.remarks
        said = "error: not known, reference: none (no exact solution is known, and the refined run"
        assert sum(said in one for one in remarks) == count
        assert sum("error: not known" in one for one in remarks) == count
