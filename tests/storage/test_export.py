"""Exported numbers are the stored ones, a file for every run, named as the run is."""

import csv
from pathlib import Path

import h5py
import numpy as np
import pytest
from command_line import configuration

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.storage.export import export_file

CONFIG = configuration(
    "kind: bagley-torvik, mass: [[1, 0], [0, 2]], stiffness: [[2, -1], [-1, 2]], "
    "damping: [{order: 0.5, coefficient: 0.3}], initial: {position: [1, 0], velocity: 0}, "
    "final_time: 1.0",
    name="two-masses",
    method="[{rk: gauss, degree: 2}, {baseline: implicit-euler}]",
    steps="4, 8",
)
OSCILLATOR = "kind: damped-oscillator, initial: {position: 1.0}, final_time: 1.0"


def read_csv(path: Path) -> dict[str, list[str]]:
    rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    return dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))


def exported(folder: Path, text: str) -> dict[str, Path]:
    loaded = parse_config(text, "one.yaml")
    api.run(loaded, output=folder)
    return {path.name: path for path in export_file(folder / f"{loaded.name}.h5", folder / "csv")}


def test_csv_holds_every_number_to_the_last_digit(tmp_path):
    found = exported(tmp_path, CONFIG)
    assert len(found) == 4
    columns = read_csv(found["two-masses-gauss-s2-graded-n000008.csv"])
    with h5py.File(tmp_path / "two-masses.h5") as file:
        run = file["two-masses/gauss-s2-graded/n000008"]
        assert [float(word) for word in columns["time"]] == run["time"][()].tolist()
        for k in range(2):
            assert [float(w) for w in columns[f"x{k + 1}"]] == run["position"][:, k].tolist()
            assert [float(w) for w in columns[f"p_x{k + 1}"]] == run["momentum"][:, k].tolist()
        assert [float(word) for word in columns["energy"]] == run["energy"][()].tolist()
    assert "dof" not in columns


def test_members_are_named_by_their_number(tmp_path):
    sweep = "sweep: {problem.stiffness: [1.0, 2.0]}\n"
    found = exported(tmp_path, configuration(OSCILLATOR, name="swept", steps="4, 8") + sweep)
    assert [name for name in found if "n000008" in name] == [
        f"swept-member-{k}-gauss-s2-graded-n000008.csv" for k in range(2)
    ]
    last = [float(read_csv(path)["x"][-1]) for path in found.values()]
    assert len(set(last)) == 4


@pytest.mark.parametrize("settled", ["", "accuracy: {tolerance: 1e-6}\n"])
def test_designs_are_named_and_may_have_values_in_words(tmp_path, settled):
    designs = (
        "designs: {soft: {problem.derivative: caputo, problem.stiffness: 0.5},"
        " bare: {}, late: {problem.derivative: riemann-liouville, problem.stiffness: 2.0}}\n"
    )
    problem = OSCILLATOR.replace("position: 1.0", "position: 0.0, velocity: 1.0")
    problem += ", damping: [{order: 0.5, coefficient: 0.1}]"
    text = configuration(problem, name="three", method="{rk: gauss, degree: 2}") + designs
    if settled:
        kept = [one for one in text.splitlines() if not one.startswith(("ladder", "method"))]
        text = "\n".join([*kept, settled])
    found = exported(tmp_path, text)
    assert {name.split("-")[1] for name in found} == {"soft", "bare", "late"}


def test_quantities_are_columns(tmp_path):
    text = configuration(OSCILLATOR, name="seen", method="{rk: gauss, degree: 2}", steps="4")
    (path,) = exported(tmp_path, text + "quantities: {load: 2*x + vx}\n").values()
    columns = read_csv(path)
    assert list(columns) == ["time", "x", "p_x", "energy", "load"]
    assert np.isfinite(np.array(columns["load"], dtype=float)).all()
