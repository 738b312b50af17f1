"""Designs: named sets of overrides, and names for the members of a sweep."""

import json

import numpy as np
import yaml

import fvi_cli as api
from fvi_cli.config import parse_config
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
