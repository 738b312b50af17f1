"""Result files: what goes in comes out, other readers understand it, faults destroy nothing."""

import hashlib
import io
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import textwrap
from collections.abc import Iterator
from dataclasses import fields, replace
from getpass import getuser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

import fvi_cli
from fvi_cli.errors import StorageError
from fvi_cli.integrator.method import Baseline, Method
from fvi_cli.integrator.results.diagnostics import NewtonRecord
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage import (
    digests,
    list_runs,
    open_results,
    read_configuration,
    read_results,
)
from fvi_cli.storage import stream as stream_module
from fvi_cli.storage.atomic import replace_file
from fvi_cli.storage.groups import writing
from fvi_cli.storage.stream import SafeStream
from fvi_cli.studies.experiment import Experiment, FinishedRun, Run

SPECIFICATION: dict[str, Any] = {
    "kind": "bagley-torvik",
    "damping": [{"order": 0.5, "coefficient": 1.0}],
    "forcing": "6*t + 6/gamma(3.5)*t**2.5 + t**3",
    "final_time": 1.0,
    "exact": "t**3",
}
BDF = Method(cq="bdf2", degree=1, sampling="nodes")
WEIGHTS = Method(cq="bdf3", degree=2, start="weights", start_exponents=(2.5,))
GAUSS = Method(cq="gauss", degree=3, start="graded")
EULER = Baseline(name="implicit-euler")
TEXT = "# gamma = ½\nname: sample\n" + "# filling\n" * 10_000  # more than HDF5 keeps in a header
CONFIGURATION = SimpleNamespace(
    text=TEXT, resolved={"name": "sample", "experiments": [SPECIFICATION]}, overrides=("a.b=1",)
)


def experiment(name: str = "sample", stiffness: float = 1.0, **keywords: Any) -> Experiment:
    exact = SPECIFICATION["exact"] if stiffness == 1.0 else "auto"
    specification = {**SPECIFICATION, "stiffness": stiffness, "exact": exact}
    values: dict[str, Any] = {
        "name": name,
        "problem": build_problem(specification),
        "problem_specification": specification,
        "methods": (BDF, WEIGHTS, GAUSS, EULER),
        "steps": (4, 8),
        **keywords,
    }
    return Experiment(**values)


def made_up(run: Run, *, dimension: int = 2, **keywords: Any) -> FinishedRun:
    """Numbers with nothing regular in them, which belong to the run."""
    random = np.random.default_rng(run.n_steps)
    n = run.n_steps + 1
    trajectory = Trajectory(
        time=np.linspace(0, 1, n),
        position=random.normal(size=(n, dimension)),
        momentum=None if run.method == EULER else random.normal(size=(n, dimension)),
        energy=None if run.method == EULER else random.normal(size=n),
        n_steps=run.n_steps,
        step_size=run.step_size,
        history_operations=7 * n,
        newton=NewtonRecord(iterations=5, largest=3, worst_step=2, worst_residuals=(1.0, 1e-9)),
        setup_seconds=0.25,
        stepping_seconds=0.125,
        remarks=("the start fell back: ½ a step", "another"),
        coordinates=run.problem.coordinates,
    )
    values: dict[str, Any] = {
        "run": run,
        "trajectory": trajectory,
        "error": 1 / 3 / n,
        "floor": 1e-14,
        "status": "ok",
        "predicted": "stable",
        "expected_order": 1.5,
        "reference": "expression",
        **keywords,
    }
    return FinishedRun(**values)


def assert_same(one: Any, other: Any) -> None:
    """Every field of two values, bit by bit."""
    for field in fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if field.name in ("trajectory", "newton"):
            assert_same(a, b)
        elif isinstance(a, np.ndarray):
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
        else:
            assert type(a) is type(b), field.name
            assert a == b or (a != a and b != b), field.name


def store(folder: Path, runs: list[FinishedRun], **keywords: Any) -> Path:
    with open_results(folder, "sample", **keywords) as results:
        for finished in runs:
            results.add([finished])
        path = results.consolidate(CONFIGURATION)
    assert path == folder / "sample.h5"
    return path


def tree(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and not p.name.endswith(".lock")
    }


@pytest.fixture
def runs() -> list[FinishedRun]:
    return [made_up(run) for run in experiment().runs()]


@pytest.fixture
def path(tmp_path: Path, runs: list[FinishedRun]) -> Path:
    return store(tmp_path, runs)


# --- what goes in comes out -----------------------------------------------------------------------


def test_every_field_comes_back_bit_by_bit(tmp_path, runs):
    with open_results(tmp_path, "sample") as results:
        for finished in runs:
            assert results.finished(finished.run) is None
            results.add([finished])
        # from the parts, then from the file
        for finished in runs:
            assert_same(results.finished(finished.run), finished)
        results.consolidate(CONFIGURATION)
    with read_results(tmp_path / "sample.h5") as results:
        for finished in runs:
            assert_same(results.finished(finished.run), finished)
        # another process would build equal values, not the same ones
        for finished, run in zip(runs, experiment().runs(), strict=True):
            found = results.finished(run)
            assert found.run is run
            assert_same(replace(found, run=finished.run), finished)
    assert sorted(tree(tmp_path)) == ["sample.h5"]


@pytest.mark.parametrize(
    "position",
    [
        np.array([[1.0], [np.inf], [-np.inf], [np.nan], [-0.0], [5e-324]]),
        np.zeros((0, 2)),
        np.zeros((1, 1)),
    ],
)
def test_runs_that_came_to_nothing_come_back_as_they_are(tmp_path, position):
    run = experiment().runs()[0]
    trajectory = Trajectory(
        time=np.arange(float(len(position))),
        position=position,
        n_steps=4,
        step_size=0.25,
        status="diverged",
        message="|x| > 1e8 at t = 0.5\nand on",
        coordinates=run.problem.coordinates,
    )
    finished = made_up(
        run, trajectory=trajectory, error=np.nan, status="diverged", expected_order=np.nan
    )
    path = store(tmp_path, [finished])
    with read_results(path) as results:
        assert_same(results.finished(run), finished)


def test_a_thinned_grid_keeps_first_and_last_point(tmp_path):
    own = experiment(store_every=3)
    finished = made_up(own.runs()[1])
    path = store(tmp_path, [finished])
    with read_results(path) as results:
        found = results.finished(finished.run)
    kept = [0, 3, 6, 8]
    assert found.trajectory.time.tolist() == finished.trajectory.time[kept].tolist()
    assert found.trajectory.position.tolist() == finished.trajectory.position[kept].tolist()
    assert found.error == finished.error
    assert found.trajectory.n_steps == 8


# --- identity -------------------------------------------------------------------------------------


@pytest.mark.parametrize("constant", ["FORMAT", "SOLVER_VERSION"])
def test_runs_of_an_older_program_are_not_taken(path, monkeypatch, constant):
    run = experiment().runs()[0]
    with read_results(path) as results:
        assert results.finished(run) is not None
        monkeypatch.setattr(digests, constant, getattr(digests, constant) + 1)
        assert results.finished(run) is None


def test_experiments_that_share_a_run_both_have_it(tmp_path):
    one, two, three = (experiment(name=name) for name in ("one", "two", "three"))
    with open_results(tmp_path, "sample") as results:
        results.add([made_up(one.runs()[0])])
        results.add([made_up(two.runs()[0])])
        assert results.finished(three.runs()[0]) is not None
        results.consolidate(CONFIGURATION)
    found = [(run.experiment, run.n_steps) for run in list_runs(tmp_path / "sample.h5").runs]
    assert found == [("one", 4), ("two", 4), ("three", 4)]


# --- what a file says -----------------------------------------------------------------------------


def attributes_of(path: Path) -> Iterator[tuple[str, Any]]:
    found: list[tuple[str, Any]] = []
    with h5py.File(path) as file:
        found += [(f"/@{name}", value) for name, value in file.attrs.items()]
        file.visititems(
            lambda place, thing: found.extend(
                (f"{place}@{name}", value) for name, value in thing.attrs.items()
            )
        )
    yield from found


def test_layout_is_as_documented(path):
    with h5py.File(path) as file:
        group = file["sample/bdf2-nodes-s1-gauss1-none/n000008"]
        assert list(group) == ["time", "dof", "position", "momentum", "energy"]
        shapes = {name: group[name].shape for name in group}
        assert shapes == {
            "time": (9,),
            "dof": (2,),
            "position": (9, 2),
            "momentum": (9, 2),
            "energy": (9,),
        }
        assert all(group[n].dtype == np.float64 for n in group if n != "dof")
        expected = {
            "cq": "bdf2",
            "sampling": "nodes",
            "degree": 1,
            "quadrature": "gauss1",
            "start": "none",
            "gamma": "0.5",
            "n_steps": 8,
            "step_size": 0.125,
            "norm": "max",
            "status": "ok",
            "predicted": "stable",
            "message": "",
        }
        assert {name: group.attrs[name] for name in expected} == expected
        assert json.loads(group.attrs["remarks"])[1] == "another"
        assert group.attrs["newton_worst_residuals"].tolist() == [1.0, 1e-9]
        euler = file["sample/implicit-euler"]
        assert euler["n000004"].attrs["degree"] == "-"
        assert "momentum" not in euler["n000004"]
        table = euler["convergence"]
        assert table["n_steps"][()].tolist() == [4, 8]
        assert table["step_size"][()].tolist() == [0.25, 0.125]
        assert table["error"][()].tolist() == [1 / 15, 1 / 27]
        assert table["seconds"][()].tolist() == [0.125, 0.125]
        assert table["history_operations"][()].tolist() == [35, 63]
        assert table["status"].asstr()[()].tolist() == ["ok", "ok"]


def test_every_axis_has_a_scale_and_every_attribute_a_type_of_netcdf(path):
    without: list[str] = []
    seen: list[str] = []

    def look(name: str, thing: Any) -> None:
        if isinstance(thing, h5py.Dataset):
            seen.append(name)
            if not thing.is_scale:
                without.extend(name for axis in thing.dims if len(axis) != 1)

    with h5py.File(path) as file:
        file.visititems(look)
    assert len(seen) > 40
    assert without == []
    for name, value in attributes_of(path):
        if name.rpartition("@")[2].isupper():  # those of dimension scales
            continue
        assert type(value) in (str, np.int64, np.float64, np.ndarray), name
    for wrong in (True, None, np.bool_(True), {"a": 1}, np.array([])):
        with pytest.raises(TypeError, match="is not text, a number"):
            writing.attribute(wrong)


def test_the_root_says_where_the_file_comes_from(path):
    stored = read_configuration(path)
    assert stored.text == TEXT
    assert read_configuration(path).text == TEXT
    assert stored.overrides == ("a.b=1",)
    assert json.loads(stored.resolved) == CONFIGURATION.resolved
    said = list_runs(path).provenance
    digest = hashlib.sha256(stored.resolved.encode()).hexdigest()
    assert said["resolved_config_sha256"] == digest
    assert said["format"] == "3"
    assert json.loads(said["packages"])["numpy"] == np.__version__
    assert json.loads(said["packages"])["fvi-cli"] == fvi_cli.__version__
    assert said["created"].endswith("+00:00")
    assert said["git_dirty"] in ("yes", "no", "unknown")
    assert said["git_commit"] == "unknown" or len(said["git_commit"]) in (40, 64)


def test_no_name_of_user_or_machine_and_no_absolute_path_is_inside(path):
    values = [str(value) for name, value in attributes_of(path) if not name.startswith("/@config")]
    assert len(values) > 100
    text = "\n".join(values)
    user, machine = getuser(), socket.gethostname()
    assert machine not in text
    assert user not in text.split()
    for place in (path.parent, Path.cwd(), Path.home(), Path(sys.prefix)):
        if len(place.parts) > 1:
            assert str(place) not in text
    assert str(path.parent).encode() not in path.read_bytes()


# --- consolidation --------------------------------------------------------------------------------


def places(path: Path) -> set[tuple[str, str, int]]:
    return {(run.experiment, run.case, run.n_steps) for run in list_runs(path).runs}


def test_what_is_current_is_not_written_again(tmp_path, runs):
    path = store(tmp_path, runs)
    before = path.stat()
    with open_results(tmp_path, "sample") as results:
        assert all(results.finished(finished.run) for finished in runs)
        results.consolidate(CONFIGURATION)
    after = path.stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    # nor for a comment in the configuration; control: another value is written
    more = {**vars(CONFIGURATION), "text": TEXT + "# more\n"}
    other = {**more, "resolved": {**CONFIGURATION.resolved, "more": 1}}
    for changed, is_written in ((more, False), (other, True)):
        with open_results(tmp_path, "sample") as results:
            assert all(results.finished(finished.run) for finished in runs)
            results.consolidate(SimpleNamespace(**changed))
        assert (path.stat().st_mtime_ns != before.st_mtime_ns) == is_written
    assert read_configuration(path).text == TEXT + "# more\n"
    assert len(places(path)) == len(runs)


def test_without_a_finished_run_there_is_no_file(tmp_path):
    with open_results(tmp_path, "sample") as results:
        assert results.consolidate(CONFIGURATION) is None
    assert tree(tmp_path) == {}


def test_runs_that_were_not_asked_for_again_are_kept(path, runs):
    longer = experiment(steps=(16,))
    store(path.parent, [made_up(run) for run in longer.runs()])
    store(path.parent, [made_up(run) for run in experiment(name="another", stiffness=3.0).runs()])
    assert len(places(path)) == len(runs) + 4 + 8
    with read_results(path) as results:
        assert_same(results.finished(runs[0].run), runs[0])
    with h5py.File(path) as file:
        table = file["sample/gauss-s3-graded/convergence"]
        assert table["n_steps"][()].tolist() == [4, 8, 16]
    # what is computed afresh replaces what it was, and nothing else
    again = made_up(longer.runs()[0], error=0.5)
    store(path.parent, [again], fresh=True)
    assert len(places(path)) == len(runs) + 4 + 8
    with read_results(path) as results:
        assert_same(results.finished(again.run), again)
        assert_same(results.finished(runs[0].run), runs[0])


BESIDE = "problem.exact = t**3, problem.stiffness = 1"


def test_an_experiment_that_has_become_another_one_is_not_mixed_with_what_it_was(path, runs):
    other = experiment(name="other", stiffness=3.0)
    store(path.parent, [made_up(run) for run in other.runs()])
    changed = experiment(stiffness=2.0, steps=(8, 16), methods=(BDF,))
    store(path.parent, [made_up(run) for run in changed.runs()])
    # those of the configuration are where they are looked for, the others beside them
    found = [(run.experiment, run.case, run.n_steps, run.variant) for run in list_runs(path).runs]
    assert {one for one in found if one[0] == "sample" and not one[3]} == {
        ("sample", BDF.case, 8, ""),
        ("sample", BDF.case, 16, ""),
    }
    assert {one for one in found if one[3]} == {
        ("sample", f.run.method.case, f.run.n_steps, BESIDE) for f in runs
    }
    with read_results(path) as results:
        assert results.finished(changed.runs()[0]) is not None
        for finished in runs:
            assert_same(results.finished(finished.run), finished)
    # the other way round: what was beside comes back
    with open_results(path.parent, "sample") as results:
        assert all(results.finished(finished.run) for finished in runs)
        results.consolidate(CONFIGURATION)
    assert {run.variant for run in list_runs(path).runs} == {
        "",
        "problem.exact = auto, problem.stiffness = 2",
    }


def test_fresh_forgets_nothing_before_something_new_is_there(path, runs):
    before = tree(path.parent)
    with open_results(path.parent, "sample", fresh=True) as results:
        assert results.finished(runs[0].run) is None
        results.consolidate(CONFIGURATION)
    assert tree(path.parent) == before


def test_other_files_in_the_folder_of_parts_are_left_alone(tmp_path, runs):
    parts = tmp_path / "sample.parts"
    parts.mkdir()
    (parts / "notes.txt").write_text("mine")
    store(tmp_path, runs)
    assert sorted(tree(tmp_path)) == ["sample.h5", "sample.parts/notes.txt"]


# --- faults ---------------------------------------------------------------------------------------


def in_a_process(code: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
    package = str(Path(fvi_cli.__file__).parents[1])
    search = os.pathsep.join([str(Path(__file__).parent), package])
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
    import test_storage as t
    from fvi_cli.storage.journal import Journal
    folder, place, moment = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    runs = [t.made_up(run) for run in t.experiment().runs()]
    owner = Path if place == "replace" else Journal
    real, calls = getattr(owner, place), 0
    def killed(*arguments):
        global calls
        calls += 1
        if calls == moment:
            os.kill(os.getpid(), signal.SIGKILL)
        return real(*arguments)
    setattr(owner, place, killed)
    with t.open_results(folder, "sample") as results:
        for finished in runs:
            results.add([finished])
        results.consolidate(t.CONFIGURATION)
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
    with open_results(tmp_path, "sample") as results:
        found = [results.finished(finished.run) for finished in runs]
        assert [f is not None for f in found] == [k < left for k in range(8)]
        for one, finished in zip(found[:left], runs, strict=False):
            assert_same(one, finished)
        for finished in runs[left:]:
            results.add([finished])
        results.consolidate(CONFIGURATION)
    # nothing half written is left
    assert sorted(tree(tmp_path)) == ["sample.h5"]
    assert len(places(tmp_path / "sample.h5")) == 8


def test_runs_of_a_journal_are_read_beside_and_without_the_file(tmp_path, runs):
    with open_results(tmp_path, "sample") as results:
        results.add([runs[0]])
    path = tmp_path / "sample.h5"
    with read_results(path) as stored:
        assert_same(stored.finished(runs[0].run), runs[0])
    store(tmp_path, [runs[1]])
    with open_results(tmp_path, "sample") as results:
        results.add([runs[2]])
    before = tree(tmp_path)
    with read_results(path) as stored:
        assert all(stored.finished(finished.run) for finished in runs[:3])
        assert stored.finished(runs[3].run) is None
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
                lambda: results.consolidate(CONFIGURATION),
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
    with read_results(path) as stored:
        for finished in runs:
            assert_same(stored.finished(finished.run), finished)


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
            file.attrs["format"] = 4
    elif how == "strange":
        with h5py.File(path, "r+") as file:
            file["sample/x"] = 1.0
    else:
        path.unlink()
        path.mkdir()


KINDS = {
    "empty": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "text": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "cut": "is not a result file of fvi \\(not HDF5, or damaged or cut off\\)",
    "foreign": "was not written by fvi",
    "newer": "has format 4, this version of fvi reads 3",
    "strange": "is damaged or not a result file",
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
    with open_results(folder, "sample") as results:
        for finished in runs:
            results.add([finished])
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


def found_in(folder: Path, runs: list[FinishedRun]) -> list[bool]:
    """Which of the runs are there, as they were."""
    found = []
    with read_results(folder / "sample.h5", may_be_missing=True) as results:
        for finished in runs:
            one = results.finished(finished.run)
            found.append(one is not None)
            if one is not None:
                assert_same(one, finished)
    return found


def test_cut_anywhere_a_journal_loses_what_is_behind_the_cut_and_nothing_else(tmp_path, runs):
    path, ends = journal_of(tmp_path, runs[:3])
    content = path.read_bytes()
    random = np.random.default_rng(2)
    for length in [*random.integers(0, len(content), 60).tolist(), *ends, ends[1] - 1, ends[1] + 1]:
        path.write_bytes(content[:length])
        assert found_in(tmp_path, runs[:3]) == [end <= length for end in ends]
    # whoever writes drops what is torn, and goes on behind the last whole run
    path.write_bytes(content[: ends[1] + 40])
    with open_results(tmp_path, "sample") as results:
        results.add([runs[3]])
    assert found_in(tmp_path, runs[:4]) == [True, True, False, True]


def test_a_changed_byte_of_a_journal_is_told_and_gives_no_wrong_number(tmp_path, runs):
    path, ends = journal_of(tmp_path, runs[:3])
    content = path.read_bytes()
    random = np.random.default_rng(3)
    told = 0
    for place in random.integers(0, len(content), 150).tolist():
        path.write_bytes(content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :])
        try:
            found = found_in(tmp_path, runs[:3])
        except StorageError as error:
            told += "sample.journal" in str(error)
        else:  # of the last entry nobody can tell whether it was ever whole
            assert (found, place >= ends[1]) == ([True, True, False], True)
    assert told > 80


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


def seal_of(content: bytes) -> bytes:
    return bytes(content[content.rindex(stream_module.MARK) :])


def test_numbers_that_have_changed_since_are_noticed(path, runs):
    with h5py.File(path) as file:
        dataset = file[f"sample/{BDF.case}/n000008/position"]
        place = dataset.id.get_offset() + 24
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    with pytest.raises(StorageError, match="its bytes are not those that were written"):
        recall(path, runs)
    # without the seal, as a program leaves it that changes a file, each run is looked at
    path.write_bytes(content[: -len(seal_of(content))])
    with read_results(path) as results:
        assert_same(results.finished(runs[0].run), runs[0])
        with pytest.raises(StorageError, match=r"n000008 is not what was written"):
            results.finished(runs[1].run)


def test_a_file_that_the_library_would_search_for_ever_is_told_to_be_damaged(path, runs):
    """A heap of texts of variable length whose directory is empty: h5py does not come back."""
    content = bytearray(path.read_bytes())
    begin = content.index(b"GCOL")
    content[begin + 16 : begin + 400] = bytes(384)
    path.write_bytes(content)
    with pytest.raises(StorageError, match="its bytes are not those that were written"):
        recall(path, runs)
    with pytest.raises(StorageError, match="its bytes are not those that were written"):
        list_runs(path)


def test_after_a_failure_a_stream_goes_on_in_memory(tmp_path):
    """The same random writes and reads on a stream that fails half way and on plain memory."""
    random = np.random.default_rng(3)
    memory = io.BytesIO()
    handle = os.open(tmp_path / "file", os.O_RDWR | os.O_CREAT)
    stream = SafeStream(handle)
    for k in range(400):
        if k == 200:
            stream.check()
            kept = memory.getvalue()
            os.close(handle)
            handle = os.open(tmp_path / "file", os.O_RDONLY)
            assert handle == stream._handle
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
        other = {"text": "another", "resolved": {**CONFIGURATION.resolved, "more": 1}}
        changed = SimpleNamespace(**{**vars(CONFIGURATION), **other})
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
