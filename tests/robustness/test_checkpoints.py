"""A command that is ended in the midst of a long run goes on from its checkpoint."""

import errno
import hashlib
import logging
import os
import signal
import time
from pathlib import Path

import command_line
import h5py
import pytest
from commands import started
from every_process import change_every_process
from spread import spread

from benchmarks.robustness import LADDER
from fvi_cli.config import load_config
from fvi_cli.integrator.run import loop
from fvi_cli.integrator.run.checkpoint import Checkpoint
from fvi_cli.runner.executors.checkpoints import CheckpointFile, CheckpointFolder

N = 400
LONG = f"""\
{LADDER.replace("quick", "long").partition("method")[0]}\
method: {{rk: gauss, degree: 2, start: none}}
ladder: {{steps: [4, {N}]}}
"""
FILE = Path("results/long.h5")
PARTS = Path("results/long.parts")
CHUNK = loop.CHUNK


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(loop, "CHUNK", 64)
    (tmp_path / "long.yaml").write_text(LONG)
    return tmp_path


def fvi(*arguments: object, code: int = 0):
    return command_line.fvi(*arguments, code=code)


def run(*options, code=0):
    return fvi("run", "long.yaml", "--checkpoint-every", "0", *options, code=code)


def digest_of(group):
    """Of all numbers of a group."""
    found = hashlib.sha256()

    def note(name, one):
        if isinstance(one, h5py.Dataset) and one.dtype == float and "seconds" not in name:
            found.update(name.encode() + one[()].tobytes())

    group.visititems(note)
    return found.hexdigest()


def digests(path=FILE):
    with h5py.File(path, "r") as file:
        (runs,) = file["long"].values()
        return {name: digest_of(one) for name, one in runs.items() if name[0] == "n"}


def watched(*options, stop=None, of=""):
    """What a run says, and the steps of the checkpoints that it writes of runs called so.

    When so many have been written, a Ctrl-C stops it.
    """
    real, written = CheckpointFile.save, []

    def save(self, unfinished):
        real(self, unfinished)
        if of not in self.title:
            return
        written.append(unfinished.reported)
        if len(written) == stop:
            raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(CheckpointFile, "save", save)
        return run(*options, code=130 if stop else 0).stderr, written


@pytest.fixture(scope="module")
def straight(tmp_path_factory):
    """The numbers of the run when nothing ends it."""
    folder = tmp_path_factory.mktemp("straight")
    (folder / "long.yaml").write_text(LONG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "CHUNK", 64)
        fvi("run", folder / "long.yaml", "-o", folder)
    return digests(folder / "long.h5")


@pytest.mark.few(1)
@pytest.mark.parametrize(
    "options",
    [
        ("--set", "store={every: 7}"),
        ("--set", "quantities={force: dx}"),
        ("--set", "method={bdf: 4, degree: 2}"),
    ],
)
def test_the_same_command_goes_on_after_two_interruptions(options):
    run("-o", "straight", *options)
    watched(*options, stop=3, of=f"N={N}")
    planned = fvi("run", "long.yaml", "--dry-run", *options).stdout
    assert f"resume at step 192 of {N}" in planned
    again, written = watched(*options, stop=2, of=f"N={N}")
    assert f"resume at step 192 of {N}" in again
    assert written == [256, 320]
    rest = run(*options)
    assert f"resume at step 320 of {N}" in rest.stderr
    assert digests() == digests(Path("straight/long.h5"))
    assert sorted(p.name for p in FILE.parent.iterdir()) == [".long.h5.lock", "long.h5"]


def test_fresh_begins_at_the_start():
    watched(stop=3)
    assert "resume at step" not in fvi("run", "long.yaml", "--dry-run", "--fresh").stdout
    told, written = watched("--fresh", stop=1)
    assert "resume at step" not in told
    assert written == [64]


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda content: content[: len(content) // 2], "it is damaged"),
        (lambda content: b"", "it is damaged"),
        (lambda content: content.replace(b"kept x", b"kept y"), "it is damaged"),
        (None, "it belongs to another run, or to another version of the solver"),
    ],
)
def test_what_cannot_be_believed_is_ignored_with_a_line(straight, spoil, reason):
    watched(stop=3)
    (path,) = PARTS.glob("*.checkpoint")
    if spoil is None:
        watched("--set", "store={every: 3}", stop=3)
        (foreign,) = set(PARTS.glob("*.checkpoint")) - {path}
        foreign.replace(path)
    else:
        path.write_bytes(spoil(path.read_bytes()))
    assert "resume" not in fvi("run", "long.yaml", "--dry-run").stdout
    told = run().stderr.splitlines()
    (line,) = [line for line in told if "is ignored" in line]
    assert line.startswith(f"long Gauss2, N={N}: checkpoint {path} is ignored: {reason}")
    assert digests() == straight
    assert not PARTS.exists()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with names")
def test_a_pipe_is_not_read_for_ever(straight):
    watched(stop=3)
    (path,) = PARTS.glob("*.checkpoint")
    path.unlink()
    os.mkfifo(path)
    assert "resume" not in fvi("run", "long.yaml", "--dry-run").stdout
    told = run().stderr
    assert f"checkpoint {path} is ignored: it is not a file; the run begins at its start" in told
    assert digests() == straight


def test_a_full_disk_is_told_once_and_the_run_goes_on(monkeypatch):
    def write(self, stream, label):
        raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(Checkpoint, "write", write)
    told = [line for line in run().stderr.splitlines() if "cannot be written" in line]
    assert len(told) == 1
    assert "No space left on device; the run goes on without a new checkpoint" in told[0]
    assert set(digests()) == {"n000004", f"n{N:06d}"}
    assert not PARTS.exists()


def test_a_checkpoint_is_kept_while_it_is_not_due(monkeypatch, folder):
    (*_, last) = load_config(Path("long.yaml")).experiments[0].runs()
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    one = CheckpointFolder(folder=folder, seconds=60.0).of((last,))
    assert not one.is_due()
    clock[0] = 59.0
    assert not one.is_due()
    clock[0] = 60.0
    assert one.is_due()


def test_checkpoints_that_are_long_to_write_are_rare(monkeypatch, folder):
    (*_, last) = load_config(Path("long.yaml")).experiments[0].runs()
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])

    def write(self, stream, label):
        clock[0] += 10.0

    monkeypatch.setattr(Checkpoint, "write", write)
    one = CheckpointFolder(folder=folder, seconds=60.0).of((last,))
    one.save(Checkpoint.__new__(Checkpoint))
    clock[0] += 199.0
    assert not one.is_due()
    clock[0] += 1.0
    assert one.is_due()


def test_a_stored_run_leaves_no_checkpoint_behind():
    """As after a kill between the writing of the run and the removal of its checkpoint."""
    watched(stop=3)
    (path,) = PARTS.glob("*.checkpoint")
    content = path.read_bytes()
    run()
    PARTS.mkdir()
    path.write_bytes(content)
    run()
    assert not PARTS.exists()


ALONE = """\
name: long
problem:
  kind: pendulum
  damping: [{order: 0.5, coefficient: 0.1}]
  initial: {position: 1.0}
  final_time: 2.0
  exact: none
method: {rk: gauss, degree: 2, start: none}
ladder: {steps: [12], grading: 2}
sweep: {problem.omega: [0.5, 1]}
"""
WALL = (
    ALONE.partition("sweep")[0].replace(", grading: 2", "")
    + """\
impacts: {wall: {when: x - 0.2, restitution: 0.9}}
quantities: {force: dx}
"""
)
SEARCH = ALONE.partition("method")[0] + "accuracy: {tolerance: 1e-6}\n"
UNIFORM = SEARCH.replace("tolerance: 1e-6", "mesh: uniform, tolerance: 1e-3")
TOGETHER = (
    ALONE.replace("kind: pendulum", "kind: damped-oscillator")
    .replace("{steps: [12], grading: 2}", "{steps: [900]}")
    .replace("problem.omega: [0.5, 1]", "problem.stiffness: [1, 2, 3, 4, 5]")
)
KINDS = {
    "members": ALONE,
    "together": TOGETHER,
    "impacts": WALL,
    "search": SEARCH,
    "uniform": UNIFORM,
}


def stored(path=FILE):
    """Checksums of all runs of a file."""
    found = {}

    def note(name, one):
        if "specification" in one.attrs:
            found[name] = digest_of(one)

    with h5py.File(path, "r") as file:
        file.visititems(note)
    return found


@pytest.mark.few(2)
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_run_goes_on(folder, kind):
    (folder / "long.yaml").write_text(KINDS[kind])
    _, counted = watched("-o", "straight")
    watched(stop=len(counted) * 2 // 3)
    assert list(PARTS.glob("*.checkpoint"))
    assert "resume" in fvi("run", "long.yaml", "--dry-run").stdout
    told, written = watched()
    assert "resume" in told
    assert len(written) <= len(counted) - len(counted) * 2 // 3
    assert stored() == stored(Path("straight/long.h5"))
    assert not PARTS.exists()


def test_what_was_kept_of_a_search_is_forgotten_by_fresh(folder):
    (folder / "long.yaml").write_text(SEARCH)
    watched(stop=8)
    assert "resume at step" not in fvi("run", "long.yaml", "--dry-run", "--fresh").stdout
    assert "resume" not in run("--fresh").stderr
    assert not PARTS.exists()


def test_runs_among_others_are_kept_whole_where_they_took_their_time(folder):
    (*_, last) = load_config(Path("long.yaml")).experiments[0].runs()
    checkpoints = CheckpointFolder(folder=folder, seconds=60.0)
    assert not checkpoints.of((last,)).is_kept_whole(1e6)
    for one in (
        checkpoints.of((last,), is_stored_next=False),
        checkpoints.of((last,)).of_run("second"),
    ):
        assert not one.is_kept_whole(0.9)
        assert one.is_kept_whole(1.1)


FIVE_CHUNKS = 5 * CHUNK
LADDER_OF_FIVE_CHECKPOINTS = (
    LONG.replace(f"[4, {N}]", f"[4, {FIVE_CHUNKS}]") + "store: {every: 1024}\n"
)
HELD = """\
import time
from fvi_cli.runner.executors.checkpoints import CheckpointFile

save = CheckpointFile.save


def save_and_wait(self, unfinished):
    save(self, unfinished)
    time.sleep(3600)


CheckpointFile.save = save_and_wait
"""
"""Who ends a run at its first checkpoint finds it there, however late he comes."""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The numbers of the long run when nothing ends it."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "long.yaml").write_text(LADDER_OF_FIVE_CHECKPOINTS)
    fvi("run", folder / "long.yaml", "-o", folder)
    return digests(folder / "long.h5")


def stop_at_a_checkpoint(folder, monkeypatch, command, number):
    with monkeypatch.context() as patch:
        change_every_process(folder, patch, HELD)
        with started(folder, *command) as process:
            while not list(PARTS.glob("*.checkpoint")):
                assert process.poll() is None, process.stderr.read()
                time.sleep(0.02)
            process.send_signal(number)
            process.communicate()


@pytest.mark.processes
@spread(number=[signal.SIGINT, signal.SIGTERM, signal.SIGKILL], options=[("--workers", "2"), ()])
def test_the_same_command_goes_on_after_a_signal(folder, monkeypatch, undisturbed, number, options):
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    (folder / "long.yaml").write_text(LADDER_OF_FIVE_CHECKPOINTS)
    command = ("run", "long.yaml", "--checkpoint-every", "0", *options)
    stop_at_a_checkpoint(folder, monkeypatch, command, number)
    logging.getLogger("fvi_cli").handlers.clear()
    rest = fvi("run", "long.yaml")
    assert f"N={FIVE_CHUNKS}: resume at step {CHUNK} of {FIVE_CHUNKS}" in rest.stderr
    assert digests() == undisturbed
    assert not PARTS.exists()


@pytest.mark.processes
@spread(kind=["members", "impacts", "search"], options=[(), ("--workers", "2")])
def test_every_kind_of_run_goes_on_after_a_kill(folder, monkeypatch, kind, options):
    (folder / "long.yaml").write_text(KINDS[kind])
    command = ("run", "long.yaml", "--checkpoint-every", "0", *options)
    stop_at_a_checkpoint(folder, monkeypatch, command, signal.SIGKILL)
    logging.getLogger("fvi_cli").handlers.clear()
    assert "resume" in fvi("run", "long.yaml").stderr
    fvi("run", "long.yaml", "-o", "straight")
    assert stored() == stored(Path("straight/long.h5"))
    assert not PARTS.exists()
