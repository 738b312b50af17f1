"""Result files and their parts: what is stored is found, kept, folded, and refused."""

import itertools
import random

import h5py
import numpy as np
import pytest
from command_line import configuration, fvi
from stored_runs import add, assert_same, kept_in

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.errors import StorageError
from fvi_cli.storage import Store, list_runs
from fvi_cli.storage.groups import read_records, run_groups
from fvi_cli.storage.hdf5 import opened
from fvi_cli.studies.experiment import FinishedRun

OSCILLATOR = (
    "kind: damped-oscillator, damping: [{order: 0.5, coefficient: 0.3}], "
    "initial: {position: 1.0}, final_time: 2.0, exact: none"
)
SINGLE = configuration(OSCILLATOR, name="one", steps="4, 8")
SWEPT = SINGLE + "sweep: {problem.stiffness: [1.0, 2.0, 3.0]}\n"


def load(text=SINGLE, *overrides):
    return parse_config(text, "one.yaml", overrides=overrides)


def run(folder, text=SINGLE, *overrides, **options) -> list[FinishedRun]:
    (outcome,) = api.run(load(text, *overrides), output=folder, **options)
    return list(outcome.finished)


def computed(caplog) -> int:
    """How many runs the last command had to compute."""
    line = [one for one in caplog.messages if " of them stored" in one][-1].split()
    return int(line[1]) - int(line[3])


@pytest.mark.parametrize("text", [SINGLE, SWEPT])
def test_another_value_and_back_computes_each_once(tmp_path, caplog, text):
    caplog.set_level("DEBUG")
    first = run(tmp_path, text)
    assert computed(caplog) == len(first)
    for overrides, count in (((), 0), (("problem.mass=2",), len(first)), ((), 0)):
        found = run(tmp_path, text, *overrides)
        assert computed(caplog) == count
    for one, other in zip(first, found, strict=True):
        assert_same(one, other)
    shown = list_runs(tmp_path / "one.h5").runs
    assert [one.variant for one in shown] == ["", "", *["problem.mass = 2"] * 2]
    run(tmp_path, text, prune=True)
    assert not any(one.variant for one in list_runs(tmp_path / "one.h5").runs)
    assert computed(caplog) == 0


def test_a_member_is_the_same_run_as_without_a_sweep(tmp_path, caplog):
    caplog.set_level("DEBUG")
    (single, _) = run(tmp_path, SINGLE, "problem.stiffness=2")
    swept = run(tmp_path, SWEPT)
    assert computed(caplog) == 4
    assert_same(single.trajectory, swept[1].trajectory)
    run(tmp_path, SINGLE, "problem.stiffness=3")
    assert computed(caplog) == 0
    run(tmp_path, SWEPT.replace("2.0, 3.0", "2.0, 3.0, 4.0"))
    assert computed(caplog) == 2
    # a shorter sweep keeps what it does not ask for
    run(tmp_path, SWEPT.replace("1.0, 2.0, 3.0", "2.0"))
    assert computed(caplog) == 0
    assert kept_in(tmp_path / "one.h5", load(SWEPT).experiments[0].runs()) == 6


def test_parts_are_found_and_folded_by_any_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loaded, path = load(SWEPT), tmp_path / "results/one.h5"
    store = Store(path)
    store.describe(loaded.text, loaded.resolved, loaded.overrides)
    add(store, run(None, SWEPT)[:3])
    assert not path.exists()
    assert "3 members" in fvi("show", path, code=0).stdout
    assert path.exists()
    assert not store.folder.exists()
    assert "3 runs of one are not stored" in fvi("quantities", path).stderr


def test_what_other_programs_add_stays(tmp_path):
    path = tmp_path / "one.h5"
    before = run(tmp_path, SWEPT)
    with h5py.File(path, "a") as file:
        group = file["one/gauss-s2-graded/n000008"]
        for node in (file, group, group["position"]):
            node.attrs["note"] = "of a viewer ½"
        file["mine/values"] = [1.0, 2.0]
    for one, other in zip(before, run(tmp_path, SWEPT), strict=True):
        assert_same(one, other)
    run(tmp_path, SWEPT.replace("3.0]", "3.0, 4.0]"))
    with h5py.File(path) as file:
        assert file.attrs["note"] == "of a viewer ½"
        group = file["one/gauss-s2-graded/n000008"]
        assert [node.attrs["note"] for node in (group, group["position"])] == ["of a viewer ½"] * 2
        assert file["mine/values"][()].tolist() == [1.0, 2.0]


def test_matrices_and_input_files_come_back(tmp_path, monkeypatch):
    random_ = np.random.default_rng(1)
    root = random_.normal(size=(12, 12))
    np.save(tmp_path / "K.npy", root @ root.T + 12 * np.eye(12))
    (tmp_path / "one.yaml").write_text(
        configuration(
            f"kind: structure, mass: {np.eye(12).tolist()}, stiffness: {{file: K.npy}}, "
            f"initial: {{position: {[1.0] * 12}}}, final_time: 0.25, exact: none",
            name="one",
        )
    )
    (first,) = api.run(tmp_path / "one.yaml", output=tmp_path)
    # it is found elsewhere too, and the file alone is enough
    (tmp_path / "elsewhere").mkdir()
    for name in ("K.npy", "one.yaml", "one.h5"):
        (tmp_path / name).rename(tmp_path / "elsewhere" / name)
    monkeypatch.setattr("fvi_cli.scenes.records.inputs._KEPT", {})
    (again,) = api.recall(tmp_path / "elsewhere/one.h5")
    for one, other in zip(first.finished, again.finished, strict=True):
        assert_same(one, other)


# --- damage and refusals --------------------------------------------------------------------------


def contents(path) -> list[object]:
    """All that this program reads of a file."""
    found: list[object] = [Store(path).configuration()]
    with opened(path) as file:
        for group in run_groups(file):
            for one in itertools.chain.from_iterable(read_records(group)):
                arrays = {name: values.tobytes() for name, values in one.arrays.items()}
                found.append((one.path, repr(one.values), arrays))
    return found


def test_a_flipped_bit_is_found_or_harmless(tmp_path):
    """Control: a third of the bits or more are found, so the file is full of what matters."""
    run(tmp_path, SWEPT)
    path, drawn = tmp_path / "one.h5", random.Random(7)
    whole, expected, reported = path.read_bytes(), contents(path), 0
    for _ in range(60):
        content = bytearray(whole)
        content[drawn.randrange(len(content))] ^= 1 << drawn.randrange(8)
        path.write_bytes(content)
        try:
            assert contents(path) == expected
        except StorageError:
            reported += 1
    assert reported > 20


def test_a_damaged_file_says_which_group_is(tmp_path):
    finished = run(tmp_path, SWEPT)
    path = tmp_path / "one.h5"
    whole = bytearray(path.read_bytes())
    last = finished[4].trajectory.position[2:].tobytes()[:8]
    whole[whole.rindex(last)] ^= 1
    path.write_bytes(whole)
    with pytest.raises(StorageError, match=r"/one/gauss-s2-graded/n000008.* are whole"):
        Store(path).read(load(SWEPT).experiments[0].runs())
    assert len(Store(path).read(load(SWEPT).experiments[0].runs()[:3])) == 3


@pytest.mark.parametrize("ending", [".h5", ".journal", ".parts"])
def test_files_of_version_3_are_refused_and_left_as_they_are(tmp_path, ending):
    path = tmp_path / f"one{ending}"
    if ending == ".h5":
        with h5py.File(path, "w") as file:
            file.attrs.update({"creator": "fvi-cli", "format": 4, "fvi_version": "0.3.0"})
    elif ending == ".parts":
        path.mkdir()
    else:
        path.write_bytes(b"frames")
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(StorageError, match=r"is of fvi 0.3.*; keep it for that version, or choose"):
        run(tmp_path, prune=True)
    assert (path.read_bytes() if path.is_file() else None) == before
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_file_of_another_program_is_refused(tmp_path):
    with h5py.File(tmp_path / "one.h5", "w") as file:
        file["x"] = 1.0
    with pytest.raises(StorageError, match="is no result file of fvi"):
        run(tmp_path)


def test_a_folder_that_cannot_be_written_is_refused_before_anything_is_computed(
    tmp_path, monkeypatch
):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("fvi_cli.runner.work.execute_batch", None)
    with pytest.raises(StorageError, match="cannot be written"):
        run(tmp_path / "file" / "below")


def test_the_mode_of_a_file_stays(tmp_path):
    run(tmp_path, SINGLE, "ladder.steps=[4]")
    (tmp_path / "one.h5").chmod(0o600)
    run(tmp_path)
    assert (tmp_path / "one.h5").stat().st_mode & 0o777 == 0o600
