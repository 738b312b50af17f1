"""Batches on a real Dask cluster are the same batches; workers that die do no harm."""

import contextlib
import dataclasses
import functools
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import cloudpickle
import dask
import numpy as np
import pytest
import test_executor as local
from command_line import fvi
from distributed import LocalCluster
from distributed.utils import LoopRunner

import fvi_cli
from fvi_cli.errors import ExecutorError
from fvi_cli.runner.executors import cluster as cluster_module
from fvi_cli.runner.executors import portable as portable_module
from fvi_cli.runner.executors.cluster import DaskCluster
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess
from fvi_cli.runner.executors.jobs import Crash

# the workers have the package, but not the tests
cloudpickle.register_pickle_by_value(local)
pytestmark = [
    pytest.mark.processes,
    # what a cluster leaves to the garbage collector when its workers are killed is not ours
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
]


MOST_SECONDS = 600

# the garbage collector closes clients whose scheduler never answered; it may do so in a thread that
# holds this lock, which then takes it once more
LoopRunner._lock = threading.RLock()


@contextlib.contextmanager
def time_limit():
    """Fail where a lock of the cluster never opens; where there are no alarms it is waited for."""
    if not hasattr(signal, "SIGALRM"):
        yield
        return

    def stop(number, frame):
        pytest.fail(f"the cluster stood still for {MOST_SECONDS} s")

    before = signal.signal(signal.SIGALRM, stop)
    left, _ = signal.setitimer(signal.ITIMER_REAL, MOST_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, left)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture(autouse=True)
def _limited():
    with time_limit():
        yield


@contextlib.contextmanager
def start_cluster(n_workers, failures):
    # a machine with much to do starts its workers late; those that died are given up after 15 s,
    # unless it is told otherwise, and then nobody computes any more
    patience = {f"distributed.comm.timeouts.{name}": "180s" for name in ("connect", "tcp")}
    patience["distributed.deploy.lost-worker-timeout"] = f"{MOST_SECONDS}s"
    with dask.config.set({"distributed.scheduler.allowed-failures": failures, **patience}):
        with time_limit():
            cluster = LocalCluster(
                n_workers=n_workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",  # any free port
                silence_logs=50,
            )
        try:
            yield cluster
        finally:
            with time_limit():
                cluster.close(timeout=60)


@pytest.fixture(scope="module")
def cluster():
    with start_cluster(2, 1) as cluster:
        yield cluster


def test_a_cluster_gives_the_same_numbers_to_the_last_bit(cluster):
    runs = local.experiment().runs()
    jobs = local.jobs_by_method(runs)
    here = list(InProcess().compute(jobs, execute_job))
    executor = DaskCluster(address=cluster.scheduler_address)
    there = list(executor.compute(jobs, execute_job))
    assert local.numbers(here) == local.numbers(there)
    assert {f.run for batch in there for f in batch.finished} == set(runs)
    assert not any(batch.lost for batch in there)


def test_the_command_computes_there_what_it_computes_here(cluster, tmp_path):
    def run(folder, *options):
        few = ("--set", "ladder.steps=[4, 8]", "-q", "--output", str(tmp_path / folder))
        result = fvi("run", "bagley-torvik-1-2", *few, *options, code=0)
        assert (tmp_path / folder / "bagley-torvik-1-2.h5").is_file()
        return result.stdout.splitlines()[:-1]

    there = run("there", "--dask", cluster.scheduler_address)
    assert there == run("here")
    assert len(there) > 4


def test_a_worker_killed_in_the_midst_is_replaced(cluster, tmp_path):
    dies_once = functools.partial(local.dies_once_of_sixteen, folder=str(tmp_path))
    jobs = local.singles(local.experiment().runs())
    executor = DaskCluster(address=cluster.scheduler_address)
    answers = list(executor.compute(jobs, dies_once))
    assert len(list(tmp_path.iterdir())) == 2  # each killed its worker once
    assert not any(batch.lost for batch in answers)
    here = InProcess().compute(jobs, execute_job)
    assert local.numbers(answers) == local.numbers(here)


def test_a_batch_that_no_worker_survives_is_reported_and_the_others_go_on(cluster):
    jobs = local.singles(local.experiment().runs()[:3])
    executor = DaskCluster(address=cluster.scheduler_address)
    answers = list(executor.compute(jobs, local.dies_of_sixteen))
    assert sorted((f.run.n_steps, f.status) for b in answers for f in b.finished) == [
        (4, "ok"),
        (8, "ok"),
        (16, "failed"),
    ]
    (lost,) = (batch for batch in answers if batch.lost)
    assert np.isnan(lost.finished[0].error)
    assert lost.finished[0].trajectory.message == (
        "the worker that computed it died (out of memory?), 4 times"
    )


def test_where_the_scheduler_forgives_nothing_a_batch_is_sent_once_more_all_the_same(tmp_path):
    dies_once = functools.partial(local.dies_once_of_sixteen, folder=str(tmp_path))
    jobs = local.singles(local.experiment().runs()[2:3])
    with start_cluster(1, 0) as strict:
        executor = DaskCluster(address=strict.scheduler_address)
        (answer,) = executor.compute(jobs, dies_once)
        assert not answer.lost
        (answer,) = executor.compute(jobs, local.dies_of_sixteen)
        assert answer.lost


def test_an_exception_on_a_worker_is_the_result_of_its_run(cluster):
    jobs = local.singles(local.experiment().runs())
    executor = DaskCluster(address=cluster.scheduler_address)
    answers = list(executor.compute(jobs, local.awkward_at_sixteen))
    lost = [run for batch in answers for run in batch.lost]
    assert [run.n_steps for run in lost] == [16, 16]
    assert len(answers) == len(jobs)


def unused_address():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{probe.getsockname()[1]}"


def test_a_scheduler_that_is_not_there_is_told(monkeypatch):
    monkeypatch.setattr("fvi_cli.runner.executors.cluster.CONNECTION_SECONDS", 0.5)
    jobs = local.singles(local.experiment().runs())
    for address in (unused_address(), "nonsense://1", "tcp://256.0.0.1:1"):
        with pytest.raises(ExecutorError, match=re.escape(address) + ": no Dask scheduler"):
            list(DaskCluster(address=address).compute(jobs, execute_job))


def test_a_port_that_stays_silent_is_told(monkeypatch):
    monkeypatch.setattr("fvi_cli.runner.executors.cluster.CONNECTION_SECONDS", 0.5)
    jobs = local.singles(local.experiment().runs())
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        began = time.monotonic()
        with pytest.raises(ExecutorError, match=re.escape(address) + ": no Dask scheduler"):
            list(DaskCluster(address=address).compute(jobs, execute_job))
        assert time.monotonic() - began < 10


def test_a_worker_with_other_code_is_refused_by_name(cluster, monkeypatch):
    executor = DaskCluster(address=cluster.scheduler_address)
    jobs = local.singles(local.experiment().runs()[:2])
    # what this process says of itself; the workers look at their own
    monkeypatch.setattr(portable_module, "VERSION", "fvi 9.9 (solver 99)")
    with pytest.raises(ExecutorError, match=r"worker .* at tcp://.*fvi 9\.9.*install the same"):
        list(executor.compute(jobs, execute_job))
    monkeypatch.undo()
    # control: the same code is believed
    assert len(list(executor.compute(jobs, execute_job))) == 2


SCHEDULER = """
from distributed import LocalCluster
from distributed.utils import LoopRunner

if __name__ == "__main__":
    cluster = LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    )
    print(cluster.scheduler_address, flush=True)
    input()
"""


def test_a_scheduler_that_is_killed_is_told(tmp_path):
    script = tmp_path / "scheduler.py"
    script.write_text(SCHEDULER)
    search = os.pathsep.join(str(Path(f).parent) for f in (__file__, fvi_cli.__path__[0]))
    environment = {**os.environ, "PYTHONPATH": search}
    scheduler = subprocess.Popen(
        [sys.executable, str(script)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    with scheduler, contextlib.ExitStack() as ended:
        ended.callback(scheduler.kill)
        executor = DaskCluster(address=scheduler.stdout.readline().strip())
        jobs = local.singles(local.experiment().runs()[:2])
        stream = executor.compute(jobs, local.sleeps_at_four)
        assert [f.run.n_steps for f in next(stream).finished] == [8]
        scheduler.kill()
        with pytest.raises(ExecutorError, match="scheduler is gone"):
            next(stream)


def test_a_missing_package_is_told(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    jobs = local.singles(local.experiment().runs())
    with pytest.raises(ExecutorError, match=r"--dask needs the package distributed: install fvi"):
        list(DaskCluster(address="tcp://x:1").compute(jobs, execute_job))


class SlowClient:
    """A scheduler with one worker that needs many looks for every batch."""

    status = "running"

    def __init__(self, results):
        self.results, self.sent, self.most = results, [], 0

    def nthreads(self):
        return {"worker": 1}

    def submit(self, *arguments, **options):
        future = SlowFuture(self)
        self.sent.append(future)
        self.most = max(self.most, sum(not one.is_done for one in self.sent))
        return future

    def cancel(self, *arguments, **options):
        raise AssertionError("every batch is finished")

    def close(self, timeout):
        assert timeout


class SlowFuture:
    """Finished after some looks."""

    def __init__(self, client):
        self.client, self.is_done = client, False

    def add_done_callback(self, callback):
        timer = threading.Timer(0.02 * len(self.client.sent), self._finish, (callback,))
        timer.daemon = True
        timer.start()

    def _finish(self, callback):
        self.is_done = True
        callback(self)

    def result(self):
        return self.client.results.pop(0)


def test_time_outs_send_no_batch_beyond_the_limit(monkeypatch):
    monkeypatch.setattr(cluster_module, "_SECONDS_BETWEEN_LOOKS", 0.002)
    steps = tuple(range(2, 42))
    runs = dataclasses.replace(local.experiment(), steps=steps).runs()
    jobs = local.singles(runs)
    crashes = [[Crash(message="never computed")] for _ in jobs]
    client = SlowClient(crashes)
    executor = DaskCluster(address="tcp://made-up", client=client)
    assert len(list(executor.compute(jobs, execute_job))) == len(jobs) >= 40
    assert client.most <= 8
