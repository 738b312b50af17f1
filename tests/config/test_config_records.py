"""Records of ground motion in AT2, records that end early, and forces from programs."""

from pathlib import Path

import numpy as np
import pytest

import fvi_cli as fvi
from fvi_cli.scenes.registry import build_problem
from fvi_cli.scenes.structures import frame

HEADER = """\
PEER NGA STRONG MOTION DATABASE RECORD
Somewhere 01/01/70, STATION 1, 090
ACCELERATION TIME SERIES IN UNITS OF G
"""
TIMES = 0.02 * np.arange(101)
VALUES = np.round(np.sin(np.pi * TIMES) * TIMES, 6)


def _write(
    folder: Path, line: str = "NPTS=   101, DT=   .0200 SEC", values: object = VALUES
) -> None:
    numbers = [f"{v: .6E}" for v in values]
    rows = ["  ".join(numbers[k : k + 5]) for k in range(0, len(numbers), 5)]
    (folder / "quake.AT2").write_text(HEADER + line + "\n" + "\n".join(rows) + "\n")


def _load(folder: Path, record: str, *overrides: str) -> fvi.LoadedConfig:
    text = f"""\
name: shaken
problem:
  kind: frame
  storeys: 2
  stiffness: 40.0
  dampers: [{{order: 0.6, coefficient: 0.5}}]
  ground_acceleration: {record}
  final_time: 2.0
  exact: none
method: {{rk: gauss, degree: 3, start: graded}}
ladder: {{steps: [100]}}
"""
    (folder / "shaken.yaml").write_text(text)
    return fvi.load(folder / "shaken.yaml", overrides=overrides)


@pytest.mark.parametrize("line", ["NPTS=   101, DT=   .0200 SEC", "  101    0.0200   NPTS, DT"])
def test_a_record_in_at2_is_that_in_csv(tmp_path, line):
    _write(tmp_path, line)
    rows = [
        f"{t!r},{v!r}" for t, v in zip(np.round(TIMES, 2).tolist(), VALUES.tolist(), strict=True)
    ]
    (tmp_path / "quake.csv").write_text("t,a\n" + "\n".join(rows) + "\n")
    (one,) = fvi.run(_load(tmp_path, "{file: quake.AT2, scale: 9.81}"))
    (other,) = fvi.run(_load(tmp_path, "{file: quake.csv, column: a, scale: 9.81}"))
    first, second = (o.finished[0].trajectory.position for o in (one, other))
    assert np.array_equal(first, second)
    assert np.abs(first).max() > 1e-3


def test_behind_a_record_there_is_nothing(tmp_path):
    _write(tmp_path)
    config = _load(tmp_path, "{file: quake.AT2, beyond: zero}", "problem.final_time=3.1")
    (experiment,) = config.experiments
    scene = experiment.problem.scene
    assert scene.break_points == (2.0,)
    force = scene.forcing(np.array([1.99, 2.0, 2.001, 3.0]))
    assert np.abs(force[2:]).max() == 0.0
    assert np.abs(force[0]).max() > 0.01
    (outcome,) = fvi.run(config)
    assert outcome.finished[0].status == "ok"
    assert 2.0 in outcome.finished[0].trajectory.time


def _frame(ground: fvi.Forcing, final_time: float = 2.0) -> fvi.Scene:
    return frame(
        storeys=2,
        stiffness=40.0,
        dampers=[fvi.FractionalDamping(order=0.6, coefficient=0.5)],
        ground_acceleration=ground,
        final_time=final_time,
    )


def test_forces_from_functions_are_those_from_expressions():
    given = _frame(fvi.Forcing.from_functions(lambda t: np.sin(3 * t) * t))
    written = _frame(fvi.Forcing.from_text("sin(3*t)*t"))
    runs = [fvi.integrate(one, "gauss4-graded", 40) for one in (given, written)]
    # nothing is known of how a function begins: its steps are graded
    assert np.abs(runs[0].position - runs[1].position).max() < 1e-8
    adaptive = fvi.integrate(given, "gauss6", fvi.AdaptiveSteps(tolerance=1e-8))
    assert np.abs(adaptive.position[-1] - runs[1].position[-1]).max() < 1e-6


def test_a_function_with_a_jump_has_a_break_point():
    def jump(t: np.ndarray) -> np.ndarray:
        return np.where(t <= 0.7, 1.0, -1.0)

    scene = _frame(fvi.Forcing.from_functions(jump, break_points=[0.7]))
    coarse = fvi.integrate(scene, "gauss4-graded", 40)
    pieces = {"pieces": [{"until": 0.7, "value": 1.0}, {"value": -1.0}]}
    problem = {
        "kind": "frame",
        "storeys": 2,
        "stiffness": 40.0,
        "dampers": [{"order": 0.6, "coefficient": 0.5}],
        "ground_acceleration": pieces,
        "final_time": 2.0,
    }
    written = build_problem(problem)
    fine = fvi.integrate(written.scene, "gauss4-graded", 40)
    assert np.abs(coarse.position - fine.position).max() < 1e-8
    named = {**problem, "ground_acceleration": "sign(0.7 - t)", "break_points": [0.7]}
    same = fvi.integrate(build_problem(named).scene, "gauss4-graded", 40)
    assert np.abs(same.position - fine.position).max() < 1e-13
    # the control: without them the mesh misses the jump
    del named["break_points"]
    missed = fvi.integrate(build_problem(named).scene, "gauss4-graded", 41)
    assert np.abs(missed.position[-1] - fine.position[-1]).max() > 1e-6


def test_forces_from_arrays():
    given = fvi.Forcing.from_samples(TIMES, VALUES, beyond="zero")
    scene = _frame(given, final_time=3.0)
    assert scene.break_points == (2.0,)
    run = fvi.integrate(scene, "gauss4-graded", 90)
    assert run.status == "ok"
    with pytest.raises(ValueError, match="it must give a number for each"):
        fvi.integrate(_frame(fvi.Forcing.from_functions(lambda t: "no")), "gauss4-graded", 10)
