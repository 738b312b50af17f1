"""Designs: named sets of overrides, and names for the members of a sweep."""

import json
import re

import numpy as np
import pytest
import yaml
from command_line import fvi

import fvi_cli as api
from fvi_cli.config import parse_config
from fvi_cli.reports.kinds.designs import design_sheet
from fvi_cli.storage.identity import identity_of

ZENER = "{storey: 1, law: zener, order: 0.6, time: 0.1, relaxed: 5.0, unrelaxed: 60.0}"
TEXT = f"""\
name: building
problem:
  kind: frame
  masses: [2.0, 2.0, 1.6]
  stiffnesses: [90.0, 80.0, 60.0]
  rayleigh: {{ratios: [0.02, 0.05], modes: [1, 3]}}
  dampers: [{{storey: 1, order: 0.5, coefficient: 4.0}}]
  ground_acceleration: sin(3*t)
  final_time: 4.0
  exact: none
designs:
  bare: {{problem.dampers: []}}
  springpot: {{}}
  stiff springpot: {{problem.dampers.0.coefficient: 12.0, problem.stiffnesses.2: 66.0}}
  zener alone: {{problem.dampers: [{ZENER}], problem.rayleigh: null}}
method: gauss3
ladder: {{steps: [96]}}
quantities: {{drift: x1, roof: ax3}}
"""
NAMES = ["bare", "springpot", "stiff springpot", "zener alone"]


def experiment_of(text):
    (experiment,) = parse_config(text, "building.yaml").experiments
    return experiment


def alone(**problem):
    """The experiment of one design, written out."""
    tree = yaml.safe_load(TEXT)
    del tree["designs"]
    for key, value in problem.items():
        if value is None:
            del tree["problem"][key]
        else:
            tree["problem"][key] = value
    return experiment_of(json.dumps(tree))


WRITTEN_OUT = {
    "bare": {"dampers": []},
    "springpot": {},
    "stiff springpot": {
        "dampers": [{"storey": 1, "order": 0.5, "coefficient": 12.0}],
        "stiffnesses": [90.0, 80.0, 66.0],
    },
    "zener alone": {"dampers": [yaml.safe_load(ZENER)], "rayleigh": None},
}


def test_a_design_is_the_problem_with_its_overrides():
    experiment = experiment_of(TEXT)
    assert [member.name for member in experiment.members] == NAMES
    (outcome,) = api.run(parse_config(TEXT, "building.yaml"))
    for member, finished in zip(experiment.members, outcome.finished, strict=True):
        own = alone(**WRITTEN_OUT[member.name])
        assert member.specification == own.problem_specification
        expected = api.integrate(own.problem.scene, "gauss3", 96).position
        moved = finished.trajectory.position
        assert np.abs(moved - expected).max() < 1e-11 * np.abs(expected).max()


def test_names_change_no_identity_and_what_is_resolved_is_the_same():
    config = parse_config(TEXT, "building.yaml")
    renamed = parse_config(TEXT.replace("bare:", "without:"), "building.yaml")
    for one, other in zip(config.experiments[0].runs(), renamed.experiments[0].runs(), strict=True):
        assert identity_of(one) == identity_of(other)
        assert one.member.name != other.member.name or one.member.name != "bare"
    again = parse_config(json.dumps(config.resolved), "again.yaml")
    assert again.resolved == config.resolved
    same = [member.specification for member in again.experiments[0].members]
    assert same == [member.specification for member in config.experiments[0].members]


def test_designs_meet_every_value_of_a_sweep():
    text = TEXT + "sweep: {problem.masses.0: [2.0, 3.0]}\n"
    members = experiment_of(text).members
    assert [one.name for one in members] == [name for name in NAMES for _ in range(2)]
    assert [one.values["problem.masses.0"] for one in members] == [2.0, 3.0] * 4
    assert members[1].label == "bare, masses.0 = 3"
    config = parse_config(text, "building.yaml")
    again = parse_config(json.dumps(config.resolved), "again.yaml")
    assert again.resolved == config.resolved
    # what is changed by one design only has one value, that of the problem, in the others
    stiff = {one.name: one.values["problem.stiffnesses.2"] for one in members}
    assert stiff == {**dict.fromkeys(NAMES, 60.0), "stiff springpot": 66.0}


def test_an_override_from_the_command_line_reaches_a_design():
    config = parse_config(
        TEXT, "building.yaml", overrides=["designs.stiff springpot.problem.dampers.0.coefficient=8"]
    )
    stiff = config.experiments[0].members[2].specification
    assert stiff["dampers"][0]["coefficient"] == 8.0
    assert stiff["stiffnesses"][2] == 66.0


def test_one_table_holds_designs_and_quantities(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "building.yaml").write_text(TEXT, encoding="utf-8")
    said = fvi("run", "building.yaml", code=0).stdout
    fvi("quantities", "building.yaml", code=0)
    # no list or mapping as Python prints it
    tables = [file.read_text(encoding="utf-8") for file in (tmp_path / "results").rglob("*.csv")]
    for text in (said, *tables):
        assert not re.search(r"\{'|\['|None", text)
    (outcome,) = api.recall("results/building.h5")
    rows = design_sheet(outcome.finished).rows
    assert [row["design"] for row in rows] == NAMES
    peaks = {name: np.array([row[f"peak_{name}"] for row in rows]) for name in ("drift", "roof")}
    for name, found in peaks.items():
        said_change = [row[f"peak_{name}_change"] or 0 for row in rows]
        assert said_change == pytest.approx((found / found[0] - 1).tolist(), rel=1e-12)
    assert [row["problem.stiffnesses.2"] for row in rows] == [60.0, 60.0, 66.0, 60.0]
    for row in rows:
        assert row["design"] in said
        assert f"{row['peak_drift']:.4g}" in said


def test_the_change_is_against_the_first_design_at_the_same_values(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "building.yaml").write_text(
        TEXT + "sweep: {problem.masses.0: [2.0, 3.0]}\n", encoding="utf-8"
    )
    fvi("run", "building.yaml", code=0)
    (outcome,) = api.recall("results/building.h5")
    rows = design_sheet(outcome.finished).rows
    first = {row["problem.masses.0"]: row["peak_drift"] for row in rows if row["design"] == "bare"}
    assert len(set(first.values())) == 2
    for row in rows:
        if row["design"] != "bare":
            change = row["peak_drift"] / first[row["problem.masses.0"]] - 1
            assert row["peak_drift_change"] == pytest.approx(change, rel=1e-12)


def test_designs_of_a_result_file_are_in_the_order_of_the_configuration(tmp_path):
    api.run(parse_config(TEXT, "building.yaml"), output=tmp_path)
    (again,) = api.recall(tmp_path / "building.h5")
    assert [one.name for one in again.experiment.members] == NAMES
