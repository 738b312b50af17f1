"""What happens to a command from outside: results that are finished survive it."""

import errno
import os
import random
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import fvi as here
from commands import (
    N_RUNS,
    QUICK,
    SLOW,
    children,
    complete_runs,
    confined,
    environment,
    first_finished,
    fvi,
    started,
)
from spread import SEED, spread

from benchmarks.robustness import ATTACKS
from fvi_cli.config import load_config
from fvi_cli.planning.plan import plan_run
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.storage.atomic import replace_file

fcntl = pytest.importorskip("fcntl", reason="limits and locks of Unix")
resource = pytest.importorskip("resource", reason="limits and locks of Unix")

pytestmark = pytest.mark.processes

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


ROOT = Path(__file__).parents[2]
FILES = {"quick.yaml": QUICK, "slow.yaml": SLOW}


# --- death ----------------------------------------------------------------------------------------


ATTACK = """
import sys
from pathlib import Path
from benchmarks.robustness import ATTACKS, preload, try_interrupts, try_kills

if __name__ == "__main__":
    folder, name, times, seed = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), sys.argv[4]
    preload()
    if name == "interrupts":
        tally = try_interrupts(folder, times, seed)
    else:
        (attack,) = (one for one in ATTACKS if one.name == name)
        tally = try_kills(folder, attack, times, "", seed)
    print(tally.count, *tally.wrong, sep="\\n")
"""
"""Commands are forked from a process that has imported what they need, and is no test."""
KILLS = ["interrupts", *(one.name for one in ATTACKS if one.name != "cluster")]
TODAY = random.Random(os.environ[SEED]).sample(KILLS, 2)


@pytest.mark.parametrize(
    ("name", "times"),
    [
        *((name, 3) for name in TODAY),
        *(pytest.param(name, 30, marks=pytest.mark.slow) for name in KILLS),
    ],
)
def test_killed_or_interrupted_at_random_moments_nothing_that_was_finished_is_lost(
    folder, name, times
):
    (folder / "attack.py").write_text(ATTACK)
    done = subprocess.run(
        [sys.executable, "attack.py", ".", name, str(times), os.environ[SEED]],
        cwd=folder,
        env={**environment(), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == [str(times), ""]


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


BEFORE_COMMANDS = """
import typer.main as made
whole = made.get_command
made.get_command = lambda one: (press(), whole(one))[1]
from fvi_cli.__main__ import main
main()
"""
BEFORE_TYPER = """
from fvi_cli.__main__ import main
class Press:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            press()
sys.meta_path.insert(0, Press())
main()
"""


@pytest.mark.parametrize("moment", [BEFORE_TYPER, BEFORE_COMMANDS])
def test_interrupted_before_it_has_begun_it_ends_without_a_word(folder, moment):
    script = (
        "import os, signal, sys\nsys.argv = ['fvi', 'list']\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        f"press = lambda: os.kill(os.getpid(), signal.SIGINT)\n{moment}"
    )
    command = [sys.executable, "-c", script]
    ended = subprocess.run(command, cwd=folder, capture_output=True, env=environment())
    assert (ended.returncode, ended.stdout, ended.stderr) == (130, b"", b"")


@needs_proc
@pytest.mark.parametrize("victim", ["worker", "server"])
def test_a_process_killed_in_the_midst_changes_nothing(folder, victim):
    expected = here("run", "quick.yaml", "--output", "undisturbed")
    process = started(folder, "run", "quick.yaml", "-v", "--workers", "2")
    with process:
        first_finished(process)
        # one process has loaded what workers need, and forks them
        (server,) = (
            child
            for child in children(process.pid)
            if "forkserver" in Path(f"/proc/{child}/cmdline").read_text()
        )
        os.kill(children(server)[0] if victim == "worker" else server, signal.SIGKILL)
        rest = process.stderr.read()
        table = process.stdout.read()
    assert process.returncode == 0, rest
    assert table.splitlines()[:-1] == expected.stdout.splitlines()[:-1]


def dies_of_64(job, references):
    """No process survives BDF2 with N = 64."""
    if any(run.n_steps == 64 and run.method.cq == "bdf2" for run in job.runs):
        os.kill(os.getpid(), signal.SIGKILL)
    return execute_job(job, references)


def test_a_run_that_no_worker_survives_is_reported_and_computed_the_next_time(folder, monkeypatch):
    monkeypatch.setattr("fvi_cli.runner.compute.execute_job", dies_of_64)
    result = here("run", "quick.yaml", "--workers", "2", code=1)
    failed = [row.split() for row in result.stdout.splitlines() if "failed" in row]
    assert [row[1:3] for row in failed] == [["BDF2", "64"]]
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
mount -t tmpfs -o size=120k tmpfs disk
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


READ_ONLY = """
mount --bind there there
mount -o remount,bind,ro there
$PYTHON commands.py
"""
# one process for all of them
COMMANDS = """
from typer.testing import CliRunner
from fvi_cli.cli.app import app
for command in (
    "run quick.yaml --output there",
    "run quick.yaml --output there/below",
    "convergence quick.yaml --output there",
    "plot quick.yaml --output there",
    "show there/quick.h5",
):
    done = CliRunner().invoke(app(command.split()), command.split())
    print(command.split()[0], "code", done.exit_code, done.stderr)
"""


def test_in_a_folder_that_is_read_only_it_says_so(folder):
    here("run", "quick.yaml", "--output", "there", "--set", "ladder.steps=[4]", "-q", code=0)
    (folder / "commands.py").write_text(COMMANDS)
    done = confined(folder, READ_ONLY)
    if done is None:
        pytest.skip("nothing may be mounted here")
    assert "Traceback" not in done.stdout + done.stderr
    assert done.stdout.count("code 2") == 4, done.stdout + done.stderr
    assert done.stdout.count("cannot be written: Read-only file system") == 4, done.stdout
    # reading needs no writing
    assert "show code 0" in done.stdout
    assert len(complete_runs(folder / "there" / "quick.h5")) == 3


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_in_a_folder_of_somebody_else_it_says_so(folder):
    (folder / "there").mkdir(mode=0o555)
    done = fvi(folder, "run", "quick.yaml", "--output", "there")
    assert done.returncode == 2
    assert "cannot be written: Permission denied" in done.stderr


@pytest.mark.parametrize("arguments", ["quick.yaml -v -j 2", "--no-such"])
@pytest.mark.parametrize("redirection", ["2>&-", "2>/dev/full"])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
def test_where_nobody_can_be_told_commands_end_as_elsewhere(folder, arguments, redirection):
    command = f"{sys.executable} -m fvi_cli run {arguments} {redirection}"
    done = subprocess.run(
        ["sh", "-c", command], cwd=folder, env=environment(), capture_output=True, check=False
    )
    if arguments == "--no-such":
        assert done.returncode == 2
        return
    assert done.returncode == 0
    assert len(complete_runs(folder / "results" / "quick.h5")) == N_RUNS
    assert len(done.stdout.splitlines()) == N_RUNS + 2


def test_what_a_killed_process_left_of_a_table_goes_with_the_next_one(folder):
    abandoned, alive = folder / ".a.md.x.part", folder / ".a.md.y.part"
    abandoned.write_text("half")
    with alive.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        replace_file(folder / "a.md", b"whole")
        assert not abandoned.exists()
        assert alive.exists()
    assert (folder / "a.md").read_bytes() == b"whole"


# --- two at a time --------------------------------------------------------------------------------


def test_two_commands_on_one_file_do_not_meet(folder):
    first = started(folder, "run", "slow.yaml", "-v")
    with first:
        first_finished(first)
        second = here("run", "quick.yaml", code=2)
        assert second.stderr == (
            "fvi: results/quick.h5: another fvi is writing it; wait until it has ended (--wait "
            "does), or choose another folder with --output\n"
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


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_told(folder, monkeypatch, number):
    def refuse(handle, operation):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", refuse)
    result = here("run", "quick.yaml", code=2)
    assert "cannot be locked" in result.stderr
    assert "file system without locks" in result.stderr
    assert "--output" in result.stderr
    assert [p.name for p in (folder / "results").iterdir()] == [".quick.h5.lock"]


# --- memory ---------------------------------------------------------------------------------------


def test_runs_for_which_there_is_no_memory_are_refused_before_anything_is_computed(
    folder, monkeypatch
):
    result = here("run", "quick.yaml", "--set", "ladder.steps=[4, 1073741824]", code=2)
    assert "of memory, this machine has" in result.stderr
    assert not (folder / "results").exists()
    # each of these would have room, and any two, but not three at a time
    steps = "ladder.steps=[4, 3000]"
    (experiment,) = load_config(folder / "quick.yaml", overrides=[steps]).experiments
    methods = experiment.methods
    sizes = [
        plan_run(experiment.problem.scene, m, n).memory_bytes
        for m in methods
        for n in experiment.steps
    ]
    largest = sorted(sizes, reverse=True)
    room = (sum(largest[:2]) + sum(largest[:3])) // 2
    monkeypatch.setattr("fvi_cli.config.memory.machine_bytes", lambda: room)
    arguments = ("run", "quick.yaml", "--set", steps)
    result = here(*arguments, "--workers", "3", code=2)
    assert "--workers 3" in result.stderr
    assert "GB" in result.stderr
    assert not (folder / "results").exists()
    here(*arguments, "--workers", "2", "--dry-run", code=0)
    here(*arguments, code=0)


def test_an_allocation_that_fails_is_told_and_what_is_finished_is_stored(folder):
    """An address space in which the long run finds no room, on a machine that does not tell."""

    def starve():
        resource.setrlimit(resource.RLIMIT_AS, (900_000_000, 900_000_000))

    arguments = ("run", "quick.yaml", "--set", "method.bdf=1", "--set")
    script = (
        "import sys; from fvi_cli.config import memory as machine; "
        # what nobody tells cannot be planned for
        "machine._of_machine = machine._of_groups = machine._of_address_space = lambda root: (); "
        "from fvi_cli.__main__ import main; sys.exit(main())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments, "ladder.steps=[4, 8, 100000000]"],
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=starve,
    )
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "N=100000000: failed, error nan (not enough memory" in done.stderr
    assert [row.split()[-1] for row in done.stdout.splitlines()[1:-1]] == ["ok", "ok", "failed"]
    # it says nothing of the method: the next time it is tried again
    stored = {f"bdf1-nodes-s1-gauss1-none N={n}" for n in (4, 8)}
    assert complete_runs(folder / "results" / "quick.h5") == stored
    done = fvi(folder, *arguments, "ladder.steps=[4, 8, 16]", preexec_fn=starve)
    assert done.returncode == 0, done.stderr
