"""Sweeps in configurations: what members they make, and what is said of mistakes."""

import itertools

import pytest

from fvi_cli.config import parse_config, starter_config
from fvi_cli.errors import ConfigError
from fvi_cli.scenes.registry import KINDS

BASE = """\
name: many
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.3}]
  initial: {position: 1.0}
  final_time: 8.0
ladder: {steps: [16, 32]}
"""


def experiment(sweep, *overrides, base=BASE):
    return parse_config(base + sweep, "many.yaml", overrides=overrides).experiments[0]


def complaints(sweep, *overrides, base=BASE):
    with pytest.raises(ConfigError) as caught:
        parse_config(base + sweep, "many.yaml", overrides=overrides)
    return list(caught.value.complaints)


def test_members_are_all_combinations_with_the_last_key_running_fastest():
    members = experiment(
        "sweep: {problem.stiffness: [1, 2], problem.damping.0.order: [0.25, 1.0, 1.5]}"
    ).members
    assert [m.number for m in members] == list(range(6))
    assert [tuple(m.values.values()) for m in members] == list(
        itertools.product([1.0, 2.0], [0.25, 1.0, 1.5])
    )
    for member in members:
        scene = member.problem.scene
        assert scene.damping[0].order == member.values["problem.damping.0.order"]
        assert scene.potential.stiffness[0, 0] == member.values["problem.stiffness"]


def test_a_list_of_members_makes_just_these():
    members = experiment(
        "sweep:\n  - {problem.stiffness: 1, problem.mass: 2}\n"
        "  - {problem.stiffness: 3, problem.mass: 4}\n"
    ).members
    assert [dict(m.values) for m in members] == [
        {"problem.stiffness": 1.0, "problem.mass": 2.0},
        {"problem.stiffness": 3.0, "problem.mass": 4.0},
    ]


@pytest.mark.parametrize(
    ("spacing", "expected"), [("linear", [1.0, 50.5, 100.0]), ("log", [1.0, 10.0, 100.0])]
)
def test_a_range_has_both_ends_exactly(spacing, expected):
    members = experiment(
        f"sweep: {{problem.stiffness: {{from: 1, to: 100, number: 3, spacing: {spacing}}}}}"
    ).members
    assert [m.values["problem.stiffness"] for m in members] == pytest.approx(expected, rel=1e-15)
    assert members[0].values["problem.stiffness"] == 1.0
    assert members[-1].values["problem.stiffness"] == 100.0


def test_overrides_reach_into_a_sweep():
    ranged = "sweep: {problem.stiffness: {from: 1, to: 9, number: 4}}"
    assert len(experiment(ranged, "sweep.problem.stiffness.number=7").members) == 7
    assert len(experiment(ranged, "sweep.problem.stiffness=[1, 2]").members) == 2
    assert len(experiment(ranged, "sweep.problem.mass=[1, 2]").members) == 8
    assert len(experiment("", "sweep.problem.damping.0.order=[0.5, 1]").members) == 2
    listed = "sweep: [{problem.mass: 1}, {problem.mass: 2}]"
    assert experiment(listed, "sweep.1.problem.mass=5").members[1].values == {"problem.mass": 5.0}


@pytest.mark.few(3)
@pytest.mark.parametrize("kind", KINDS)
def test_the_sweep_in_a_starter_file_is_valid_when_it_is_switched_on(kind):
    text = starter_config(kind)
    assert "\n# sweep: {" in text
    switched = text.replace("# sweep:", "sweep:")
    if kind == "bagley-torvik":
        switched = switched.replace("exact: t**2.5", "exact: auto")
    assert len(parse_config(switched, "starter.yaml").experiments[0].members) >= 2
