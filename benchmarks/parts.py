"""What a large sweep takes that is computed in parts and joined, beside the motions themselves."""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.measuring import table
from benchmarks.robustness import Command
from fvi_cli.__main__ import main
from fvi_cli.runner.executors.batches import execute_batch
from fvi_cli.runner.executors.checkpoints import CheckpointFolder
from fvi_cli.runner.executors.executor import Batch
from fvi_cli.storage import read_configuration
from fvi_cli.studies.experiment import FinishedRun

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


def run_sweep(members: int) -> list[Spent]:
    """A sweep of so many members by four parts, one after the other, the merge, and a listing."""
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
        commands += [(("merge", *files), members), (("show", "results/many.h5"), members)]
        found = [measured(folder, command, count) for command, count in commands]
        if read_configuration(folder / "results" / "many.h5").text != text:
            raise RuntimeError("the merged file has another configuration")
        return found


def measured(folder: Path, command: Command, members: int) -> Spent:
    """What a command takes in a process of its own."""
    readable, writable = os.pipe()
    process = os.fork()
    if not process:
        real, spent = execute_batch, [0.0]

        def timed(batch: Batch, checkpoints: CheckpointFolder | None) -> list[FinishedRun]:
            began = time.process_time()
            try:
                return real(batch, checkpoints)
            finally:
                spent[0] += time.process_time() - began

        os.chdir(folder)
        sys.argv = ["fvi", *command]
        began = time.process_time()
        code: object = 0
        try:
            with mock.patch("fvi_cli.runner.compute.execute_batch", timed):
                main()
        except SystemExit as ended:
            code = ended.code or 0
        other = time.process_time() - began - spent[0]
        peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        os.write(writable, f"{code} {spent[0]} {other} {peak}".encode())
        os._exit(0)
    os.close(writable)
    with os.fdopen(readable) as answer:
        words = answer.read().split()
    os.waitpid(process, 0)
    if not words or words[0] != "0":
        raise RuntimeError(f"{' '.join(command)}: {' '.join(words)}")
    name = " ".join(command[:1] if command[0] != "run" else ("run", *command[3:]))
    return Spent(
        name=name,
        members=members,
        batches=float(words[1]),
        other=float(words[2]),
        peak_bytes=int(words[3]),
    )


def parts_page(members: int) -> str:
    """The table, and what an FFT takes at the same time."""
    rows = run_sweep(members)
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
