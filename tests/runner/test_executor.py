"""Batches computed here and in other processes are the same batches; who dies is replaced."""

import functools
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import fvi_cli
from fvi_cli.config import parse_config
from fvi_cli.errors import ExecutorError
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.stability.prediction import predict_stability
from fvi_cli.runner.executors import portable as portable_module
from fvi_cli.runner.executors.batches import pack_of
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess
from fvi_cli.runner.executors.jobs import Job, jobs_of
from fvi_cli.runner.executors.portable import portable_job
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


def computed_by(folder, job, references):
    """Computes a job and notes in which process."""
    first = job.runs[0]
    number = pack_of(first)[-1]
    name = "reference" if job.is_reference else first.n_steps
    (folder / f"{number}-{name}").write_text(str(os.getpid()))
    return execute_job(job, references)


@pytest.mark.parametrize("members", [40, 90])
def test_batches_that_share_references_are_computed_by_one_process(tmp_path, members):
    text = (
        "name: many\nproblem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 4.0, "
        "damping: [{order: 0.5, coefficient: 0.3}]}\n"
        "method: {rk: gauss, degree: 1}\nladder: {steps: [4, 8, 16, 32]}\n"
        f"sweep: {{problem.stiffness: {{from: 1, to: 2, number: {members}}}}}\n"
    )
    jobs = jobs_of(parse_config(text, "many.yaml").experiments[0].runs())
    packs = len(jobs) // 5
    assert packs >= 5
    list(TWO.compute(jobs, functools.partial(computed_by, tmp_path)))
    pairs = {(path.name.partition("-")[0], path.read_text()) for path in tmp_path.iterdir()}
    assert len(list(tmp_path.iterdir())) == len(jobs)
    assert len({process for _, process in pairs}) == 2
    # at the end the one that is free may help with the last pack of the other
    assert packs <= len(pairs) <= packs + 1


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


def test_leaving_early_ends_the_processes():
    before = set(multiprocessing.active_children())
    stream = TWO.compute(singles(experiment().runs()), execute_job)
    first = next(stream)
    assert np.isfinite(first.finished[0].error)
    assert set(multiprocessing.active_children()) > before
    stream.close()
    assert set(multiprocessing.active_children()) <= before


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


def test_the_place_of_a_mistake_is_told_without_the_folder_of_the_installation(caplog):
    def mistaken(job, references):
        return [predict_stability(job.runs[0].problem.scene, job.runs[0].method, 0)]

    jobs = singles(experiment().runs()[:1])
    with caplog.at_level("DEBUG", logger="fvi_cli"):
        (batch,) = InProcess().compute(jobs, mistaken)
    (finished,) = batch.finished
    assert re.search(r"in fvi_cli(/\w+)+\.py:\d+: ", finished.trajectory.message)
    assert "Traceback" in caplog.text


@pytest.mark.parametrize("workers", [0, -1])
def test_the_number_of_workers_is_checked(workers):
    with pytest.raises(ValueError, match=f"workers: {workers} is not allowed"):
        LocalProcesses(workers=workers)


def held_signals():
    return signal.pthread_sigmask(signal.SIG_BLOCK, ())


def fails_where_it_sees_interrupts(job, references):
    if signal.SIGINT not in held_signals():
        raise AwkwardError("this", "that")
    return execute_job(job, references)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be held here")
@pytest.mark.parametrize("forked_on", [(), ("linux",)])
def test_no_process_sees_an_interrupt_while_it_begins(monkeypatch, forked_on):
    """A terminal sends it to all; a process that is loading would end with a traceback."""
    monkeypatch.setattr("fvi_cli.runner.executors.processes._FORKED_ON", forked_on)
    from multiprocessing import forkserver

    # whoever loads the others, and what it begins with, is to be new as well
    forkserver._forkserver._stop()
    jobs = singles(experiment().runs()[:2])
    answers = list(TWO.compute(jobs, fails_where_it_sees_interrupts))
    assert not any(batch.lost for batch in answers)
    assert signal.SIGINT not in held_signals()
    # control: here it is seen
    assert all(b.lost for b in InProcess().compute(jobs, fails_where_it_sees_interrupts))


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


ORPHANS = """
import sys, time
sys.path.insert(0, {tests!r})
import test_executor as t

if __name__ == "__main__":
    stream = t.TWO.compute(t.singles(t.experiment().runs()), t.sleeps)
    next(stream)
"""


def sleeps(job, references):
    os.write(1, f"{os.getpid()}\n".encode())
    time.sleep(600)
    return []


def sleeps_at_four(job, references):
    if job.runs[0].n_steps == 4:
        time.sleep(600)
    return execute_job(job, references)


def is_alive(process_id):
    try:
        return Path(f"/proc/{process_id}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at processes in /proc")
def test_processes_end_with_a_parent_that_was_killed(tmp_path):
    script = tmp_path / "orphans.py"
    script.write_text(ORPHANS.format(tests=str(Path(__file__).parent)))
    package = str(Path(fvi_cli.__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": package}
    parent = subprocess.Popen(
        [sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment
    )
    with parent:
        children = [int(parent.stdout.readline()) for _ in range(2)]
        assert all(map(is_alive, children))
        parent.kill()
    deadline = time.monotonic() + 30
    while any(map(is_alive, children)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(map(is_alive, children))


def test_workers_of_another_version_are_refused(monkeypatch):
    (portable,) = (portable_job(job, ()) for job in singles(experiment().runs()[:1]))
    assert len(portable_module.compute_portable(execute_job, portable)) == 1
    monkeypatch.setattr(portable_module, "VERSION", "fvi 9.9 (solver 99)")
    with pytest.raises(ExecutorError, match=r"it has fvi 9\.9 \(solver 99\) in place of"):
        portable_module.compute_portable(execute_job, portable)
