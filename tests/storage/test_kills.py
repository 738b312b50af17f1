"""Commands that are killed at any time lose nothing but batches under way."""

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config import parse_config
from fvi_cli.storage import Store
from fvi_cli.storage.files import UNFINISHED

KILLS = 40
CONFIG = """\
name: many
problem:
  {kind: duffing, forcing: 0.3*cos(1.2*t), initial: {position: 1.0}, final_time: 20.0, exact: none}
method: {rk: gauss, degree: 2}
ladder: {steps: [64, 128, 256, 512, 1024]}
sweep: {problem.initial.position: {from: 0.1, to: 2.0, number: 512}}
"""


@pytest.mark.slow
@pytest.mark.processes
@pytest.mark.skipif(os.name == "nt", reason="groups of processes of Unix")
def test_kills_at_any_time_lose_nothing_that_is_stored(tmp_path):
    (tmp_path / "many.yaml").write_text(CONFIG)
    runs = parse_config(CONFIG, "many.yaml").experiments[0].runs()
    drawn, computing, stored = random.Random(44), 0, set[tuple[int, int]]()
    command = [sys.executable, "-m", "fvi_cli", "run", "many.yaml", "-j", "2", "-q"]
    for _ in range(KILLS):
        process = subprocess.Popen(
            command, cwd=tmp_path, start_new_session=True, stdout=subprocess.DEVNULL
        )
        time.sleep(drawn.uniform(0.5, 5.0))
        was_computing = process.poll() is None and (tmp_path / "results/many.partial").exists()
        # the command alone, or its workers too
        if drawn.random() < 0.5:
            process.kill()
        else:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        found = Store(tmp_path / "results/many.h5").read(runs, motions=False)
        now = {(run.n_steps, run.member.number) for run in found}
        assert stored <= now
        computing += was_computing
        stored = now
        if len(now) == len(runs):
            shutil.rmtree(tmp_path / "results")
            stored = set()
    print(f"{computing} of {KILLS} kills hit while computing")  # noqa: T201
    subprocess.run(command, cwd=tmp_path, check=True)
    assert not list((tmp_path / "results").rglob(f"*{UNFINISHED}"))
    (fresh,) = fvi.run(parse_config(CONFIG, "many.yaml"))
    (kept,) = fvi.recall(tmp_path / "results/many.h5")
    for one, other in zip(fresh.finished, kept.finished, strict=True):
        assert np.array_equal(one.trajectory.position, other.trajectory.position)
    assert computing > KILLS // 2
