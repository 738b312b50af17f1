"""Batches in other processes are the same batches; every reference is found once."""

import contextlib
import re
import socket

import numpy as np
import pytest
from command_line import MANY, configuration, fvi
from stored_runs import assert_same

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.errors import RequestError
from fvi_cli.runner import executor, work
from fvi_cli.runner.work import batches_of
from fvi_cli.studies.study import execute

OSCILLATORS = (
    MANY
    + """\
method: [{rk: gauss, degree: 2}, {bdf: 2, sampling: nodes}]
ladder: {steps: [16, 32]}
sweep: {problem.damping.0.order: [0.5, 1.5], problem.stiffness: [1, 2, 3]}
"""
)
PENDULUMS = configuration(
    "kind: pendulum, damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}, "
    "final_time: 2.0",
    name="many",
    steps="16, 32",
    more="sweep: {problem.initial.position: [0.5, 1.0, 2.0], problem.omega: [1, 2]}\n"
    "quantities: {speed: vx}\nevents: {turn: {when: vx}}\n",
)
TIMED = ("run", "failure", "steps", "seconds")


def load(text, *overrides):
    return parse_config(text, "many.yaml", overrides=overrides)


@pytest.mark.parametrize("text", [OSCILLATORS, PENDULUMS])
def test_a_batch_gives_what_every_run_gives_alone(text):
    runs = load(text).experiments[0].runs()
    (first, *others) = batches_of(runs)
    assert len(first.runs) == 6
    assert sorted(map(id, runs)) == sorted(id(one) for b in (first, *others) for one in b.runs)
    (outcome,) = api.run(load(text))
    for run, one in zip(first.runs, outcome.finished, strict=False):
        alone = execute(run)
        scale = np.abs(alone.trajectory.position).max()
        np.testing.assert_allclose(
            one.trajectory.position, alone.trajectory.position, rtol=0, atol=1e-12 * scale
        )
        assert one.error == pytest.approx(alone.error, rel=1e-6, abs=1e-11)
        assert (one.status, one.predicted) == (alone.status, alone.predicted)
        assert (one.reference, one.order_smooth) == (alone.reference, alone.order_smooth)
    # control: members differ from each other
    assert len({float(one.trajectory.position[-1, 0]) for one in outcome.finished}) == len(runs)


@pytest.mark.processes
@pytest.mark.parametrize("text", [OSCILLATORS, PENDULUMS])
def test_processes_give_the_same_runs(text):
    (here,), (there,) = api.run(load(text)), api.run(load(text), workers=2)
    for one, other in zip(here.finished, there.finished, strict=True):
        assert_same(one, other, TIMED)


def test_references_are_found_once_and_stored(monkeypatch, tmp_path):
    usual, found = work.tabulated_references, []

    def noted(runs):
        found.extend(runs)
        return usual(runs)

    monkeypatch.setattr(work, "tabulated_references", noted)
    (first,) = api.run(load(PENDULUMS), output=tmp_path)
    assert len(found) == 6
    # they serve further methods, and reading computes none
    api.run(load(PENDULUMS, "method.degree=[2, 3]"), output=tmp_path)
    assert len(found) == 6
    monkeypatch.setattr(work, "compute", None)
    (again,) = api.recall(tmp_path / "many.h5", overrides=["method={rk: gauss, degree: 2}"])
    for one, other in zip(first.finished, again.finished, strict=True):
        assert_same(one, other)


def test_a_stored_file_is_drawn_without_a_reference_run(monkeypatch, tmp_path):
    text = configuration("kind: pendulum, initial: {position: 1.0}, final_time: 2.0", name="many")
    api.run(load(text + "figures: [convergence]\n"), output=tmp_path)
    (outcome,) = api.recall(tmp_path / "many.h5")
    monkeypatch.setattr("fvi_cli.studies.reference.solve_by_two_runs", None)
    assert outcome.plot("convergence") is not None


def test_a_run_says_that_its_error_is_not_known_where_the_reference_ends_early():
    """x'' = x^3 from 1 with the velocity 1 is infinite at t = 1.31."""
    for final_time, count in ((1.0, 0), (1.5, 1)):
        text = configuration(
            "kind: lagrangian, coordinates: [x], lagrangian: vx**2/2 + x**4/4, "
            f"initial: {{position: 1.0, velocity: 1.0}}, final_time: {final_time}",
            method="{rk: gauss, degree: 1}",
            steps="3",
        )
        ((finished,),) = (one.finished for one in api.run(parse_config(text, "up.yaml")))
        said = [one for one in finished.trajectory.remarks if "error: not known" in one]
        assert len(said) == count


# --- Dask -----------------------------------------------------------------------------------------


@pytest.mark.processes
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_a_cluster_gives_what_the_command_computes_here(tmp_path):
    from distributed import LocalCluster

    def run(folder, *options):
        few = ("--set", "ladder.steps=[4, 8]", "-q", "--output", str(tmp_path / folder))
        return fvi("run", "bagley-torvik-1-2", *few, *options, code=0).stdout.splitlines()[:-1]

    made = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50)
    with contextlib.closing(made) as cluster:
        there = run("there", "--dask", cluster.scheduler_address)
    assert there == run("here")
    assert len(there) > 4


@pytest.mark.processes
def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr(executor, "CONNECTION_SECONDS", 0.5)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    with pytest.raises(RequestError, match=re.escape(address) + ": no Dask scheduler"):
        api.run(load(OSCILLATORS), dask=address)
    with pytest.raises(RequestError, match="nonsense"):
        api.run(load(OSCILLATORS), dask="nonsense://1")
