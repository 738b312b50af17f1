"""What happens to a command from outside: batches that are finished survive it."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import LADDER
from command_line import fvi as here
from spread import spread
from stored_runs import kept_in

import fvi_cli
from fvi_cli.runner.request import load

pytest.importorskip("fcntl", reason="limits and locks of Unix")
pytestmark = pytest.mark.processes

QUICK = LADDER.replace("48]", "48, 64, 96]")
# nonlinear: the last run takes minutes, in little memory
SLOW = """\
name: quick
problem: {kind: duffing, forcing: 0.3*cos(1.2*t), final_time: 1.0, exact: none}
method: {bdf: 1, sampling: nodes, degree: 1}
ladder: {steps: [8, 16, 5000000]}
"""
FILES = {"quick.yaml": QUICK, "slow.yaml": SLOW}
FEW = ("--set", "ladder.steps=[8, 16]")


COMMAND = [sys.executable, "-m", "fvi_cli"]


def environment() -> dict[str, str]:
    """Variables for a process that runs the package which is tested here."""
    package = str(Path(fvi_cli.__file__).parents[1])
    search = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
    # buffered as users have it: what a stream refuses stays in the buffer
    return {**os.environ, "PYTHONPATH": search, "PYTHONUNBUFFERED": ""}


def started(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    """Begin a command in `folder`; its standard error can be read line by line."""
    return subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def confined(folder: Path, script: str) -> subprocess.CompletedProcess[str] | None:
    """Run a shell script with mounts of its own, ``$FVI`` being the command, ``$PYTHON`` Python.

    None where the system allows nobody to mount anything.
    """
    if shutil.which("unshare") is None:
        return None
    prefix = ["unshare", "--map-root-user", "--mount", "sh", "-euc"]
    probe = [*prefix, "mount -t tmpfs tmpfs ."]
    if subprocess.run(probe, cwd=folder, capture_output=True, check=False).returncode:
        return None
    return subprocess.run(
        [*prefix, script],
        cwd=folder,
        env={**environment(), "FVI": " ".join(COMMAND), "PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def complete_runs(path: Path, config: str = "quick.yaml") -> int:
    """How many runs of a configuration are in a file, which must be readable, and in its parts."""
    return kept_in(path, [run for one in load(config).experiments for run in one.runs()])


def wait_for_parts(folder, count: int) -> None:
    """Wait until a command has stored so many parts, its configuration among them."""
    for _ in range(1200):
        if len(list((folder / "results/quick.partial").glob("*.h5"))) >= count:
            return
        time.sleep(0.05)
    raise AssertionError("no part")


@pytest.mark.parametrize("options", [(), ("-j", "2")])
def test_a_killed_command_loses_what_is_under_way(folder, options):
    process = started(folder, "run", "slow.yaml", *options)
    with process:
        wait_for_parts(folder, 2)
        process.kill()
    assert complete_runs(folder / "results/quick.h5", "slow.yaml") == 2
    # any command finds the runs
    assert here("show", "results/quick.h5", code=0).stdout.count(" ok\n") == 2
    again = here("run", "slow.yaml", "-v", *FEW, code=0)
    assert "quick: 2 runs, 2 of them stored" in again.stderr


@spread(number=[signal.SIGINT, signal.SIGTERM], options=[(), ("-j", "2")])
def test_an_interrupted_command_keeps_what_is_finished_and_exits_130(folder, number, options):
    process = started(folder, "run", "slow.yaml", *options)
    with process:
        wait_for_parts(folder, 2)
        process.send_signal(number)
        rest = process.stderr.read()
        assert process.stdout.read() == ""
    assert process.returncode == 130
    assert "interrupted" in rest
    assert "Traceback" not in rest
    # folded, and no part left
    assert sorted(p.name for p in (folder / "results").iterdir()) == ["quick.h5"]
    rows = here("run", "slow.yaml", "--dry-run").stdout.splitlines()[1:]
    assert [("reuse" in row) for row in rows] == [True, True, False]


DYING = """
import os, sys
from fvi_cli.runner import work
usual = work.compute
def compute(batch):
    if any(run.n_steps == 9001 for run in batch.runs):
        os._exit(3)
    return usual(batch)
work.compute = compute
"""


def test_a_worker_that_dies_costs_its_own_batch(folder, monkeypatch):
    (folder / "sitecustomize.py").write_text(DYING)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    steps = ("--set", "ladder.steps=[5000, 5001, 5002, 5003, 5004, 9001]", "--set", "method.bdf=2")
    with started(folder, "run", "quick.yaml", "-j", "2", *steps) as process:
        out, err = process.communicate()
    assert process.returncode == 1
    assert "BrokenProcessPool" in err
    assert "Traceback" not in err
    assert ["9001" in row.split() for row in out.splitlines() if "failed" in row] == [True]
    monkeypatch.undo()
    os.chdir(folder)
    again = here("run", "quick.yaml", "-v", *steps, code=0)
    assert "6 runs, 5 of them stored" in again.stderr


CRAMPED = """
mkdir disk
mount -t tmpfs -o size=80k tmpfs disk
cp before.h5 disk/quick.h5
set +e
$FVI run quick.yaml --set ladder.steps='[4, 3000, 4096]' --output disk -q
echo "code $?"
set -e
$FVI run quick.yaml --set ladder.steps='[4]' --output disk --dry-run
test -z "$(find disk -name '*.tmp')"
mount -o remount,size=64m tmpfs disk
$FVI run quick.yaml --output disk
cp disk/quick.h5 after.h5
"""


def test_on_a_full_disk_it_says_so_and_goes_on_where_there_is_room_again(folder):
    here("run", "quick.yaml", "--output", "few", "--set", "ladder.steps=[4]", "-q", code=0)
    (folder / "few" / "quick.h5").rename(folder / "before.h5")
    done = confined(folder, CRAMPED)
    if done is None:
        pytest.skip("nothing may be mounted here")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    assert re.search(r"^fvi: .*cannot be written: No space left on device", done.stderr, re.M)
    assert "code 2" in done.stdout
    assert done.stdout.count("reuse") == 3
    assert complete_runs(folder / "after.h5") == 24


MANY = """\
name: many
problem: {kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0, exact: none}
method: {rk: gauss, degree: 2}
ladder: {steps: [64]}
sweep: {problem.stiffness: {from: 1.0, to: 4.0, number: 400}}
"""


def test_two_commands_and_shards_share_the_work(folder):
    (folder / "many.yaml").write_text(MANY)
    with (
        started(folder, "run", "many.yaml") as first,
        started(folder, "run", "many.yaml") as second,
    ):
        assert first.wait() == second.wait() == 0
    assert complete_runs(folder / "results/many.h5", "many.yaml") == 400
    for number in (1, 2, 3):
        here("run", "many.yaml", "-q", "-o", "parts", "--shard", f"{number}/3", code=0)
        assert not (folder / "parts/many.h5").exists()
    again = here("run", "many.yaml", "-v", "-o", "parts", code=0)
    assert "many: 400 runs, 400 of them stored" in again.stderr
    assert not (folder / "parts/many.partial").exists()


def test_runs_for_which_there_is_no_memory_are_refused_before_anything_is_computed(folder):
    result = here("run", "quick.yaml", "--set", "ladder.steps=[4, 1073741824]", code=2)
    assert "of memory, this machine has" in result.stderr
    assert not (folder / "results").exists()
