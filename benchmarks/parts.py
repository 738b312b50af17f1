"""What a large sweep takes that is computed in parts and joined, beside the motions themselves."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING
from unittest import mock

import numpy as np

from benchmarks.measuring import table
from fvi_cli.__main__ import main

if TYPE_CHECKING:
    from fvi_cli.runner.executors.checkpoints import CheckpointFolder
    from fvi_cli.runner.executors.jobs import Job, References, Results

MANY = """\
name: many
problem: {{kind: damped-oscillator, damping: [{{order: 0.5, coefficient: 0.1}}],
          initial: {{position: 1.0}}, final_time: 1.0, exact: none}}
method: {{rk: gauss, degree: 2, start: none}}
ladder: {{steps: [4]}}
sweep:
  problem.mass: {{from: 1.0, to: 2.0, number: {across}}}
  problem.stiffness: {{from: 1.0, to: 4.0, number: 100}}
"""
PARTS = 4

Command = tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Spent:
    """What a command took.

    Parameters
    ----------
    name
        The command.
    members
        Whom it was about.
    batches, other
        Processor seconds for motions, their stability and errors; and for all else but imports.
    peak_bytes
        Largest memory of the process.
    """

    name: str
    members: int
    batches: float
    other: float
    peak_bytes: int


def run_sweep(members: int, *, computed: bool = True) -> list[Spent]:
    """A sweep of so many members by four parts, one after the other, the merge, and a listing.

    Where they are not `computed`, the parts are files of the same form in which all members have
    the motion of the first, and only what joins and lists them is measured.
    """
    from fvi_cli.storage import read_configuration

    members = max(100, members // 100 * 100)
    with tempfile.TemporaryDirectory(prefix="fvi-sweep-") as name:
        folder = Path(name)
        text = MANY.format(across=members // 100)
        (folder / "many.yaml").write_text(text, encoding="utf-8")
        files = [f"results/many.shard-{k}-of-{PARTS}.h5" for k in range(1, PARTS + 1)]
        commands: list[tuple[Command, int]] = [
            (("run", "many.yaml", "-q", "--shard", f"{k}/{PARTS}"), members // PARTS)
            for k in range(1, PARTS + 1)
        ]
        if not computed:
            commands.clear()
            _make_up(folder, [folder / file for file in files])
        commands += [(("merge", *files), members), (("show", "results/many.h5"), members)]
        found = [measured(folder, command, count) for command, count in commands]
        if read_configuration(folder / "results" / "many.h5").text != text:
            raise RuntimeError("the merged file has another configuration")
        return found


def _make_up(folder: Path, files: Sequence[Path]) -> None:
    """Files of parts without computing their members."""
    process = os.fork()
    if process:
        if os.waitpid(process, 0)[1]:
            raise RuntimeError("the files of the parts could not be made")
        return
    from fvi_cli.config import load_config
    from fvi_cli.runner.executors.batches import batches_of
    from fvi_cli.runner.parts.shard import Shard
    from fvi_cli.storage import open_results
    from fvi_cli.studies.study import execute

    loaded = load_config(folder / "many.yaml")
    (experiment,) = loaded.experiments
    first = execute(experiment.runs()[0])
    for number, file in enumerate(files, 1):
        runs = Shard(number=number, count=len(files)).runs_of([experiment])[experiment]
        with open_results(file.parent, file.stem) as store:
            for batch in batches_of(runs):
                store.add([replace(first, run=run) for run in batch])
            store.consolidate(loaded)
    os._exit(0)


def measured(folder: Path, command: Command, members: int) -> Spent:
    """What a command takes in a process of its own, which imports what the command does."""
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-m", "benchmarks.parts", str(folder), *command],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    batches, other, peak = done.stdout.splitlines()[-1].split()
    return Spent(
        name=" ".join(command[:1] if command[0] != "run" else ("run", *command[3:])),
        members=members,
        batches=float(batches),
        other=float(other),
        peak_bytes=int(peak),
    )


def _carry_out(folder: str, *command: str) -> str:
    """What the command takes in this process: seconds for batches, for the rest, and bytes."""
    spent = [0.0]
    is_timed = contextlib.nullcontext() if command[0] != "run" else _timed_batches(spent)
    os.chdir(folder)
    sys.argv = ["fvi", *command]
    began = time.process_time()
    try:
        with is_timed:
            main()
    except SystemExit as ended:
        if ended.code:
            raise
    other = time.process_time() - began - spent[0]
    return f"{spent[0]} {other} {_peak_bytes()}"


@contextlib.contextmanager
def _timed_batches(spent: list[float]) -> Iterator[None]:
    """Add the seconds that batches take."""
    from fvi_cli.runner.executors.execute import execute_job

    def timed(job: Job, references: References, checkpoints: CheckpointFolder | None) -> Results:
        began = time.process_time()
        try:
            return execute_job(job, references, checkpoints)
        finally:
            spent[0] += time.process_time() - began

    with mock.patch("fvi_cli.runner.compute.execute_job", timed):
        yield


def _peak_bytes() -> int:
    """Largest memory of this process; the one that began it counts in ``getrusage``."""
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


def parts_page(members: int, *, computed: bool) -> str:
    """The table, and what an FFT takes at the same time."""
    rows = run_sweep(members, computed=computed)
    return _table(rows, _yardstick())


def _yardstick() -> float:
    numbers = np.random.default_rng(0).normal(size=2**20)
    began = time.process_time()
    for _ in range(10):
        np.fft.rfft(numbers)
    return (time.process_time() - began) / 10


def _table(rows: Sequence[Spent], yardstick: float) -> str:
    """The table; times in milliseconds of a processor for each member.

    Parameters
    ----------
    rows
        What was measured.
    yardstick
        Seconds of a real FFT of 2^20 points at the same time; 0.014 on a quiet core.
    """
    return table(
        f"Processor time; a real FFT of 2^20 numbers took {1e3 * yardstick:.0f} ms meanwhile, "
        "14 ms on a quiet core. Scaled: times that ratio.",
        ("command", "members", "motions, ms each", "all else, ms each", "scaled", "peak MB"),
        [
            (
                row.name,
                str(row.members),
                f"{1e3 * row.batches / row.members:.2f}",
                f"{1e3 * row.other / row.members:.2f}",
                f"{1e3 * row.other / row.members * 0.014 / yardstick:.2f}",
                f"{row.peak_bytes / 1e6:.0f}",
            )
            for row in rows
        ],
    )


if __name__ == "__main__":
    print(_carry_out(*sys.argv[1:]))
