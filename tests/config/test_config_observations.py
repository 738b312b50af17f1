"""``output``, ``quantities`` and ``events``: what they mean and what is refused."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config.keys.observations import _exact_multiples

BASE = """\
name: seen
problem:
  kind: lagrangian
  coordinates: [x, y]
  parameters: {k: 2.0}
  lagrangian: (vx**2 + vy**2)/2 - k*(x**2 + y**2)/2
  damping: [{order: 0.5, coefficient: 0.2}]
  initial: {position: [1.0, 0.5]}
  final_time: 2.0
  exact: none
method: {rk: gauss, degree: 4}
ladder: {steps: [20]}
"""


def _load(tmp_path: Path, text: str, *overrides: str) -> fvi.LoadedConfig:
    path = tmp_path / "seen.yaml"
    path.write_text(BASE + text, encoding="utf-8")
    return fvi.load(path, overrides=overrides)


@pytest.mark.parametrize(
    ("given", "times"),
    [
        ("{step: 0.5}", [0.0, 0.5, 1.0, 1.5, 2.0]),
        ("{step: 0.3}", [0.0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8]),
        ("{count: 3}", [0.0, 1.0, 2.0]),
        ("{times: [0.1, 2]}", [0.1, 2.0]),
    ],
)
def test_times_of_the_output(tmp_path, given, times):
    (experiment,) = _load(tmp_path, f"output: {given}\n").experiments
    found = experiment.observations.times
    assert found.tolist() == times


def test_expressions_with_parameters_and_the_run(tmp_path):
    text = "quantities: {spring: k*x, power: -dx*vx}\nevents: {zero: {when: x - y}}\n"
    config = _load(tmp_path, text)
    (outcome,) = fvi.run(config)
    trajectory = outcome.finished[0].trajectory
    spring = 2.0 * trajectory.position[:, 0]
    assert np.abs(trajectory.observed.quantities["spring"] - spring).max() < 1e-13
    assert trajectory.steps is None
    # other values are other runs
    runs = [
        one.experiments[0].runs()[0].specification()
        for one in (
            config,
            _load(tmp_path, text, "quantities.spring=k*y"),
            _load(tmp_path, text, "events.zero.direction=rising"),
            _load(tmp_path, text, "output={step: 0.5}"),
            _load(tmp_path, text, "output={step: 0.25}"),
        )
    ]
    assert len({str(one) for one in runs}) == len(runs)
    assert "gauss-s4-graded" in config.experiments[0].methods[0].case


def test_quantities_of_the_members_of_a_sweep(tmp_path):
    text = "sweep: {problem.parameters.k: [1.0, 4.0]}\nquantities: {spring: k*x}\n"
    (outcome,) = fvi.run(_load(tmp_path, text))
    for one, k in zip(outcome.finished, (1.0, 4.0), strict=True):
        observed = one.trajectory.observed
        spring = k * one.trajectory.position[:, 0]
        assert np.abs(observed.quantities["spring"] - spring).max() < 1e-13


def test_a_motion_with_impacts_is_stored_with_its_impacts(tmp_path):
    text = "impacts: {wall: {when: x + 0.5, restitution: 0.8}}\n"
    config = _load(tmp_path, text, "problem.lagrangian=(vx**2 + vy**2)/2 - k*x - y**2/2")
    (first,) = fvi.run(config, output=tmp_path)
    (again,) = fvi.recall(tmp_path / "seen.h5")
    one, other = first.finished[0].trajectory.observed, again.finished[0].trajectory.observed
    assert one.events["wall"].time.size >= 1
    assert np.array_equal(one.events["wall"].time, other.events["wall"].time)
    assert np.abs(one.events["wall"].position[:, 0] + 0.5).max() < 1e-12
    assert first.finished[0].reference == "none (a motion with impacts)"


def test_members_of_a_sweep_bounce_each_for_itself(tmp_path):
    text = (
        "impacts: {wall: {when: x + k/8, restitution: 0.8}}\noutput: {step: 0.25}\n"
        "sweep: {problem.parameters.k: [2.0, 4.0]}\n"
    )
    config = _load(tmp_path, text, "problem.lagrangian=(vx**2 + vy**2)/2 - k*x - y**2/2")
    (first,) = fvi.run(config, output=tmp_path)
    (again,) = fvi.recall(tmp_path / "seen.h5")
    for one, other, k in zip(first.finished, again.finished, (2.0, 4.0), strict=True):
        hits = one.trajectory.observed.events["wall"]
        assert hits.time.size >= 1
        assert np.abs(hits.position[:, 0] + k / 8).max() < 1e-12
        assert np.array_equal(hits.time, other.trajectory.observed.events["wall"].time)
        assert np.array_equal(one.trajectory.position, other.trajectory.position)
    assert first.finished[0].trajectory.time.tolist() == [0.25 * n for n in range(9)]


def test_a_tolerance_with_quantities(tmp_path):
    text = "quantities: {spring: k*x}\naccuracy: {tolerance: 1e-6}\n"
    path = tmp_path / "seen.yaml"
    base = BASE.replace("ladder: {steps: [20]}\n", "").replace(
        "method: {rk: gauss, degree: 4}\n", ""
    )
    path.write_text(base + text, encoding="utf-8")
    (outcome,) = fvi.run(fvi.load(path))
    observed = outcome.finished[0].trajectory.observed
    assert observed.extents["spring"].peak == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("output: {step: 3}\n", "13:16: output.step: 3 is longer than final_time = 2"),
        ("output: {}\n", "13:9: output: exactly one of step, count and times is needed"),
        ("output: {step: 1, count: 3}\n", "13:9: output: exactly one of step, count and times"),
        ("output: {times: [0, 3]}\n", "13:21: output.times.1: 3 is after final_time = 2"),
        ("output: {times: [1, 1]}\n", "13:21: output.times.1: 1 is not after 1; times must"),
        ("output: {step: 1e-7}\n", "13:16: output.step: 2e+07 times are too many; at most 1000"),
        ("output: {step: 1e-320}\n", "13:16: output.step: inf times are too many; at most 1000"),
        ("output: {count: 1}\n", "13:17: output.count: 1 is not allowed; it must be an integer"),
        ("quantities: {a: x + z}\n", "13:21: quantities.a: unknown name 'z'"),
        ("quantities: {x: 2*x}\n", "13:14: quantities.x: is the name of something that is stored"),
        ("quantities: {1a: x}\n", "13:14: quantities.1a: a name has letters, digits and _"),
        ("events: {e: {when: sin(2x)}}\n", "13:25: events.e.when: '*' is missing: write 2*x"),
        ("events: {e: {when: x, direction: up}}\n", "13:34: events.e.direction: the text"),
        ("events: {e: {}}\n", "13:13: events.e.when: missing"),
        ("output: {step: 1}\nstore: {every: 2}\n", "store.every: not together with output"),
        ("output: {step: 1}\nstore: {diagnostics: [energy-balance]}\n", "not together with output"),
        (
            "impacts: {e: {when: x}}\nsweep: {problem.parameters.k: [1, 2]}\n",
            "13:1: impacts: in a sweep every member has a mesh of its own; give output too",
        ),
        ("impacts: {f: {when: vx}}\n", "13:21: impacts.f.when: vx is no place; a surface is"),
        ("impacts: {f: {when: x, restitution: 2}}\n", "13:37: impacts.f.restitution: 2 is above 1"),
        ("impacts: {f: {when: t}}\n", "impacts.f.when: no coordinate occurs in it (x, y)"),
        ("impacts: {f: {when: x}}\nevents: {f: {when: x}}\n", "is the name of an event already"),
    ],
)
def test_mistakes_are_told_with_their_place(tmp_path, text, complaint):
    with pytest.raises(fvi.ConfigError) as caught:
        _load(tmp_path, text)
    assert complaint in str(caught.value)


def test_methods_without_polynomials_and_kinds_without_motion_are_refused(tmp_path):
    with pytest.raises(fvi.ConfigError, match="output: bdf2-points-s1-gauss1-none keeps no poly"):
        _load(tmp_path, "output: {step: 1}\n", "method={bdf: 2}")
    with pytest.raises(fvi.ConfigError, match="quantities: implicit-euler keeps no polynomials"):
        _load(tmp_path, "quantities: {a: ax}\n", "method={baseline: implicit-euler}")
    with pytest.raises(fvi.ConfigError, match="in which nothing moves"):
        fvi.load("saturation", overrides=["experiments.0.output={step: 0.1}"])


FRAME = """\
name: shaken
problem:
  kind: frame
  storeys: 2
  dampers: [{order: 0.5, coefficient: 0.3}]
  parameters: {strength: 0.5, omega: 1.5}
  ground_acceleration: strength*sin(omega*t)
  final_time: 3.0
  exact: none
ladder: {steps: [30]}
quantities:
  roof: ax2 + ground_acceleration
  drive: ground_acceleration - strength*sin(omega*t)
sweep: {problem.parameters.strength: [0.5, 1.0]}
"""


def test_parameters_of_a_force_are_known_everywhere_and_swept(tmp_path):
    path = tmp_path / "shaken.yaml"
    path.write_text(FRAME, encoding="utf-8")
    (outcome,) = fvi.run(path)
    weak, strong = (one.trajectory for one in outcome.finished)
    # a linear scene: twice the strength, twice the motion
    assert np.abs(strong.position - 2.0 * weak.position).max() < 1e-13
    for one in (weak, strong):
        seen = one.observed.quantities
        assert np.abs(seen["drive"]).max() < 1e-15
        assert np.abs(seen["roof"]).max() > 0.1
    numbers = FRAME.replace("strength*sin(omega*t)\n  final", "0.5*sin(1.5*t)\n  final")
    path.write_text(numbers.partition("sweep")[0], encoding="utf-8")
    (plain,) = fvi.run(path)
    assert np.array_equal(plain.finished[0].trajectory.position, weak.position)


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ("forcing: a*sin(w*t)", ":5:18: problem.forcing: unknown name 'w' (known: a, e, pi, t)"),
        ("forcing: sin(t)\n  exact: [b]", "problem.exact.0: unknown name 'b'"),
        ("parameters: {x: 1}", "problem.parameters: given twice"),
    ],
)
def test_names_that_are_no_parameters(tmp_path, given, complaint):
    path = tmp_path / "one.yaml"
    path.write_text(
        "name: one\nproblem:\n  kind: pendulum\n  parameters: {a: 1}\n"
        f"  {given}\n  final_time: 1\nladder: {{steps: [4]}}\n",
        encoding="utf-8",
    )
    with pytest.raises(fvi.RequestError) as raised:
        fvi.load(path)
    assert complaint in str(raised.value)


def test_a_parameter_must_have_a_name_of_its_own(tmp_path):
    with pytest.raises(fvi.RequestError, match=r"parameters\.x: the name is a coordinate"):
        fvi.load(
            {
                "name": "one",
                "problem": {"kind": "pendulum", "parameters": {"x": 1.0}, "final_time": 1.0},
                "ladder": {"steps": [4]},
            }
        )


@pytest.mark.parametrize(("length", "parts"), [(20.0, 999_999), (0.1, 7), (1e-300, 13), (1e300, 3)])
def test_every_time_is_the_nearest_number_to_its_fraction(length, parts):
    step = Fraction(repr(length)) / parts
    expected = [float(k * step) for k in range(200)]
    assert _exact_multiples(length, parts, 200).tolist() == expected
