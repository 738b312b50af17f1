"""Faults, kills and damage: nothing that was stored is lost, and nothing wrong is read."""

import os
import signal
import subprocess
import sys
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
from fvi_cli.storage.digests import FORMAT
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


# --- two processes --------------------------------------------------------------------------------
