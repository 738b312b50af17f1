"""What happens to a command from outside: results that are finished survive it."""

import os
import re
import signal

import pytest
from command_line import fvi as here
from commands import (
    N_RUNS,
    QUICK,
    SLOW,
    complete_runs,
    confined,
    first_finished,
    started,
)
from spread import spread

from fvi_cli.runner.executors.execute import execute_job

fcntl = pytest.importorskip("fcntl", reason="limits and locks of Unix")
resource = pytest.importorskip("resource", reason="limits and locks of Unix")

pytestmark = pytest.mark.processes

FILES = {"quick.yaml": QUICK, "slow.yaml": SLOW}


# --- death ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [(), ("--workers", "2")])
def test_killed_in_the_midst_it_loses_what_is_under_way(folder, options):
    process = started(folder, "run", "slow.yaml", "-v", *options)
    with process:
        first_finished(process, 2)
        process.kill()
    # the last one that was told may not have been flushed
    kept = len(complete_runs(folder / "results" / "quick.h5"))
    assert kept >= 1
    again = here("run", "slow.yaml", "--set", "ladder.steps=[8, 16, 24]", code=0)
    assert f"quick: 3 runs, {kept} of them stored" in again.stderr
    assert len(complete_runs(folder / "results" / "quick.h5")) == 3


@spread(number=[signal.SIGINT, signal.SIGTERM], options=[(), ("--workers", "2")])
def test_interrupted_it_stores_what_is_finished_and_exits_130(folder, number, options):
    process = started(folder, "run", "slow.yaml", "-v", *options)
    with process:
        first_finished(process, 2)
        process.send_signal(number)
        rest = process.stderr.read()
        assert process.stdout.read() == ""
    assert process.returncode == 130
    assert "interrupted" in rest
    assert "Traceback" not in rest
    # consolidated, and no part left
    assert sorted(p.name for p in (folder / "results").iterdir()) == [".quick.h5.lock", "quick.h5"]
    assert len(complete_runs(folder / "results" / "quick.h5")) == 2
    rows = here("run", "slow.yaml", "--dry-run").stdout.splitlines()[1:]
    assert [("reuse" in row) for row in rows] == [True, True, False]


def dies_of_64(job, references):
    """No process survives BDF2 with N = 64."""
    if any(run.n_steps == 64 and run.method.cq == "bdf2" for run in job.runs):
        os.kill(os.getpid(), signal.SIGKILL)
    return execute_job(job, references)


def test_a_run_that_no_worker_survives_is_reported_and_computed_the_next_time(folder, monkeypatch):
    monkeypatch.setattr("fvi_cli.runner.compute.execute_job", dies_of_64)
    result = here("run", "quick.yaml", "--workers", "2", code=1)
    failed = [row.split() for row in result.stdout.splitlines() if "failed" in row]
    assert [row[1:4] for row in failed] == [["BDF2", "(nodes)", "64"]]
    assert "ended by SIGKILL (out of memory?), 2 times" in result.stderr
    assert len(complete_runs(folder / "results" / "quick.h5")) == N_RUNS - 1
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    again = here("run", "quick.yaml", code=0)
    assert f"{N_RUNS} runs, {N_RUNS - 1} of them stored" in again.stderr
    assert "failed" not in again.stdout


# --- places that refuse ---------------------------------------------------------------------------

CRAMPED = """
mkdir disk
mount -t tmpfs -o size=80k tmpfs disk
cp before.h5 disk/quick.h5
set +e
$FVI run quick.yaml --output disk -q
echo "code $?"
cmp disk/quick.h5 before.h5 && echo "as it was"
set -e
cp disk/quick.journal before.journal
test -z "$(ls -A disk | grep part$ || true)"
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
    assert "as it was" in done.stdout
    stored = len(complete_runs(folder / "before.h5"))
    assert 3 < stored < N_RUNS
    # those in the file and those in the journal are not computed again
    assert f"quick: {N_RUNS} runs, {stored} of them stored" in done.stderr
    assert len(complete_runs(folder / "after.h5")) == N_RUNS


# --- two at a time --------------------------------------------------------------------------------


def test_two_commands_on_one_file_do_not_meet(folder):
    first = started(folder, "run", "slow.yaml", "-v")
    with first:
        first_finished(first)
        second = here("run", "quick.yaml", code=2)
        assert second.stderr == (
            "fvi: results/quick.h5: another fvi is writing it; wait until it has ended, "
            "or choose another folder with --output\n"
        )
        assert second.stdout == ""
        # neither looking nor another folder is forbidden, nor another file of the same folder
        here("run", "quick.yaml", "--dry-run", code=0)
        here("run", "quick.yaml", "--output", "other", "-q", code=0)
        (folder / "beside.yaml").write_text(QUICK.replace("name: quick", "name: beside"))
        here("run", "beside.yaml", "-q", code=0)
        assert len(complete_runs(folder / "results" / "beside.h5")) == N_RUNS
        first.kill()
    here("run", "quick.yaml", code=0)


# --- memory ---------------------------------------------------------------------------------------


def test_runs_for_which_there_is_no_memory_are_refused_before_anything_is_computed(folder):
    result = here("run", "quick.yaml", "--set", "ladder.steps=[4, 1073741824]", code=2)
    assert "of memory, this machine has" in result.stderr
    assert not (folder / "results").exists()
