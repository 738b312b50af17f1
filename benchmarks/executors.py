"""Processes of one machine by three engines, and what a second worker is worth.

Looked at are the start, memory, a worker that dies, and Ctrl-C.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.measuring import table
from fvi_cli.config import parse_config
from fvi_cli.runner.executors.cluster import DaskCluster
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.jobs import (
    ComputeJob,
    FinishedJob,
    Job,
    References,
    Results,
    jobs_of,
)
from fvi_cli.runner.executors.portable import compute_portable, portable_job, returned_results
from fvi_cli.runner.executors.processes import LocalProcesses

CONFIG = """\
name: quick
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0}
method: {bdf: 1, sampling: nodes}
ladder: {steps: [4, 5, 6, 7, 8, 9, 10, 11]}
"""
EQUAL = """\
name: equal
problem: {kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.1}],
          initial: {position: 1.0}, final_time: 10.0, exact: none}
method: {rk: gauss, degree: 2, start: none}
ladder: {steps: [STEPS]}
sweep: {problem.stiffness: {from: 1.0, to: 4.0, number: MEMBERS}}
"""
EQUAL_MEMBERS, EQUAL_STEPS, PAIRS = 1000, 1000, 3
CLOCKS = "FVI_BENCHMARK_CLOCKS"
"""Variable of the environment: folder where every worker says what it has taken."""

WORKERS = 2
DEADLY = 8


def dies_of_eight(job: Job, references: References) -> Results:
    """No worker survives N = 8."""
    if any(run.n_steps == DEADLY for run in job.runs):
        os.kill(os.getpid(), signal.SIGKILL)
    return execute_job(job, references)


def takes_minutes(job: Job, references: References) -> Results:
    """Nobody waits for that."""
    time.sleep(120)
    return execute_job(job, references)


def _by_processes(jobs: Sequence[Job], compute: ComputeJob) -> Iterator[FinishedJob]:
    return LocalProcesses(workers=WORKERS).compute(jobs, compute)


def _by_dask(jobs: Sequence[Job], compute: ComputeJob) -> Iterator[FinishedJob]:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=WORKERS, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as cluster:
        yield from DaskCluster(address=cluster.scheduler_address).compute(jobs, compute)


def _by_loky(jobs: Sequence[Job], compute: ComputeJob) -> Iterator[FinishedJob]:
    loky = importlib.import_module("loky")
    with loky.ProcessPoolExecutor(max_workers=WORKERS) as executor:
        waiting = [executor.submit(compute_portable, compute, portable_job(j, ())) for j in jobs]
        for future, job in zip(waiting, jobs, strict=True):
            # one death breaks the whole executor
            with contextlib.suppress(RuntimeError):
                yield FinishedJob(job=job, results=returned_results(job, future.result()))


ENGINES: dict[str, Callable[[Sequence[Job], ComputeJob], Iterator[FinishedJob]]] = {
    "own processes (`--workers`)": _by_processes,
    "distributed.LocalCluster": _by_dask,
    "loky": _by_loky,
}


@dataclass(frozen=True, kw_only=True)
class Judged:
    """What one engine does with two workers.

    Parameters
    ----------
    name
        The engine.
    seconds
        From nothing to the last of eight short runs.
    megabytes
        Resident memory of all of its processes then, the asking one included.
    survivors
        Runs that are finished where one of eight ends its worker.
    ended_after
        Seconds from Ctrl-C to the end of the command.
    left_over
        Processes that are there two seconds later.
    """

    name: str
    seconds: float
    megabytes: float
    survivors: int
    ended_after: float
    left_over: int


def run_executors() -> list[Judged]:
    """Judge every engine that is installed."""
    found = []
    for name in ENGINES:
        if name == "loky" and importlib.util.find_spec("loky") is None:
            continue
        started = json.loads(_child(name, "start").communicate()[0])
        died = json.loads(_child(name, "death").communicate()[0])
        process = _child(name, "interrupt")
        with process:
            if process.stdout is None:
                raise RuntimeError("no pipe")
            process.stdout.readline()
            time.sleep(15)
            began = time.monotonic()
            os.killpg(process.pid, signal.SIGINT)
            # what does not end is told by its time, and ended below
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(60)
            ended_after = time.monotonic() - began
            time.sleep(2)
            left_over = _of_session(process.pid)
            for one in left_over:
                os.kill(one, signal.SIGKILL)
        found.append(
            Judged(
                name=name,
                seconds=started["seconds"],
                megabytes=started["megabytes"],
                survivors=died["finished"],
                ended_after=ended_after,
                left_over=len(left_over),
            )
        )
    return found


@dataclass(frozen=True, kw_only=True)
class Shared:
    """What equal members take with so many workers.

    Parameters
    ----------
    workers
        How many.
    wall
        Seconds of the clock, from nothing to the last result.
    busiest, total
        Seconds of a processor of the worker that has done most, and of all.
    client
        Seconds of a processor of the process that asks.
    """

    workers: int
    wall: float
    busiest: float
    total: float
    client: float

    @property
    def alone(self) -> float:
        """Seconds if every process had a processor of its own, and the asking one worked alone."""
        return self.busiest + self.client


def clocked(job: Job, references: References) -> Results:
    """Compute a job, and say what this process has taken so far, its imports included."""
    results = execute_job(job, references)
    own = Path(os.environ[CLOCKS]) / str(os.getpid())
    own.write_text(str(time.process_time()), encoding="ascii")
    return results


def run_equal(workers: int, members: int = EQUAL_MEMBERS, n_steps: int = EQUAL_STEPS) -> Shared:
    """Compute equal members, in a process of its own."""
    with _child(str(workers), "equal", str(members), str(n_steps)) as process:
        return Shared(**json.loads(process.communicate()[0]))


def _equal(workers: int, members: int, n_steps: int) -> dict[str, float]:
    text = EQUAL.replace("MEMBERS", str(members)).replace("STEPS", str(n_steps))
    jobs = jobs_of(parse_config(text, "equal.yaml").experiments[0].runs())
    with tempfile.TemporaryDirectory(prefix="fvi-clocks-") as folder:
        os.environ[CLOCKS] = folder
        began, own = time.monotonic(), time.process_time()
        found = sum(
            len(one.stored) for one in LocalProcesses(workers=workers).compute(jobs, clocked)
        )
        wall, client = time.monotonic() - began, time.process_time() - own
        taken = [float(one.read_text(encoding="ascii")) for one in Path(folder).iterdir()]
    if found != members:
        raise RuntimeError(f"{found} of {members} members")
    return {
        "workers": workers,
        "wall": wall,
        "busiest": max(taken),
        "total": sum(taken),
        "client": client,
    }


def executors_page() -> str:
    """Both tables; a pair begins with one worker and with two by turns."""
    pairs = []
    for number in range(PAIRS):
        order = (1, WORKERS) if number % 2 else (WORKERS, 1)
        found = {workers: run_equal(workers) for workers in order}
        pairs.append((found[1], found[WORKERS]))
    return "\n".join([executor_table(run_executors()), equal_table(pairs)])


def equal_table(pairs: Sequence[tuple[Shared, Shared]]) -> str:
    """What a second worker is worth."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    head = (
        f"{EQUAL_MEMBERS} members of one sweep with {EQUAL_STEPS} steps each, by one worker and by "
        f"two, pair by pair; {load} processes wanted one of {os.cpu_count()} processors in the "
        "last minute. Where others compute as well, the clock says little about the second worker: "
        "beside it stands what the processors did. Busiest: seconds of a processor of the worker "
        "that took most, its imports included; client: of the process that asks. Each on a "
        "processor of its own they end after the sum of both."
    )
    columns = ("workers", "s of the clock", "busiest", "all workers", "client", "busiest + client")
    rows = [
        (
            str(one.workers),
            f"{one.wall:.1f}",
            f"{one.busiest:.2f}",
            f"{one.total:.2f}",
            f"{one.client:.2f}",
            f"{one.alone:.2f}",
        )
        for pair in pairs
        for one in pair
    ]
    clock = ", ".join(f"{one.wall / two.wall:.2f}" for one, two in pairs)
    alone = ", ".join(f"{one.alone / two.alone:.2f}" for one, two in pairs)
    said = f"One worker to two, pair by pair: by the clock {clock}; by busiest + client {alone}."
    return "\n".join([table(head, columns, rows), said, ""])


def executor_table(rows: Sequence[Judged]) -> str:
    """The table."""
    return table(
        "Two workers, eight short runs; one of them ends its worker in the third column. "
        "Times are of the clock, of one measurement each, beside other work on the machine.",
        ("engine", "s to the last result", "MB", "finished of 7", "s after Ctrl-C", "left over"),
        [
            (
                row.name,
                f"{row.seconds:.1f}",
                f"{row.megabytes:.0f}",
                str(row.survivors),
                f"{row.ended_after:.1f}",
                str(row.left_over),
            )
            for row in rows
        ],
    )


def _child(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603
        [sys.executable, "-m", "benchmarks.executors", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )


def _of_session(leader: int) -> list[int]:
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            fields = (entry / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == leader and fields[0] != "Z":
                found.append(int(entry.name))
    return found


def _megabytes(leader: int) -> float:
    total = 0
    for one in _of_session(leader):
        with contextlib.suppress(OSError, StopIteration):
            lines = Path(f"/proc/{one}/status").read_text().splitlines()
            total += int(next(line for line in lines if line.startswith("VmRSS")).split()[1])
    return total / 1e3


def _judge(name: str, mode: str) -> dict[str, float]:
    runs = parse_config(CONFIG, "quick.yaml").experiments[0].runs()
    jobs = [Job(runs=(run,)) for run in runs]
    if mode == "interrupt":
        print("begun", flush=True)
        list(ENGINES[name](jobs, takes_minutes))
    compute: ComputeJob = dies_of_eight if mode == "death" else execute_job
    began = time.monotonic()
    finished, megabytes = 0, 0.0
    for one in ENGINES[name](jobs, compute):
        finished += len(one.stored)
        seconds = time.monotonic() - began
        megabytes = max(megabytes, _megabytes(os.getpid()))
    return {"finished": finished, "seconds": seconds if finished else 0.0, "megabytes": megabytes}


if __name__ == "__main__":
    if sys.argv[2] == "equal":
        print(json.dumps(_equal(*map(int, (sys.argv[1], *sys.argv[3:])))))
    else:
        print(json.dumps(_judge(*sys.argv[1:])))
