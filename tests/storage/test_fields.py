"""The table of fields: a line more is a field more, and nothing else changes."""

import dataclasses
import typing

import numpy as np
import pytest
from command_line import configuration
from made_runs import made_experiment, made_run
from stored_runs import add, assert_same

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.runner.compute import plan
from fvi_cli.storage import Store, fields
from fvi_cli.storage.fields import FIELDS
from fvi_cli.storage.hdf5 import opened
from fvi_cli.studies.experiment import FinishedRun

MORE = "newton_iterations"


@pytest.mark.parametrize("path", [one.at for one in FIELDS.values() if isinstance(one.at, str)])
def test_every_path_of_the_table_leads_to_a_field(path):
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


def test_a_field_more_is_one_line_and_older_files_stay(tmp_path, monkeypatch):
    path, runs = tmp_path / "sample.h5", made_experiment().runs()
    old, new, third = (
        made_run(run, 0.5, newton_iterations=count)
        for run, count in zip(runs[:3], (5, 7, 0), strict=True)
    )
    store, less = Store(path), {name: one for name, one in FIELDS.items() if name != MORE}
    with monkeypatch.context() as older:
        older.setattr(fields, "FIELDS", less)
        fields._place.cache_clear()
        add(store, [old])
    fields._place.cache_clear()
    add(store, [new])
    store.fold()
    found = store.read(runs)
    assert found[old.run].trajectory.newton_iterations == 0
    assert found[new.run].trajectory.newton_iterations == 7
    with monkeypatch.context() as older:
        older.setattr(fields, "FIELDS", less)
        fields._place.cache_clear()
        # a version that does not know the field reads the file, and keeps what it does not know
        add(store, [third])
        store.fold()
        assert store.read(runs)[new.run].trajectory.newton_iterations == 0
    fields._place.cache_clear()
    with opened(path) as file:
        cases = [group for case in file["made-up"].values() for group in case.values()]
        assert [group.attrs.get(MORE) for group in cases].count(7) == 1


def test_every_value_comes_back_bit_by_bit():
    random = np.random.default_rng(1)
    for run in made_experiment(steps=(4, 8)).runs():
        n = run.n_steps + 1
        made = made_run(
            run, 1 / 3 / n, position=random.normal(size=(n, 2)),
            momentum=random.normal(size=(n, 2)),
            energy=random.normal(size=n), remarks=("the start fell back: ½ a step", "another"),
            coordinates=("x1", "x2"), history_operations=7 * n, seconds=0.125,
            predicted="stable", message="ends",
        )  # fmt: skip
        store = Store(None)
        add(store, [made])
        assert_same(made, store.read([run])[run])


@pytest.mark.few(2)
@pytest.mark.parametrize("sweep", ["", "sweep: {problem.stiffness: [1.0, 2.0, 3.0]}\n"])
@pytest.mark.parametrize("norm", ["l2", "final"])
def test_another_norm_computes_nothing_and_gives_what_it_would_have_given(tmp_path, norm, sweep):
    problem = (
        "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
        "initial: {position: 1.0}, final_time: 6.0"
    )
    text = configuration(problem, name="small") + sweep
    other = parse_config(text, "small.yaml", overrides=[f"report.norm={norm}"])
    (fresh,) = api.run(other, output=tmp_path / "fresh")
    (usual,) = api.run(parse_config(text, "small.yaml"), output=tmp_path)
    assert {one.action for one in plan(other, output=tmp_path)} == {"reuse"}
    (again,) = api.run(other, output=tmp_path)
    names = ("error", "floor", "status", "order_smooth", "reference", "measured")
    for one, same, before in zip(fresh.finished, again.finished, usual.finished, strict=True):
        for name in names:
            np.testing.assert_equal(getattr(same, name), getattr(one, name))
        assert same.trajectory.seconds == before.trajectory.seconds
    assert [one.error for one in usual.finished] != [one.error for one in again.finished]
