"""Changes by ``--set``."""

import pytest

from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError

TEXT = """\
name: example
problem:
  kind: bagley-torvik
  damping: [{order: 1.5, coefficient: 1.0}]
  final_time: 1.0
method: {bdf: [1, 2], sampling: nodes}
ladder: {steps: [2, 4]}
"""


def changed(*overrides: str) -> dict[str, object]:
    (experiment,) = parse_config(TEXT, "f.yaml", overrides=overrides).resolved["experiments"]
    return experiment


def test_values_are_replaced():
    found = changed("problem.mass=2", "problem.damping.0.order=0.5", "ladder.steps=[3, 6]")
    assert found["problem"]["mass"] == 2.0
    assert found["problem"]["damping"] == [{"order": 0.5, "coefficient": 1.0}]
    assert found["ladder"] == {"steps": [3, 6]}


def test_a_value_may_hold_an_equals_sign_and_an_expression():
    assert changed("problem.forcing=1 + t**2")["problem"]["forcing"] == "1 + t**2"
    with pytest.raises(ConfigError, match=r"--set: problem\.forcing: '=' is not allowed"):
        changed("problem.forcing=t == 2")


def test_null_leaves_out_what_another_change_replaced():
    given = ("accuracy.tolerance=1e-6", "method=null")
    for order in (("ladder=null", *given), (*given, "ladder=null")):
        assert changed(*order)["accuracy"] == {"tolerance": 1e-6}
    assert changed("accuracy=null") == changed()
    with pytest.raises(ConfigError, match=r"--set: laddr: there is no such key"):
        changed("laddr=null")


def test_mistakes_of_the_file_and_of_changes_are_told_together():
    with pytest.raises(ConfigError) as caught:
        parse_config(TEXT.replace("1.0}", "x}"), "f.yaml", overrides=["name=a b", "problem.mass=0"])
    places = [line.split(": ")[0] for line in caught.value.complaints]
    assert places == ["--set", "--set", "f.yaml:4:39"]


def test_one_of_several_experiments_is_meant_by_its_number():
    text = (
        "experiments:\n  - {name: a, problem: {kind: pendulum, final_time: 1}, "
        "ladder: {steps: 4}, method: {bdf: 1}}\n"
    )
    config = parse_config(text, "f.yaml", overrides=["experiments.0.ladder.steps=8"])
    assert config.experiments[0].steps == (8,)


def test_steps_take_the_place_of_a_ladder_of_powers():
    text = TEXT[: TEXT.index("ladder:")] + "ladder: {from: 4, to: 6, base: 2}\n"
    assert parse_config(text, "f.yaml").experiments[0].steps == (16, 32, 64)
    config = parse_config(text, "f.yaml", overrides=["ladder.steps=[16, 17]"])
    assert config.experiments[0].steps == (16, 17)
    # control: both in the file contradict each other
    with pytest.raises(ConfigError, match="not together with steps"):
        parse_config(text.replace("{from", "{steps: [16, 17], from"), "f.yaml")
