"""Records of ground motion in AT2, records that end early, and forces from programs."""

from pathlib import Path

import numpy as np

import fvi_cli as fvi

HEADER = """\
PEER NGA STRONG MOTION DATABASE RECORD
Somewhere 01/01/70, STATION 1, 090
ACCELERATION TIME SERIES IN UNITS OF G
NPTS=   101, DT=   .0200 SEC
"""
TIMES = 0.02 * np.arange(101)
VALUES = np.round(np.sin(np.pi * TIMES) * TIMES, 6)


def _write(folder: Path) -> None:
    numbers = [f"{v: .6E}" for v in VALUES]
    rows = ["  ".join(numbers[k : k + 5]) for k in range(0, len(numbers), 5)]
    (folder / "quake.AT2").write_text(HEADER + "\n".join(rows) + "\n")


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


def test_a_record_in_at2_is_that_in_csv(tmp_path):
    _write(tmp_path)
    rows = [
        f"{t!r},{v!r}" for t, v in zip(np.round(TIMES, 2).tolist(), VALUES.tolist(), strict=True)
    ]
    (tmp_path / "quake.csv").write_text("t,a\n" + "\n".join(rows) + "\n")
    (one,) = fvi.run(_load(tmp_path, "{file: quake.AT2, scale: g}"))
    (other,) = fvi.run(_load(tmp_path, "{file: quake.csv, column: a, scale: 9.80665}"))
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
