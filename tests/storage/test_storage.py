"""Result files: what goes in comes out, and other readers understand it."""

import json
import socket
import sys
from collections.abc import Iterator
from dataclasses import replace
from getpass import getuser
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from stored_runs import (
    BDF,
    TEXT,
    assert_same,
    configuration,
    experiment,
    found_in,
    made_runs,
    made_up,
    places,
    store,
    tree,
)

import fvi_cli
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.storage import digests, list_runs, open_results, read_configuration, read_results
from fvi_cli.storage.digests import canonical_json, sha256
from fvi_cli.storage.groups import writing

# --- what goes in comes out -----------------------------------------------------------------------


def test_every_field_comes_back_bit_by_bit(tmp_path, runs):
    with open_results(tmp_path, "sample") as results:
        for finished in runs:
            assert results.finished(finished.run) is None
            results.add([finished])
        # from the parts, then from the file
        for finished in runs:
            assert_same(results.finished(finished.run), finished)
        results.consolidate(configuration())
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


def test_runs_of_an_older_solver_are_not_taken(path, monkeypatch):
    run = experiment().runs()[0]
    with read_results(path) as results:
        assert results.finished(run) is not None
        monkeypatch.setattr(digests, "SOLVER_VERSION", digests.SOLVER_VERSION + 1)
        assert results.finished(run) is None


def test_experiments_that_share_a_run_both_have_it(tmp_path):
    one, two, three = (experiment(name=name) for name in ("one", "two", "three"))
    with open_results(tmp_path, "sample") as results:
        results.add([made_up(one.runs()[0])])
        results.add([made_up(two.runs()[0])])
        assert results.finished(three.runs()[0]) is not None
        results.consolidate(configuration())
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


CHANGING = (
    *("libraries", "created", "fvi_version", "git_commit", "git_dirty", "identity"),
    "solver_version",
)
"""Attributes that are others with every version or commit."""


def test_layout_is_as_documented(path, kept):
    """Every group and array with its shape, type and attributes."""
    lines = []

    def tell(name: str, thing: h5py.HLObject) -> None:
        is_array = isinstance(thing, h5py.Dataset)
        lines.append(f"{name} {thing.shape} {thing.dtype}" if is_array else name)
        for key, value in sorted(thing.attrs.items()):
            if not key.isupper() and key not in CHANGING:
                lines.append(f"  {key} = {value.tolist() if key.endswith('residuals') else value}")

    with h5py.File(path) as file:
        file.visititems(tell)
    kept("layout.txt", "\n".join(lines) + "\n")


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
    assert json.loads(stored.resolved) == configuration().resolved
    said = list_runs(path).provenance
    digest = sha256(canonical_json(json.loads(stored.resolved)))
    assert said["resolved_config_sha256"] == digest
    assert said["format"] == "4"
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


def test_what_is_current_is_not_written_again(tmp_path, runs):
    path = store(tmp_path, runs)
    before = path.stat()
    with open_results(tmp_path, "sample") as results:
        assert all(results.finished(finished.run) for finished in runs)
        results.consolidate(configuration())
    after = path.stat()
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    # nor for a comment in the configuration; control: another value is written
    more = TEXT + "# more\n"
    other = {**configuration().resolved, "more": 1}
    for changed, is_written in (
        (configuration(text=more), False),
        (configuration(text=more, resolved=other), True),
    ):
        with open_results(tmp_path, "sample") as results:
            assert all(results.finished(finished.run) for finished in runs)
            results.consolidate(changed)
        assert (path.stat().st_mtime_ns != before.st_mtime_ns) == is_written
    assert read_configuration(path).text == more
    assert len(places(path)) == len(runs)


def test_without_a_finished_run_there_is_no_file(tmp_path):
    with open_results(tmp_path, "sample") as results:
        assert results.consolidate(configuration()) is None
    assert tree(tmp_path) == {}


def test_runs_that_were_not_asked_for_again_are_kept(path, runs):
    longer = experiment(steps=(16,))
    store(path.parent, made_runs(steps=(16,)))
    store(path.parent, made_runs(name="another", stiffness=3.0))
    assert len(places(path)) == len(runs) + 4 + 8
    with read_results(path) as results:
        assert_same(results.finished(runs[0].run), runs[0])
    with h5py.File(path) as file:
        assert sorted(file["sample/gauss-s3-graded"]) == ["n000004", "n000008", "n000016"]
    # what is computed afresh replaces what it was, and nothing else
    again = made_up(longer.runs()[0], error=0.5)
    store(path.parent, [again], fresh=True)
    assert len(places(path)) == len(runs) + 4 + 8
    with read_results(path) as results:
        assert_same(results.finished(again.run), again)
        assert_same(results.finished(runs[0].run), runs[0])


BESIDE = "problem.exact = t**3, problem.stiffness = 1"


def test_an_experiment_that_has_become_another_one_is_not_mixed_with_what_it_was(path, runs):
    store(path.parent, made_runs(name="other", stiffness=3.0))
    changed = experiment((BDF,), (8, 16), stiffness=2.0)
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
    assert all(found_in(path.parent, runs))
    # the other way round: what was beside comes back
    with open_results(path.parent, "sample") as results:
        assert all(results.finished(finished.run) for finished in runs)
        results.consolidate(configuration())
    assert {run.variant for run in list_runs(path).runs} == {
        "",
        "problem.exact = auto, problem.stiffness = 2",
    }


def test_fresh_forgets_nothing_before_something_new_is_there(path, runs):
    before = tree(path.parent)
    with open_results(path.parent, "sample", fresh=True) as results:
        assert results.finished(runs[0].run) is None
        results.consolidate(configuration())
    assert tree(path.parent) == before
