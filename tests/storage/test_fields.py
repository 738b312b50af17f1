"""The table of fields: a line more is a field more, and nothing else changes."""

import dataclasses
import json
import typing

import h5py
import numpy as np
import pytest
import stored_runs as t
from command_line import configuration

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.runner.plan import plan
from fvi_cli.storage import list_runs, open_results, read_configuration, read_results
from fvi_cli.storage.records import fields, runs
from fvi_cli.storage.records.fields import FIELDS, Field
from fvi_cli.studies.experiment import FinishedRun

MORE = Field("rejected", "steps that were tried in vain", "trajectory.rejected")
OSCILLATOR = (
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], initial: {position: 1.0}"
)


@pytest.mark.parametrize("path", [one.at for one in FIELDS if isinstance(one.at, str)])
def test_what_the_table_names_is_there(path):
    """A path that led nowhere would store nothing, and say nothing."""
    kind = FinishedRun
    for part in path.split("."):
        if part == "*":
            (kind,) = [one for one in typing.get_args(kind) if one is not str][:1]
            continue
        hints = typing.get_type_hints(kind, vars(__import__(kind.__module__, fromlist=["x"])))
        assert part in hints, (kind, part)
        own = [one for one in typing.get_args(hints[part]) if one is not type(None)]
        kind = own[0] if own and dataclasses.is_dataclass(own[0]) else hints[part]


def with_field_more(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (fields, runs):
        monkeypatch.setattr(module, "FIELDS", (*FIELDS, MORE))
    fields.field_named.cache_clear()


@pytest.fixture(autouse=True)
def known_again():
    yield
    fields.field_named.cache_clear()


def test_a_field_more_is_a_line_and_older_files_stay(tmp_path, monkeypatch):
    old, new = (t.made_up(run) for run in t.experiment().runs()[:2])
    path = t.store(tmp_path, [old])
    with monkeypatch.context() as patch:
        with_field_more(patch)
        trajectory = dataclasses.replace(new.trajectory, rejected=7)
        new = dataclasses.replace(new, trajectory=trajectory)
        with open_results(tmp_path, "sample") as results:
            t.assert_same(results.finished(old.run), old)  # its default
            results.add([new])
            results.consolidate(t.configuration())
        with read_results(path) as results:
            t.assert_same(results.finished(new.run), new)
            t.assert_same(results.finished(old.run), old)
    fields.field_named.cache_clear()
    # a version that does not know it reads the file, and keeps what it does not know
    third = t.made_up(t.experiment().runs()[2])
    t.store(tmp_path, [third])
    with read_results(path) as results:
        found = results.finished(new.run)
    assert found.trajectory.rejected == 0
    assert found.trajectory.position.tolist() == new.trajectory.position.tolist()
    with h5py.File(path) as file:
        told = [one.attrs.get("rejected") for one in file[f"sample/{t.BDF.case}"].values()]
    assert told.count(7) == 1


@pytest.mark.few(2)
@pytest.mark.parametrize("sweep", ["", "sweep: {problem.stiffness: [1.0, 2.0, 3.0]}\n"])
@pytest.mark.parametrize("norm", ["l2", "final"])
def test_another_norm_computes_nothing_and_gives_what_it_would_have_given(tmp_path, norm, sweep):
    text = configuration(f"{OSCILLATOR}, final_time: 6.0", name="small") + sweep
    other = parse_config(text, "small.yaml", overrides=[f"report.norm={norm}"])
    (fresh,) = api.run(other, output=tmp_path / "fresh")
    (usual,) = api.run(parse_config(text, "small.yaml"), output=tmp_path)
    assert {one.action for one in plan(other, output=tmp_path)} == {"reuse"}
    (again,) = api.run(other, output=tmp_path)
    names = ("error", "floor", "status", "expected_order", "reference", "measured")
    for one, same, before in zip(fresh.finished, again.finished, usual.finished, strict=True):
        for name in names:
            np.testing.assert_equal(getattr(same, name), getattr(one, name))
        assert same.run.experiment.norm != before.run.experiment.norm
        assert same.trajectory.stepping_seconds == before.trajectory.stepping_seconds
    assert [one.error for one in usual.finished] != [one.error for one in again.finished]
    assert {run.norm for run in list_runs(tmp_path / "small.h5").runs} == {norm}
    with h5py.File(tmp_path / "small.h5") as file, h5py.File(tmp_path / "fresh/small.h5") as own:
        for case in own["small"]:
            for name, group in own["small"][case].items():
                again = file["small"][case][name]
                assert again.attrs["norm"] == norm
                np.testing.assert_array_equal(again.attrs["error"], group.attrs["error"])


def matrices(size: int) -> str:
    random = np.random.default_rng(1)
    root = random.normal(size=(size, size))
    stiffness = (root @ root.T + size * np.eye(size)).tolist()
    problem = (
        f"kind: structure, mass: {np.eye(size).tolist()}, stiffness: {stiffness}, "
        f"damping: [{{order: 0.5, coefficient: {np.eye(size).tolist()}}}], "
        f"initial: {{position: {[1.0] * size}}}, final_time: 0.25, exact: none"
    )
    return configuration(
        problem, name="large", method="{bdf: [1, 2], sampling: nodes}", steps="2, 4, 8, 16"
    )


def test_matrices_are_stored_once_whatever_the_number_of_runs(tmp_path):
    text = matrices(40)
    loaded = parse_config(text, "large.yaml")
    (first,) = api.run(loaded, output=tmp_path)
    path = tmp_path / "large.h5"
    assert len(first.finished) == 8
    assert path.stat().st_size < 2.0 * len(text) + 200_000
    assert json.loads(read_configuration(path).resolved) == json.loads(json.dumps(loaded.resolved))
    (again,) = api.recall(path)
    for one, other in zip(first.finished, again.finished, strict=True):
        assert np.array_equal(one.trajectory.position, other.trajectory.position)
    # what is nowhere named any more goes with its runs
    other = parse_config(text, "large.yaml", overrides=["problem.stiffness=1.0"])
    (few,) = api.run(other, output=tmp_path)
    with h5py.File(path) as file:
        before = {name for name in file["@inputs"] if len(name) == 64}
    assert few.finished
    api.run(other, output=tmp_path, prune=True)
    with h5py.File(path) as file:
        assert {name for name in file["@inputs"] if len(name) == 64} < before
