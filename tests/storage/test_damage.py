"""Faults, kills and damage: nothing that was stored is lost, and nothing wrong is read."""

import io
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from stored_runs import (
    added,
    configuration,
    found_in,
    places,
    store,
    tree,
)

import fvi_cli
from fvi_cli.errors import StorageError
from fvi_cli.storage import list_runs, open_results, read_configuration, read_results
from fvi_cli.storage import stream as stream_module
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.digests import FORMAT
from fvi_cli.storage.stream import SafeStream
from fvi_cli.studies.experiment import FinishedRun

# --- faults ---------------------------------------------------------------------------------------


def in_a_process(code: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    package = str(Path(fvi_cli.__file__).parents[1])
    here = Path(__file__).parent
    search = os.pathsep.join([str(here), str(here.parent), package])
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(code), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**os.environ, "PYTHONPATH": search},
        **options,
    )


KILLED = """
    import os, signal, sys
    from pathlib import Path
    import stored_runs as t
    from fvi_cli.storage.journal import Journal
    folder, place, moment = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    runs = t.made_runs()
    owner = Path if place == "replace" else Journal
    real, calls = getattr(owner, place), 0
    def killed(*arguments):
        global calls
        calls += 1
        if calls == moment:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments)
    setattr(owner, place, killed)
    t.store(folder, runs)
"""


@pytest.mark.processes
@pytest.mark.parametrize(
    ("place", "moment", "left"),
    [("append", 1, 0), ("append", 5, 4), ("replace", 1, 8), ("remove", 1, 8)],
)
def test_killed_at_any_moment_no_run_is_lost_that_was_added(tmp_path, runs, place, moment, left):
    done = in_a_process(KILLED, tmp_path, place, moment)
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert (tmp_path / "sample.h5").exists() == (place == "remove")
    assert found_in(tmp_path, runs) == [k < left for k in range(8)]
    store(tmp_path, runs[left:])
    # nothing half written is left
    assert sorted(tree(tmp_path)) == ["sample.h5"]
    assert len(places(tmp_path / "sample.h5")) == 8


def test_runs_of_a_journal_are_read_beside_and_without_the_file(tmp_path, runs):
    added(tmp_path, runs[:1])
    assert found_in(tmp_path, runs[:2]) == [True, False]
    store(tmp_path, [runs[1]])
    added(tmp_path, [runs[2]])
    before = tree(tmp_path)
    assert found_in(tmp_path, runs[:4]) == [True, True, True, False]
    assert tree(tmp_path) == before


@pytest.mark.parametrize("limit", [0, 1000, 5000, 30_000])
def test_a_full_disk_is_told_and_destroys_nothing(tmp_path, runs, limit):
    resource = pytest.importorskip("resource", reason="limits of Unix")
    path = store(tmp_path, runs[:2])
    before = path.read_bytes()
    assert len(before) > 30_000
    told = []
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with open_results(tmp_path, "sample") as results:
        for finished in runs[2:]:
            results.add([finished])
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            for write in (
                lambda: results.consolidate(configuration()),
                lambda: results.add([runs[0]]),
            ):
                try:
                    write()
                except StorageError as error:
                    told.append(str(error))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert told[0] == (
        f"{path}: cannot be written: File too large; finished runs are kept in "
        f"{tmp_path / 'sample.journal'}"
    )
    if limit <= 5000:
        assert told[1].endswith("cannot be written: File too large")
    assert path.read_bytes() == before
    assert not [name for name in tree(tmp_path) if name.endswith(".part")]
    assert all(found_in(tmp_path, runs))


def test_a_folder_that_cannot_be_made_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(StorageError, match=r"file/below: cannot be written: Not a directory"),
        open_results(tmp_path / "file" / "below", "sample"),
    ):
        pass
    with (
        pytest.raises(StorageError, match=r"file: cannot be written: File exists"),
        open_results(tmp_path / "file", "sample"),
    ):
        pass
    assert list(tree(tmp_path)) == ["file"]


def test_a_folder_that_may_not_be_written_is_told(path, runs, monkeypatch):
    before = tree(path.parent)

    def refuse(*arguments: object, **keywords: object) -> None:
        raise PermissionError(13, "Permission denied")

    with open_results(path.parent, "sample", fresh=True) as results:
        monkeypatch.setattr(Path, "touch", refuse)
        with pytest.raises(
            StorageError, match=r"sample\.journal: cannot be written: Permission denied"
        ):
            results.add([runs[0]])
    monkeypatch.undo()
    assert tree(path.parent) == before


def damaged(path: Path, how: str) -> None:
    content = path.read_bytes()
    if how == "empty":
        path.write_bytes(b"")
    elif how == "text":
        path.write_text("no HDF5")
    elif how == "cut":
        path.write_bytes(content[: len(content) // 2])
    elif how == "foreign":
        path.unlink()
        with h5py.File(path, "w") as file:
            file["x"] = 1.0
    elif how == "newer":
        with h5py.File(path, "r+") as file:
            file.attrs["format"] = FORMAT + 1
    elif how == "older":
        with h5py.File(path, "r+") as file:
            file.attrs["format"] = 3
    else:
        path.unlink()
        path.mkdir()


KINDS = {
    "empty": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "text": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "cut": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "foreign": "was not written by fvi",
    "newer": f"has format {FORMAT + 1}, this version of fvi reads {FORMAT}; update fvi",
    "older": f"has format 3, this version of fvi reads {FORMAT}; move the file away",
    "folder": "is a folder",
}


@pytest.mark.parametrize("how", KINDS)
def test_a_file_that_is_not_ours_or_not_whole_is_named_and_left_as_it_is(path, how):
    damaged(path, how)
    before = tree(path.parent)
    expected = rf"sample\.h5: {KINDS[how]}"
    with pytest.raises(StorageError, match=expected), read_results(path):
        pass
    for fresh in (False, True):
        with (
            pytest.raises(StorageError, match=expected),
            open_results(path.parent, "sample", fresh=fresh),
        ):
            pass
    with pytest.raises(StorageError, match=expected):
        list_runs(path)
    assert tree(path.parent) == before


def test_a_file_that_is_not_there_is_named(tmp_path):
    for read in (read_configuration, list_runs):
        with pytest.raises(StorageError, match=r"absent\.h5: no such file"):
            read(tmp_path / "absent.h5")
    with pytest.raises(StorageError, match=r"absent\.h5: no such file"):
        read_results(tmp_path / "absent.h5").__enter__()


def journal_of(folder: Path, runs: list[FinishedRun]) -> tuple[Path, list[int]]:
    """A journal of so many runs, and where each ends."""
    path, ends = folder / "sample.journal", []
    for finished in runs:
        added(folder, [finished])
        ends.append(path.stat().st_size)
    return path, ends


def test_what_runs_that_are_added_together_have_in_common_is_written_once(tmp_path, runs):
    single = [one for one in runs if one.run.n_steps == runs[0].run.n_steps]
    _, ends = journal_of(tmp_path / "one by one", single)
    with open_results(tmp_path / "together", "sample") as results:
        results.add(single)
        size = (tmp_path / "together" / "sample.journal").stat().st_size
    assert size < 0.75 * ends[-1]
    assert found_in(tmp_path / "together", single) == [True] * len(single)


def test_cut_anywhere_a_journal_loses_what_is_behind_the_cut_and_nothing_else(tmp_path, runs):
    path, ends = journal_of(tmp_path, runs[:3])
    content = path.read_bytes()
    random = np.random.default_rng(2)
    for length in [*random.integers(0, len(content), 60).tolist(), *ends, ends[1] - 1, ends[1] + 1]:
        path.write_bytes(content[:length])
        assert found_in(tmp_path, runs[:3]) == [end <= length for end in ends]
    # whoever writes drops what is torn, and goes on behind the last whole run
    path.write_bytes(content[: ends[1] + 40])
    added(tmp_path, [runs[3]])
    assert found_in(tmp_path, runs[:4]) == [True, True, False, True]


def test_a_journal_of_version_0_3_is_refused_and_left_as_it_is(tmp_path, runs):
    path, _ = journal_of(tmp_path, runs[:1])
    content = b"fvi1" + path.read_bytes()[4:]
    path.write_bytes(content)
    with pytest.raises(StorageError, match=r"sample\.journal: was written by fvi 0\.3"):
        added(tmp_path, runs[1:2])
    assert path.read_bytes() == content


def recall(path: Path, runs: list[FinishedRun]) -> int:
    with read_results(path) as results:
        return sum(results.finished(finished.run) is not None for finished in runs)


def test_cut_anywhere_a_file_is_told_to_be_damaged(path, runs):
    content = path.read_bytes()
    assert recall(path, runs) == len(runs)
    random = np.random.default_rng(1)
    for length in [*random.integers(0, len(content), 100), len(content) - 1]:
        path.write_bytes(content[:length])
        with pytest.raises(StorageError, match=r"sample\.h5: "):
            recall(path, runs)


def test_after_a_failure_a_stream_goes_on_in_memory(tmp_path):
    """The same random writes and reads on a stream that fails half way and on plain memory."""
    random = np.random.default_rng(3)
    memory = io.BytesIO()
    handle = os.open(tmp_path / "file", os.O_RDWR | os.O_CREAT)
    first, stream = handle, SafeStream(handle)
    for k in range(400):
        if k == 200:
            stream.check()
            kept = memory.getvalue()
            os.close(handle)
            handle = os.open(tmp_path / "file", os.O_RDONLY)
            assert handle == first
        place, size = (int(n) for n in random.integers(0, 300, 2))
        assert stream.seek(place) == memory.seek(place)
        if k % 2:
            content = random.bytes(size)
            assert stream.write(content) == memory.write(content)
        else:
            assert stream.read(size) == memory.read(size)
        assert stream.tell() == memory.tell()
        assert stream.seek(0, os.SEEK_END) == memory.seek(0, os.SEEK_END)
    with pytest.raises(OSError, match="Bad file descriptor"):
        stream.check()
    os.close(handle)
    # what was on the disk has not changed since
    assert (tmp_path / "file").read_bytes() == kept


@pytest.mark.parametrize("count", [1, 10, 50])
def test_an_interrupt_in_the_midst_of_writing_leaves_what_was_there(path, runs, monkeypatch, count):
    before = tree(path.parent)
    real = os.write
    calls = 0

    def interrupted(*arguments: Any) -> int:
        nonlocal calls
        calls += 1
        if calls == count:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(stream_module.os, "write", interrupted)
    with open_results(path.parent, "sample") as results:
        resolved = {**configuration().resolved, "more": 1}
        changed = configuration(text="another", resolved=resolved)
        assert results.finished(runs[0].run) is not None
        with pytest.raises(KeyboardInterrupt):
            results.consolidate(changed)
        assert tree(path.parent) == before
        # control: without an interrupt it is written
        results.consolidate(changed)
    assert read_configuration(path).text == "another"
    assert recall(path, runs) == len(runs)


# --- two processes --------------------------------------------------------------------------------


def test_a_file_is_held_once_in_a_process_and_free_after_an_error(tmp_path):
    def fail() -> None:
        with open_results(tmp_path, "sample"):
            with pytest.raises(StorageError, match="another fvi"):
                open_results(tmp_path, "sample").__enter__()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    with open_results(tmp_path, "sample"):
        pass


@pytest.mark.parametrize("times", [1, 2, 5])
def test_a_file_that_another_process_takes_for_abandoned_is_begun_anew(
    tmp_path, monkeypatch, times
):
    """Between its creation and its lock another one may hold and remove it."""
    made = []
    create = tempfile.mkstemp

    def removed_at_once(**options):
        handle, name = create(**options)
        made.append(name)
        if len(made) <= times:
            Path(name).unlink()
        return handle, name

    monkeypatch.setattr(tempfile, "mkstemp", removed_at_once)
    replace_file(tmp_path / "table.csv", b"1,2\n")
    assert len(made) == times + 1
    assert (tmp_path / "table.csv").read_bytes() == b"1,2\n"
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]
