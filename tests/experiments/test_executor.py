"""Runs computed here and in other processes are the same runs."""

import multiprocessing

import numpy as np
import pytest

from fvi_cli.experiments.executor import compute_runs
from fvi_cli.experiments.experiment import Experiment
from fvi_cli.experiments.study import execute
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.registry import build_problem


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


def numbers(finished):
    return {
        (f.run.method.case, f.run.n_steps): (f.error, f.status, f.trajectory.position.tolist())
        for f in finished
    }


def test_several_processes_give_the_same_numbers_to_the_last_bit():
    runs = experiment().runs()
    here = list(compute_runs(runs, execute))
    there = list(compute_runs(runs, execute, workers=2))
    assert numbers(here) == numbers(there)
    assert len(here) == 6
    # the runs come back as the very objects that were handed in
    assert {id(f.run) for f in there} == {id(run) for run in runs}
    # control: another problem gives other numbers
    other = experiment(stiffness=2.0).runs()
    assert numbers(compute_runs(other, execute)) != numbers(here)


def test_one_process_computes_when_asked_and_in_order():
    runs = experiment().runs()
    computed = []

    def compute(run):
        computed.append(run)
        return execute(run)

    stream = compute_runs(runs, compute)
    assert computed == []
    first = next(stream)
    assert computed == [runs[0]]
    assert first.run is runs[0]
    stream.close()
    assert computed == [runs[0]]


def test_leaving_early_ends_the_processes():
    before = set(multiprocessing.active_children())
    stream = compute_runs(experiment().runs(), execute, workers=2)
    finished = next(stream)
    assert np.isfinite(finished.error)
    assert set(multiprocessing.active_children()) > before
    stream.close()
    assert set(multiprocessing.active_children()) <= before


def test_what_goes_wrong_in_a_process_is_raised_here():
    run = experiment().runs()[0]
    broken = [run, run.__class__(experiment=run.experiment, method=run.method, n_steps=0)]
    with pytest.raises((ValueError, ZeroDivisionError)):
        list(compute_runs(broken, execute, workers=2))
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("workers", [0, -1])
def test_the_number_of_workers_is_checked(workers):
    with pytest.raises(ValueError, match=f"workers: {workers} is not allowed"):
        list(compute_runs([], execute, workers=workers))
