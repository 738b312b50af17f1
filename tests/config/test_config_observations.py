"""``output``, ``quantities`` and ``events``: what they mean and what is refused."""

from pathlib import Path

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.config.names import names_along

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
    # other values are other runs
    runs = [
        one.experiments[0].runs()[0].settings()
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
    assert np.abs(plain.finished[0].trajectory.position - weak.position).max() < 1e-13


SHADOWED = {
    "lagrangian": {
        "coordinates": ["r", "phi"],
        "lagrangian": "vr**2/2 + vphi**2/2 - r**2 - phi**2",
        "damping": [{"order": 0.5, "coefficient": [[0.1, 0], [0, 0.2]], "name": "oil"}],
    },
    "frame": {
        "storeys": 2,
        "mass": 1.0,
        "stiffness": 30.0,
        "ground_acceleration": "0.2*sin(4*t)",
        "dampers": [{"law": "springpot", "order": 0.5, "coefficient": 0.3}],
    },
    "material": {
        "law": {"law": "springpot", "order": 0.5, "coefficient": 1.0},
        "displacement": "sin(3*t)",
    },
}


@pytest.mark.parametrize("kind", SHADOWED)
def test_no_parameter_hides_what_formulas_know(kind):
    def read(**parameters):
        problem = {"kind": kind, "final_time": 1.0, **SHADOWED[kind]}
        if parameters:
            problem["parameters"] = parameters
        return fvi.load({"name": "one", "problem": problem, "ladder": {"steps": [4]}}).experiments[
            0
        ]

    problem = read().problem
    known = names_along(problem, problem.ready)
    assert len(known) > 6
    for name in known:
        with pytest.raises(fvi.RequestError) as caught:
            read(**{name: 0.4})
        assert name in str(caught.value)
        # the control
        assert f"{name}_0" in read(**{f"{name}_0": 0.4}).problem.numbers
