"""Batches computed here and in other processes are the same batches; who dies is replaced."""

import functools
import multiprocessing
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from fvi_cli.integrator.method import Method
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess
from fvi_cli.runner.executors.jobs import Job
from fvi_cli.runner.executors.processes import LocalProcesses
from fvi_cli.scenes.registry import build_problem
from fvi_cli.studies.experiment import Experiment

pytestmark = pytest.mark.processes


def experiment(**changes):
    specification = {
        "kind": "bagley-torvik",
        "damping": [{"order": 1.5, "coefficient": 1.0}],
        "forcing": "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5",
        "final_time": 1.0,
        "exact": "t**2.5",
        **changes,
    }
    return Experiment(
        name="quick",
        problem=build_problem(specification),
        problem_specification=specification,
        methods=tuple(Method(cq=f"bdf{p}", degree=1, sampling="nodes") for p in (1, 2)),
        steps=(4, 8, 16),
    )


def numbers(batches):
    return {
        (f.run.method.case, f.run.n_steps): (f.error, f.status, f.trajectory.position.tolist())
        for batch in batches
        for f in batch.finished
    }


def jobs_by_method(runs):
    return [Job(runs=tuple(run for run in runs if run.method.cq == f"bdf{p}")) for p in (1, 2)]


def singles(runs):
    return [Job(runs=(run,)) for run in runs]


TWO = LocalProcesses(workers=2)


@pytest.mark.parametrize("forked_on", [(), ("linux",)])
def test_several_processes_give_the_same_numbers_to_the_last_bit(monkeypatch, forked_on):
    monkeypatch.setattr("fvi_cli.runner.executors.processes._FORKED_ON", forked_on)
    runs = experiment().runs()
    jobs = jobs_by_method(runs)
    here = list(InProcess().compute(jobs, execute_job))
    there = list(TWO.compute(jobs, execute_job))
    assert numbers(here) == numbers(there)
    assert len(numbers(here)) == 6
    # a batch comes back whole, in its order, with the very runs that were handed in
    for answers in (here, there):
        assert {tuple(id(f.run) for f in batch.finished) for batch in answers} == {
            tuple(id(run) for run in job.runs) for job in jobs
        }
        assert not any(batch.lost for batch in answers)
    # control: another problem gives other numbers
    other = singles(experiment(stiffness=2.0, exact="auto").runs())
    assert numbers(InProcess().compute(other, execute_job)) != numbers(here)


def test_one_process_computes_when_asked_and_in_order():
    jobs = jobs_by_method(experiment().runs())
    computed = []

    def compute(job, references):
        computed.append(job)
        return execute_job(job, references)

    stream = InProcess().compute(jobs, compute)
    assert computed == []
    first = next(stream)
    assert computed == jobs[:1]
    assert [f.run for f in first.finished] == list(jobs[0].runs)
    stream.close()
    assert computed == jobs[:1]


class AwkwardError(Exception):
    """Cannot be made again from what pickle keeps of it."""

    def __init__(self, one, two):
        super().__init__(f"{one} and {two}")


def awkward_at_sixteen(job, references):
    if any(run.n_steps == 16 for run in job.runs):
        raise AwkwardError("this", "that")
    return execute_job(job, references)


@pytest.mark.parametrize("executor", [InProcess(), TWO])
def test_an_exception_is_the_result_of_the_run_that_raises_it(executor, caplog):
    """Be it alone or together with others; what does not travel is told in words."""
    runs = experiment().runs()
    jobs = [Job(runs=tuple(runs[:3])), *singles(runs[3:])]
    assert 16 in {run.n_steps for run in jobs[0].runs}
    answers = list(executor.compute(jobs, awkward_at_sixteen))
    # processes do not write into the log of this one
    assert ("3 runs are computed one by one" in caplog.text) == isinstance(executor, InProcess)
    finished = [f for batch in answers for f in batch.finished]
    assert len(finished) == len(runs)
    assert {f.run.n_steps for f in finished if f.status == "failed"} == {16}
    kept = [f for batch in answers for f in batch.stored]
    assert {f.status for f in kept} == {"ok"}
    assert len(kept) == len(runs) - 2
    for message in {f.trajectory.message for f in finished if f.status == "failed"}:
        assert message.startswith("unexpected AwkwardError")
        assert "this and that; this is a mistake of the program, please report it" in message


@pytest.mark.parametrize("workers", [0, -1])
def test_the_number_of_workers_is_checked(workers):
    with pytest.raises(ValueError, match=f"workers: {workers} is not allowed"):
        LocalProcesses(workers=workers)


# --- processes that die ---------------------------------------------------------------------------


def dies_of_sixteen(job, references):
    """No process survives N = 16."""
    if any(run.n_steps == 16 for run in job.runs):
        os.kill(os.getpid(), signal.SIGKILL)
    return execute_job(job, references)


def dies_once_of_sixteen(job, references, folder):
    """The first process that meets N = 16 of a method dies, the next one does not."""
    for run in job.runs:
        mark = Path(folder) / f"{run.method.case}-{run.n_steps}"
        if run.n_steps == 16 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return execute_job(job, references)


def test_a_batch_whose_process_died_is_computed_once_more(tmp_path):
    compute = functools.partial(dies_once_of_sixteen, folder=str(tmp_path))
    jobs = singles(experiment().runs())
    answers = list(TWO.compute(jobs, compute))
    assert len(list(tmp_path.iterdir())) == 2  # both have died once
    assert not any(batch.lost for batch in answers)
    here = InProcess().compute(jobs, execute_job)
    assert numbers(answers) == numbers(here)


def test_a_batch_of_which_every_process_dies_is_reported_and_the_others_go_on():
    jobs = singles(experiment().runs())
    answers = list(TWO.compute(jobs, dies_of_sixteen))
    assert len(answers) == 6
    lost = [batch for batch in answers if batch.lost]
    assert [f.run.n_steps for batch in lost for f in batch.finished] == [16, 16]
    for (finished,) in (batch.finished for batch in lost):
        assert finished.status == "failed"
        assert np.isnan(finished.error)
        assert finished.trajectory.message == (
            "the process that computed it was ended by SIGKILL (out of memory?), 2 times"
        )
    assert {f.status for b in answers if not b.lost for f in b.finished} == {"ok"}
    assert not multiprocessing.active_children()
