"""Members of a sweep in files: one group for all, read back, resumed, and opened by others."""

import json
import tracemalloc
import warnings

import h5py
import numpy as np
import pytest
from command_line import MANY

from fvi_cli.config import parse_config
from fvi_cli.runner.executors.batches import batches_of
from fvi_cli.runner.executors.execute import execute_job
from fvi_cli.runner.executors.jobs import Job
from fvi_cli.storage import list_runs, open_results, read_results
from fvi_cli.storage.digests import identity_of
from fvi_cli.storage.groups import reading
from fvi_cli.storage.groups.columns import Survey
from fvi_cli.storage.records.runs import stored_record

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


def load(text=CONFIG, *overrides):
    return parse_config(text, "many.yaml", overrides=overrides)


def keep(folder, loaded, *, most=10**6, fresh=False):
    """Compute what is not stored, at most so many batches; tells how many runs were computed."""
    computed = 0
    with open_results(folder, "many", fresh=fresh) as results:
        waiting = [
            run for e in loaded.experiments for run in e.runs() if results.finished(run) is None
        ]
        for batch in batches_of(waiting)[:most]:
            results.add(execute_job(Job(runs=batch)))
            computed += len(batch)
        results.consolidate(loaded)
    return computed


def assert_same(one, other):
    assert one.status == other.status
    assert one.predicted == other.predicted
    np.testing.assert_equal(one.error, other.error)
    np.testing.assert_equal(one.expected_order, other.expected_order)
    assert one.trajectory.remarks == other.trajectory.remarks
    assert one.trajectory.message == other.trajectory.message
    assert vars(one.trajectory.newton) == vars(other.trajectory.newton)
    for name in ("time", "position", "momentum", "energy"):
        np.testing.assert_array_equal(
            getattr(one.trajectory, name), getattr(other.trajectory, name), err_msg=name
        )


@pytest.mark.parametrize("block_bytes", [reading.BLOCK_BYTES, 1500])
def test_members_come_back_as_they_were_computed(tmp_path, monkeypatch, block_bytes):
    """In small blocks as well."""
    monkeypatch.setattr(reading, "BLOCK_BYTES", block_bytes)
    loaded = load()
    runs = loaded.experiments[0].runs()
    finished = [one for batch in batches_of(runs) for one in execute_job(Job(runs=batch))]
    assert {one.status for one in finished} == {"ok", "diverged"}
    with open_results(tmp_path, "many") as results:
        results.add(finished[:6])
        results.add(finished[6:])
        for one in finished:  # from the journal
            assert_same(results.finished(one.run), one)
        results.consolidate(loaded)
    with read_results(tmp_path / "many.h5") as results:
        for one in reversed(finished):  # from the file
            assert_same(results.finished(one.run), one)
    assert not (tmp_path / "many.journal").exists()


def test_as_many_members_are_read_together_as_a_block_holds(tmp_path, monkeypatch):
    keep(tmp_path, load())
    counts = []
    for block_bytes in (reading.BLOCK_BYTES, 1500, 1):
        monkeypatch.setattr(reading, "BLOCK_BYTES", block_bytes)
        with h5py.File(tmp_path / "many.h5") as file:
            group = reading.StoredGroup(file[GROUP])
            counts.append(group.rows_at_a_time)
            assert group.block(5)[0] == 5 - 5 % counts[-1]
    assert counts[0] == 6 > counts[1] > counts[2] == 1


def test_the_group_is_that_of_the_contract(tmp_path):
    loaded = load()
    keep(tmp_path, loaded)
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
            identity_of(run) for run in loaded.experiments[0].runs()[6:]
        ]
        for name in ("cq", "sampling", "degree", "quadrature", "start", "gamma", "n_steps"):
            assert name in group.attrs
        assert group.attrs["gamma"] == "swept"
        assert group.attrs["status"] == "ok: 4; diverged: 2"
        assert (group["points"][()] == 17).all()
        for dataset in group.values():
            if not dataset.is_scale:
                assert all(len(dim) == 1 for dim in dataset.dims)


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_xarray_opens_members_with_swept_values_as_coordinates(tmp_path, engine):
    xarray = pytest.importorskip("xarray")
    keep(tmp_path, load())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with xarray.open_dataset(tmp_path / "many.h5", group=GROUP, engine=engine) as opened:
            data = opened.load()
    assert {"member", COEFFICIENT, ORDER} <= set(data.coords)
    stiff = data.where(data[COEFFICIENT] > 10, drop=True)
    assert stiff.sizes["member"] == 2
    assert set(stiff["status"].values.ravel()) >= {"diverged"}


def test_what_was_interrupted_goes_on_with_what_is_missing(tmp_path):
    loaded = load()
    assert keep(tmp_path, loaded, most=1) == 6
    with h5py.File(tmp_path / "many.h5") as file:
        assert list(file["/many/bdf2-nodes-s1-gauss1-none"]) == ["n000008"]
    assert keep(tmp_path, loaded) == 6
    assert keep(tmp_path, loaded) == 0
    assert keep(tmp_path, loaded, fresh=True) == 12


def test_a_longer_sweep_computes_the_new_members_and_keeps_their_order(tmp_path):
    keep(tmp_path, load(CONFIG, "sweep.problem.damping.0.coefficient=[0.1, 300]"))
    assert keep(tmp_path, load()) == 4
    with h5py.File(tmp_path / "many.h5") as file:
        np.testing.assert_array_equal(file[GROUP][COEFFICIENT][()], [0.1, 1, 300] * 2)
    # a shorter one keeps what it does not ask for, behind what it asks for
    assert keep(tmp_path, load(CONFIG, "sweep.problem.damping.0.coefficient=[1]")) == 0
    with h5py.File(tmp_path / "many.h5") as file:
        found = file[GROUP][COEFFICIENT][()]
    assert list(found[:2]) == [1, 1]
    assert sorted(found) == sorted([0.1, 1, 300] * 2)


def test_members_of_another_problem_stay_beside_those_that_are_asked_for(tmp_path):
    keep(tmp_path, load())
    changed = load(CONFIG, "problem.mass=2")
    assert keep(tmp_path, changed) == 12
    with h5py.File(tmp_path / "many.h5") as file:
        assert file[GROUP]["position"].shape[0] == 6
    told = [(run.members, run.variant) for run in list_runs(tmp_path / "many.h5").runs]
    assert told == 2 * [(6, "")] + 2 * [(6, "problem.mass = 1")]
    assert keep(tmp_path, load()) == 0


def test_an_experiment_that_gets_a_sweep_keeps_its_single_runs(tmp_path):
    alone = CONFIG.replace("sweep:", "# sweep:")
    assert keep(tmp_path, load(alone)) == 2
    assert keep(tmp_path, load()) == 12
    with h5py.File(tmp_path / "many.h5") as file:
        assert file[GROUP]["position"].ndim == 3
    assert keep(tmp_path, load(alone)) == 0
    with h5py.File(tmp_path / "many.h5") as file:
        assert file[GROUP]["position"].ndim == 2
    assert keep(tmp_path, load()) == 0


def test_thinned_members_share_their_times(tmp_path):
    loaded = load(CONFIG, "store.every=5")
    keep(tmp_path, loaded)
    with h5py.File(tmp_path / "many.h5") as file:
        np.testing.assert_allclose(file[GROUP]["time"][()], np.array([0, 5, 10, 15, 16]) / 4)
        assert file[GROUP]["position"].shape == (6, 5, 1)
    with read_results(tmp_path / "many.h5") as stored:
        for run in loaded.experiments[0].runs():
            assert stored.finished(run) is not None


def test_values_that_are_no_numbers_are_kept(tmp_path):
    text = CONFIG.replace(
        CONFIG.splitlines()[-1],
        "sweep: [{problem.forcing: sin(t), problem.damping: []}, "
        "{problem.forcing: 0, problem.damping: [{order: 1, coefficient: 0.5}]}]",
    )
    loaded = load(text)
    assert keep(tmp_path, loaded) == 4
    assert keep(tmp_path, loaded) == 0
    with h5py.File(tmp_path / "many.h5") as file:
        assert list(file[GROUP]["problem.forcing"].asstr()) == ["sin(t)", "0.0"]
        damping = [json.loads(t) for t in file[GROUP]["problem.damping"].asstr()]
    assert damping == [[], [{"order": 1.0, "coefficient": 0.5}]]


def test_a_listing_has_one_line_for_all_members(tmp_path):
    keep(tmp_path, load())
    runs = list_runs(tmp_path / "many.h5").runs
    assert [(run.n_steps, run.members) for run in runs] == [(8, 6), (16, 6)]
    assert runs[1].status == "ok: 4; diverged: 2"
    assert runs[0].swept == (
        "problem.damping.0.coefficient = 0.1, 1, 300; problem.damping.0.order = 0.5, 1.5"
    )


def test_what_is_said_of_members_takes_little_memory():
    (experiment,) = load().experiments
    records = [
        stored_record(one) for one in execute_job(Job(runs=batches_of(experiment.runs())[0]))
    ]
    count = 1000
    rows = [{**records[k % 6].attributes, "error": k / 7} for k in range(count)]
    tracemalloc.start()
    survey = Survey()
    for one in rows:
        survey.add(one)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert survey.column("error")[count - 1] == (count - 1) / 7
    assert "norm" in survey.common
    # some forty lists would take 8 bytes each, and their numbers 24 more
    assert held < 250 * count


@pytest.mark.parametrize("name", ["accuracy", "steps", "member", "time"])
def test_a_parameter_may_have_any_name_and_members_stay_in_one_group(tmp_path, name):
    text = (
        f"name: many\nproblem: {{kind: lagrangian, coordinates: [x], parameters: {{{name}: 1.0}}, "
        f"lagrangian: vx**2/2 - {name}*x**2/2, initial: {{position: 1.0}}, final_time: 1.0}}\n"
        "method: {rk: gauss, degree: 2}\nladder: {steps: [4]}\n"
        f"sweep: {{problem.parameters.{name}: [1, 2, 3]}}\n"
    )
    keep(tmp_path, load(text))
    (line,) = list_runs(tmp_path / "many.h5").runs
    assert line.members == 3
