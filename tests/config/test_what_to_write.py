"""Complaints say what to write, and what they say is understood."""

import logging
import re

import numpy as np
import pytest
from command_line import configuration, fvi

import fvi_cli
from fvi_cli.config import parse_config
from fvi_cli.errors import ConfigError

SPRING = "kind: damped-oscillator, final_time: 1.0, initial: {position: 1.0}, exact: none"
SHAKEN = "kind: frame, storeys: 3, stiffness: 40.0, final_time: 2.0, exact: none"


def refused(problem, folder=None, **more):
    with pytest.raises(ConfigError) as caught:
        parse_config(configuration(problem, **more), "f.yaml", base=folder)
    return str(caught.value)


def test_numbers_in_place_of_a_matrix():
    rest = "initial: {}, final_time: 1.0, exact: none"
    told = refused(f"kind: structure, mass: [1, 2.5, 3e-1], stiffness: 1, {rest}")
    assert told.count("\n") == 0
    (written,) = re.findall(r"for a diagonal matrix write (\[\[.*\]\])$", told)
    text = configuration(f"kind: structure, mass: {written}, stiffness: 1, {rest}")
    (experiment,) = parse_config(text, "f.yaml").experiments
    assert experiment.problem.scene.inertia.mass.diagonal().tolist() == [1.0, 2.5, 0.3]
    long = refused(f"kind: structure, mass: {[1] * 20}, stiffness: 1, {rest}")
    assert "20 numbers where 20 rows are needed; for a diagonal matrix write [[m1, 0, 0]," in long


@pytest.mark.parametrize("law", ["kelvin-voigt", "Kelvin Voigt", "kelvin_voigt", "voigt"])
def test_kelvin_voigt_by_every_name_and_the_keys_that_it_has(law, caplog):
    told = refused(f"{SPRING}, damping: [{{law: {law}, stiffness: 2.0, viscosity: 0.1}}]")
    assert "viscosity: not a key: write coefficient" in told
    with caplog.at_level(logging.INFO):
        text = configuration(
            f"{SPRING}, damping: [{{law: {law}, stiffness: 2.0, coefficient: 0.1}}]"
        )
        (experiment,) = parse_config(text, "f.yaml").experiments
    (term,) = experiment.problem.scene.damping
    assert term.order == 1.0
    assert experiment.problem.scene.potential.form.item() == 3.0
    assert [f"law: {law} is read as kelvin-voigt" in one for one in caplog.messages] == (
        [] if law == "kelvin-voigt" else [True]
    )


@pytest.mark.parametrize("law", ["dashpot", "viscous", "Newton"])
def test_laws_that_are_springpots(law):
    told = refused(f"{SPRING}, damping: [{{law: {law}, stiffness: 2.0, viscosity: 0.1}}]")
    assert told.startswith("f.yaml:2:")
    assert told.count("\n") == 0
    (written,) = re.findall(r"write (\{.*?\})", told)
    text = configuration(f"{SPRING}, damping: [{written.replace('c}', '0.1}')}]")
    (experiment,) = parse_config(text, "f.yaml").experiments
    (term,) = experiment.problem.scene.damping
    assert term.order == 1.0


def test_a_record_that_is_missing_or_has_another_ending(tmp_path):
    (tmp_path / "quake.txt").write_text("t,a\n0,1\n2,1\n")
    for file in ("none.xyz", "none.csv", "none.at3", "none"):
        told = refused(f"{SHAKEN}, ground_acceleration: {{file: {file}}}", tmp_path)
        assert f"ground_acceleration.file: {file}: cannot be read: no such file" in told
        assert "column" not in told
    told = refused(f"{SHAKEN}, ground_acceleration: {{file: quake.txt}}", tmp_path)
    assert "column: missing; it must be the name of a column (records in AT2 need none" in told
    for key in ("unit", "units"):
        record = f"{{file: quake.txt, column: a, {key}: g}}"
        told = refused(f"{SHAKEN}, ground_acceleration: {record}", tmp_path)
        assert f"{key}: not a key: write scale: g for a record in g, in metres and seconds" in told


@pytest.mark.parametrize("coefficient", ["-0.1", "-1e-9", "-1e9"])
def test_negative_damping_is_said(caplog, coefficient):
    terms = f"[{{order: 0.5, coefficient: 0.2}}, {{order: 1.5, coefficient: {coefficient}}}]"
    text = configuration(f"{SPRING}, damping: {terms}")
    with caplog.at_level(logging.WARNING):
        parse_config(text, "f.yaml")
    (line,) = caplog.messages
    told = f"problem.damping.1.coefficient: {float(coefficient):g} is negative: such damping"
    assert line.startswith(f"f.yaml:2:{text.splitlines()[1].index(coefficient) + 1}: {told}")
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        parse_config(f"{text}allow_unstable: true\n", "f.yaml")
        parse_config(text.replace(coefficient, "0.0"), "f.yaml")
    assert not caplog.messages


def test_a_command_shows_the_warning(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = configuration(f"{SPRING}, damping: [{{order: 0.5, coefficient: -0.1}}]")
    (tmp_path / "f.yaml").write_text(text)
    assert "coefficient: -0.1 is negative" in fvi("check", "f.yaml", code=0).stderr


def test_a_record_in_g_is_scaled_to_metres_and_seconds(tmp_path):
    (tmp_path / "quake.csv").write_text("t,a\n0,0.25\n2,-0.5\n")

    def acceleration(scale):
        record = f"{{file: quake.csv, column: a, scale: {scale}}}"
        text = configuration(f"{SHAKEN}, ground_acceleration: {record}")
        (experiment,) = parse_config(text, "f.yaml", base=tmp_path).experiments
        return experiment.problem.scene.forcing.pieces[0].evaluate(np.array([2.0]))

    assert acceleration("g") == pytest.approx(9.80665 * acceleration("1.0"), rel=1e-14)
    told = refused(f"{SHAKEN}, ground_acceleration: {{file: q, scale: gravity}}", tmp_path)
    assert "must be a finite number, or g for 9.80665 m/s^2" in told


@pytest.mark.parametrize("given", ["units: g", "units: {acceleration_of_ground: g}"])
def test_units_of_a_record_are_a_scale(given, tmp_path):
    text = configuration(SPRING) + given + "\n"
    with pytest.raises(ConfigError, match=r"for a record in g write scale: g next to its file"):
        parse_config(text, "f.yaml")


CHAIN = (
    "kind: chain, masses: 3, stiffness: 1.0, final_time: 1.0, exact: none, "
    "initial: {position: [1.0, 0.0, 0.0]}"
)


@pytest.mark.parametrize(
    ("damping", "sweep", "told"),
    [
        # eigenvalues 3 and -1, and 0 and 2
        ("[[1, 2, 0], [2, 1, 0], [0, 0, 1]]", "", "the matrix has a negative eigenvalue"),
        ("[[1, 1, 0], [1, 1, 0], [0, 0, 1]]", "", ""),
        ("[[-1e-9, 0, 0], [0, 1e-9, 0], [0, 0, 0]]", "", "the matrix has a negative eigenvalue"),
        ("0.1", "[0.1, -0.2, -0.3]", "-0.2 is negative"),
        ("0.1", "[0.1, 0.2, 0]", ""),
        ("0.1", "{from: 0.5, to: -0.5, number: 5}", "-0.25 is negative"),
    ],
)
def test_negative_matrices_and_members_are_said(caplog, damping, sweep, told):
    text = configuration(f"{CHAIN}, damping: [{{order: 0.5, coefficient: {damping}}}]")
    if sweep:
        text += f"sweep: {{problem.damping.0.coefficient: {sweep}}}\n"
    with caplog.at_level(logging.WARNING):
        parse_config(text, "f.yaml")
    # the control: positive ones, and what is meant
    assert [one for one in caplog.messages if "drives" in one] == caplog.messages
    assert len(caplog.messages) == bool(told)
    assert all(
        f"problem.damping.0.coefficient: {told}: such damping drives" in m for m in caplog.messages
    )
    caplog.clear()
    with caplog.at_level(logging.WARNING):
        parse_config(f"{text}allow_unstable: true\n", "f.yaml")
    assert not caplog.messages


FORCED = """
name: f
problem:
  kind: duffing
  damping: [{order: 0.6, coefficient: 0.25}]
  parameters: {F: 0.4, w: 2.0}
  forcing: F*cos(w*t)
  initial: {position: 0.5}
  final_time: 10.0
  exact: none
method: gauss3
ladder: {steps: [64]}
events: {period: {when: sin(w*t), direction: rising}}
"""


def told(text, *changes):
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "f.yaml", overrides=changes)
    return str(caught.value)


@pytest.mark.parametrize("key", ["F", "order", "coefficient", "parameters.w", "mass"])
def test_a_swept_key_without_its_path_is_answered_with_the_path(key):
    (meant,) = re.findall(r"write (problem\.\S+)$", told(f"{FORCED}sweep: {{{key}: [0.5, 0.6]}}"))
    assert meant.endswith(f".{key}")
    text = f"{FORCED}sweep: {{{meant}: [0.5, 0.6]}}"
    (experiment,) = parse_config(text, "f.yaml").experiments
    assert [one.values for one in experiment.members] == [{meant: 0.5}, {meant: 0.6}]
    names = "{weak: {%s: 0.5}, strong: {%s: 0.6}}"
    assert told(f"{FORCED}designs: {names % (key, key)}").count(f"write {meant}") == 2
    assert parse_config(f"{FORCED}designs: {names % (meant, meant)}", "f.yaml").experiments


def test_a_parameter_that_is_set_without_its_path():
    (change,) = re.findall(r"write (\S+)$", told(FORCED, "F=0.7"))
    (experiment,) = parse_config(FORCED, "f.yaml", overrides=[change]).experiments
    assert experiment.problem.numbers["F"] == 0.7


def test_null_leaves_out_a_key_and_not_what_is_no_key():
    usual = FORCED.replace("method: gauss3\n", "")
    found = [
        parse_config(text, "f.yaml", overrides=changes).experiments[0]
        for text, changes in (
            (FORCED, ["method=null", "events=~"]),
            (usual, ["events=null"]),
            (FORCED, ["events.period=null", "method=null", "events=null"]),
        )
    ]
    assert len({one.methods for one in found}) == 1
    assert not any(one.observations.events for one in found)
    assert "did you mean 'method'" in told(FORCED, "methd=null")
    assert "the value is missing" in told(FORCED, "problem.damping.0=null")
    assert told(FORCED, "problem=null").startswith("f.yaml:2:1: problem: missing")


def test_what_happens_once_every_period():
    (when,) = re.findall(r"a rising zero of (\S+)$", told(FORCED.replace("sin(w*t)", "t % 2")))
    text = FORCED.replace("sin(w*t)", when.replace("T", "2"))
    (experiment,) = parse_config(text, "f.yaml").experiments
    outcome = fvi_cli.run(parse_config(text, "f.yaml"))[0]
    seen = outcome.finished[0].trajectory.observed.events["period"]
    assert np.allclose(seen.time, [2.0, 4.0, 6.0, 8.0, 10.0][: seen.time.size], atol=1e-9)
    assert seen.time.size >= 4
    assert experiment.observations.events["period"].direction == "rising"


UNITS = {
    "50 ms": 0.05,
    "50 kN/m": 5e4,
    "4 kN s/m": 4e3,
    "9.81 m/s^2": 9.81,
    "500 cm/s²": 5.0,
    "1,5 s": 1.5,
    "2pi": 2 * np.pi,
    "1d3": 1e3,
    "7 GPa": 7e9,
    "2 min": 120.0,
    "30 apples": 30.0,
    "100 N·s/m": 100.0,
    "2e-3 mm": 2e-6,
    "5 %": 0.05,
    "180 deg": np.pi,
    "3/4": 0.75,
}


@pytest.mark.parametrize("given", UNITS)
def test_numbers_with_more_behind_them_are_answered_in_units_without_prefixes(given):
    (written,) = re.findall(r"write (\S+)$", told(FORCED.replace("10.0", given)))
    assert float(written) == pytest.approx(UNITS[given], rel=1e-14)


def test_a_force_of_the_motion_names_what_can_be_written():
    said = told(FORCED.replace("F*cos(w*t)", "-0.5*vx"))
    assert "unknown name 'vx'; a force here depends on t alone" in said
    (term,) = re.findall(r"damping: \[(\{order: 1, coefficient: c\})\]", said)
    text = FORCED.replace("F*cos(w*t)", "'0'").replace(
        "{order: 0.6, coefficient: 0.25}", term.replace("c}", "0.5}")
    )
    assert parse_config(text, "f.yaml").experiments[0].problem.scene.damping[0].order == 1.0
    # a phase and an angle of the force are names like others
    assert "to define it write" in told(FORCED.replace("w*t", "w*t + phi"))


@pytest.mark.parametrize("command", ["response five-storeys", "export x.h5", "modes", "stability"])
def test_what_is_missing_on_the_command_line_has_an_example(command):
    done = fvi(*command.split(), code=2)
    (example,) = re.findall(rf"Write, for example, fvi ({command.split()[0]} .*)", done.stderr)
    assert example
