"""Members of a sweep in files: one group for all, and read back."""

import json

import h5py
import numpy as np
import pytest
from command_line import MANY
from stored_runs import assert_same

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.storage import Store, groups, list_runs
from fvi_cli.storage.identity import identity_of

CONFIG = (
    MANY
    + """\
method: {bdf: 2, sampling: nodes}
ladder: {steps: [8, 16]}
sweep: {problem.damping.0.order: [0.5, 1.5], problem.damping.0.coefficient: [0.1, 1, 300]}
"""
)
ORDER, COEFFICIENT = "problem.damping.0.order", "problem.damping.0.coefficient"
GROUP = "/many/bdf2-nodes-s1-gauss1-none/n000016"


def keep(folder, text=CONFIG, *overrides):
    loaded = parse_config(text, "many.yaml", overrides=overrides)
    (outcome,) = api.run(loaded, output=folder)
    return outcome


@pytest.mark.parametrize("block_bytes", [2**24, 1500, 1])
def test_members_come_back_as_they_were_computed(tmp_path, monkeypatch, block_bytes):
    monkeypatch.setattr(groups, "BLOCK_BYTES", block_bytes)
    computed, found = keep(None), keep(tmp_path)
    assert {one.status for one in computed.finished} == {"ok", "diverged"}
    timed = ("run", "failure", "seconds")
    for one, other in zip(computed.finished, found.finished, strict=True):
        assert_same(one, other, timed)
    # in any order
    runs = found.experiment.runs()[::-2]
    assert len(Store(tmp_path / "many.h5").read(runs)) == len(runs)


def test_the_group_is_that_of_the_contract(tmp_path):
    outcome = keep(tmp_path)
    with h5py.File(tmp_path / "many.h5") as file:
        group = file[GROUP]
        shapes = {name: dataset.shape for name, dataset in group.items()}
        assert shapes["position"] == shapes["momentum"] == (6, 17, 1)
        assert shapes["energy"] == (6, 17)
        assert shapes["time"] == (17,)
        for name in ("error", "status", "identity", "predicted", "points", "history_operations"):
            assert shapes[name] == (6,), name
        np.testing.assert_array_equal(group[ORDER][()], [0.5, 0.5, 0.5, 1.5, 1.5, 1.5])
        np.testing.assert_array_equal(group[COEFFICIENT][()], [0.1, 1, 300] * 2)
        assert list(group["identity"].asstr()) == [
            identity_of(run) for run in outcome.experiment.runs()[6:]
        ]
        for name in ("method", "n_steps", "step_size"):
            assert name in group.attrs
        for dataset in group.values():
            assert dataset.fletcher32 or not dataset.size
            if not dataset.is_scale:
                assert all(len(dim) == 1 for dim in dataset.dims)


def test_values_that_are_no_numbers_are_kept(tmp_path):
    text = CONFIG.replace(
        CONFIG.splitlines()[-1],
        "sweep: [{problem.forcing: sin(t), problem.damping: []}, "
        "{problem.forcing: 0, problem.damping: [{order: 1, coefficient: 0.5}]}]",
    )
    keep(tmp_path, text)
    with h5py.File(tmp_path / "many.h5") as file:
        assert list(file[GROUP]["problem.forcing"].asstr()) == ["sin(t)", "0"]
        damping = [json.loads(one) for one in file[GROUP]["problem.damping"].asstr()]
    assert damping == [[], [{"order": 1.0, "coefficient": 0.5}]]


def test_a_listing_has_one_line_for_all_members(tmp_path):
    keep(tmp_path)
    runs = list_runs(tmp_path / "many.h5").runs
    assert [(run.values["n_steps"], run.members) for run in runs] == [(8, 6), (16, 6)]
    assert runs[1].values["status"] == "ok: 4; diverged: 2"
    assert runs[0].swept == (
        "problem.damping.0.coefficient = 0.1, 1, 300; problem.damping.0.order = 0.5, 1.5"
    )


def test_members_with_break_points_of_their_own_keep_their_times(tmp_path):
    text = (
        "name: many\nproblem: {kind: duffing, final_time: 2.0, initial: {position: 1.0}, "
        "forcing: {pieces: [{until: 0.5, value: 1}, {value: 0}]}}\n"
        "method: {rk: gauss, degree: 2, start: none}\nladder: {steps: [8], grading: 2}\n"
        "sweep: {problem.forcing.pieces.0.until: [0.5, 0.6]}\n"
    )
    found = keep(tmp_path, text).finished
    for one in found:
        assert np.array_equal(one.trajectory.time, one.run.times)
    assert not np.array_equal(found[0].trajectory.time, found[1].trajectory.time)


def test_a_value_of_minus_one_is_a_value(tmp_path):
    sweep = CONFIG.splitlines()[-1]
    keep(tmp_path, CONFIG.replace(sweep, "sweep: {problem.initial.velocity: [-1, 1]}"))
    runs = list_runs(tmp_path / "many.h5").runs
    assert {one.swept for one in runs} == {"problem.initial.velocity = -1, 1"}
