"""Batches on a real Dask cluster are the same batches; workers that die do no harm."""

import contextlib
import re
import signal
import socket
import threading

import cloudpickle
import dask
import pytest
import test_executor as local
from command_line import fvi
from distributed import LocalCluster
from distributed.utils import LoopRunner

from fvi_cli.errors import ExecutorError
from fvi_cli.runner.executors.cluster import DaskCluster
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.executor import InProcess

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
