"""Exported numbers are the stored ones, in every format, whatever a group holds."""

import csv
import dataclasses
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import configuration, fvi
from scipy.io import loadmat

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.errors import RequestError, StorageError
from fvi_cli.storage.export import FORMATS, StoredArrays, export_file, stored_arrays

CONFIG = configuration(
    "kind: bagley-torvik, mass: [[1, 0], [0, 2]], stiffness: [[2, -1], [-1, 2]], "
    "damping: [{order: 0.5, coefficient: 0.3}], initial: {position: [1, 0], velocity: 0}, "
    "final_time: 1.0",
    name="two-masses",
    method="[{rk: gauss, degree: 2}, {baseline: implicit-euler}]",
    steps="4, 8",
)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export")
    config = folder / "two-masses.yaml"
    config.write_text(CONFIG, encoding="utf-8")
    fvi("run", str(config), "--output", str(folder), "-q", code=0)
    return folder / "two-masses.h5"


def read_csv(path: Path) -> tuple[dict[str, object], dict[str, list[str]]]:
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    columns = dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))
    return json.loads(path.with_suffix(".json").read_text(encoding="utf-8")), columns


def test_csv_holds_every_number_to_the_last_digit(stored, tmp_path):
    written = export_file(stored, "csv", tmp_path)
    assert len(written) == 8
    attributes, columns = read_csv(tmp_path / "two-masses-gauss-s2-graded-n000008.csv")
    with h5py.File(stored) as file:
        run = file["two-masses/gauss-s2-graded/n000008"]
        assert [float(word) for word in columns["time"]] == run["time"][()].tolist()
        for k in range(2):
            assert [float(w) for w in columns[f"x{k + 1}"]] == run["position"][:, k].tolist()
            assert [float(w) for w in columns[f"p_x{k + 1}"]] == run["momentum"][:, k].tolist()
        assert [float(word) for word in columns["energy"]] == run["energy"][()].tolist()
        assert attributes["identity"] == run.attrs["identity"]
        assert attributes["step_size"] == 0.125
    assert "dof" not in columns
    assert (attributes["experiment"], attributes["n_steps"]) == ("two-masses", 8)


def test_npz_and_mat_hold_the_same_arrays(stored, tmp_path):
    (npz,) = export_file(stored, "npz", tmp_path)
    (mat,) = export_file(stored, "mat", tmp_path)
    matlab = loadmat(mat, simplify_cells=True)
    with np.load(npz) as arrays:  # without pickle
        for run in stored_arrays(stored):
            place = f"{run.experiment}/{run.case}/{run.name}"
            structure = matlab[run.experiment.replace("-", "_")]
            structure = structure[run.case.replace("-", "_")][run.name]
            for name, values in run.arrays.items():
                assert np.array_equal(arrays[f"{place}/{name}"], values)
                assert np.array_equal(structure[name], values)
            attributes = json.loads(str(arrays[f"{place}/attributes"]))
            assert attributes["n_steps"] == structure["attributes"]["n_steps"] == len(values) - 1


def test_members_become_rows():
    batch = StoredArrays(
        experiment="sweep",
        case="gauss-s3-graded",
        name="n000002",
        attributes={"n_steps": np.int64(2), "swept": '["stiffness"]'},
        arrays={
            "time": np.array([0.0, 0.5, 1.0]),
            "member": np.arange(2),
            "stiffness": np.array([1.5, 2.5]),
            "position": np.arange(12.0).reshape(2, 3, 2),
            "dof": np.arange(2),
            "status": np.array(["ok", "floor"], dtype=object),
        },
        dimensions={
            "time": ("time",),
            "member": ("member",),
            "stiffness": ("member",),
            "position": ("member", "time", "dof"),
            "dof": ("dof",),
            "status": ("member",),
        },
    )
    (name, content), _, (members_name, members) = FORMATS["csv"]("sweep", iter([batch]))
    assert name == "sweep-gauss-s3-graded-n000002.csv"
    assert content.decode().splitlines() == [
        "member,time,stiffness,x1,x2",
        "0,0.0,1.5,0.0,1.0",
        "0,0.5,1.5,2.0,3.0",
        "0,1.0,1.5,4.0,5.0",
        "1,0.0,2.5,6.0,7.0",
        "1,0.5,2.5,8.0,9.0",
        "1,1.0,2.5,10.0,11.0",
    ]
    assert members_name == "sweep-gauss-s3-graded-n000002-members.csv"
    assert members.decode().splitlines() == ["member,stiffness,status", "0,1.5,ok", "1,2.5,floor"]


def one_run(problem: dict[str, object], time: np.ndarray, size: int = 2) -> StoredArrays:
    return StoredArrays(
        experiment="one",
        case="gauss-s3-graded",
        name=f"n{time.size - 1:06}",
        attributes={"n_steps": time.size - 1, "specification": json.dumps({"problem": problem})},
        arrays={
            "time": time,
            "dof": np.arange(size),
            "position": np.zeros((time.size, size)),
            "momentum": np.zeros((time.size, size)),
            "energy": np.zeros(time.size),
        },
        dimensions={
            "time": ("time",),
            "dof": ("dof",),
            "position": ("time", "dof"),
            "momentum": ("time", "dof"),
            "energy": ("time",),
        },
    )


def lines_of(run: StoredArrays) -> list[str]:
    (_, content), _ = FORMATS["csv"]("one", iter([run]))
    return content.decode().splitlines()


@pytest.mark.parametrize(
    ("told", "size", "names"),
    [
        ([], 1, "x,p_x"),
        ([], 3, "x1,x2,x3,p_x1,p_x2,p_x3"),
        (["x", "y"], 2, "x,y,p_x,p_y"),
        (["r", "energy"], 2, "r,position_energy,p_r,p_energy"),
    ],
)
def test_columns_are_called_as_the_coordinates(told, size, names):
    run = one_run({}, np.array([0.0, 1.0]), size)
    attributes = {**run.attributes, **({"coordinates": json.dumps(told)} if told else {})}
    header = lines_of(dataclasses.replace(run, attributes=attributes))[0]
    assert header == f"time,{names},energy"


@pytest.mark.few(3)
@pytest.mark.parametrize(
    ("problem", "names"),
    [
        ("kind: kepler, initial: {position: [1, 0], velocity: [0, 1]}, final_time: 1.0",
         "x,y,p_x,p_y"),
        ("kind: chain, masses: 3, final_time: 1.0", "x1,x2,x3,p_x1,p_x2,p_x3"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("sweep", ["", "sweep: {problem.derivative: [caputo]}\n"])
def test_coordinates_of_kinds_are_stored_with_their_runs(tmp_path, problem, names, sweep):
    api.run(parse_config(configuration(problem, name="named") + sweep, "n.yaml"), output=tmp_path)
    paths = export_file(tmp_path / "named.h5", "csv", tmp_path)
    path = next(one for one in paths if "members" not in one.name)
    header = path.read_text().splitlines()[0]
    assert f",{names},energy" in header


def test_times_are_rounded_once_and_others_left():
    dusty = np.arange(101) * 0.01 * (1 - 2e-16)
    dusty[1] = 0.009999999999999998
    words = [line.split(",")[0] for line in lines_of(one_run({"final_time": 1.0}, dusty))[1:]]
    assert words == [repr(k / 100) for k in range(101)]
    # of a mesh that is not uniform nothing is changed
    graded = np.linspace(0.0, 1.0, 11) ** 2
    words = [line.split(",")[0] for line in lines_of(one_run({"final_time": 1.0}, graded))[1:]]
    assert [float(word) for word in words] == graded.tolist()


def test_names_that_matlab_would_take_for_one_stay_apart(tmp_path):
    def run(experiment: str) -> StoredArrays:
        return StoredArrays(
            experiment=experiment,
            case="1case",
            name="n000001",
            attributes={},
            arrays={"time": np.array([0.0, len(experiment)])},
            dimensions={"time": ("time",)},
        )

    names = ["a-b", "a_b", "x" * 70, "x" * 71]
    ((_, content),) = FORMATS["mat"]("several", map(run, names))
    path = tmp_path / "several.mat"
    path.write_bytes(content)
    matlab = loadmat(path, simplify_cells=True)
    found = [matlab[k]["x1case"]["n000001"]["time"][1] for k in matlab if not k.startswith("__")]
    assert found == [3.0, 3.0, 70.0, 71.0]


def test_command_prints_what_it_writes(stored, tmp_path):
    arguments = ["export", str(stored), "--to", "npz", "--output", str(tmp_path)]
    done = fvi(*arguments, code=0)
    assert done.stdout.split() == [str(tmp_path / "export" / "two-masses" / "two-masses.npz")]
    arguments[3] = "xlsx"
    done = fvi(*arguments, code=2)
    assert "csv, npz, mat" in done.stderr


def test_mistakes_are_told(tmp_path):
    strange = tmp_path / "strange.h5"
    strange.write_bytes(b"not HDF5")
    with pytest.raises(StorageError, match="not a result file"):
        export_file(strange, "csv", tmp_path / "new")
    with pytest.raises(RequestError, match="is not one of csv, npz, mat"):
        export_file(strange, "xml", tmp_path / "new")
    assert not (tmp_path / "new").exists()
