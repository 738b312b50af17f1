"""What is stored, and measured, of a run that keeps every n-th point only."""

import numpy as np
import pytest
from spread import spread

from fvi_cli.config import load_config
from fvi_cli.storage.records import finished_of, record_of
from fvi_cli.studies.study import execute

CONFIG = """\
name: thinned
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.3}]
  stiffness: 1.0
  forcing: 12*t**2 + 0.3*24/gamma(4.5)*t**3.5 + t**4
  initial: {position: 0.0, velocity: 0.0}
  final_time: 1.0
  exact: t**4
method: {rk: gauss, degree: 1, start: none, history: [auto, exponentials]}
ladder: {steps: [250]}
store: {every: 100}
report: {norm: NORM}
"""


@pytest.mark.parametrize("norm", ["max", "final", "l2"])
def test_errors_are_those_of_the_kept_points(tmp_path, norm):
    path = tmp_path / "thinned.yaml"
    path.write_text(CONFIG.replace("NORM", norm))
    experiment = load_config(path).experiments[0]
    whole, thin = (execute(run) for run in experiment.runs())
    assert whole.trajectory.time.size == 251
    assert np.allclose(thin.trajectory.time, [0.0, 0.4, 0.8, 1.0])
    error = np.abs(thin.trajectory.position[:, 0] - thin.trajectory.time**4)
    expected = {"max": error.max(), "final": error[-1], "l2": np.sqrt(0.4 * (error**2).sum())}
    assert thin.error == pytest.approx(expected[norm], rel=1e-12)
    assert any("every 100th" in remark for remark in thin.trajectory.remarks)
    assert not any("every 100th" in remark for remark in whole.trajectory.remarks)
    # what is stored is thinned once, whoever did it
    records = [record_of(finished) for finished in (whole, thin)]
    for record in records:
        assert record.datasets["time"].size == 4
    assert np.allclose(records[0].datasets["position"], records[1].datasets["position"], atol=1e-13)
    assert thin.run.method.case == "gauss-s1-none-exponentials"
    again = record_of(finished_of(records[1], thin.run))
    assert np.array_equal(again.datasets["time"], records[1].datasets["time"])


@spread(norm=["max", "final", "l2"], second=[1.0, 1e8, 1e-12])
def test_status_and_floor_do_not_depend_on_the_unit_of_time(tmp_path, norm, second):
    """One sound run, one at round-off, one that is ten times off, by other clocks."""
    text = f"""\
name: clocks
problem:
  kind: bagley-torvik
  damping: [{{order: 1.0, coefficient: {0.2 / second!r}}}]
  stiffness: {second**-2!r}
  initial: {{position: 1.0, velocity: 0.0}}
  final_time: {16.0 * second!r}
method: [{{rk: gauss, degree: 2}}, {{rk: gauss, degree: 9}}, {{baseline: explicit-euler}}]
ladder: {{steps: [16]}}
allow_unstable: true
report: {{norm: {norm}}}
"""
    path = tmp_path / "clocks.yaml"
    path.write_text(text)
    runs = [execute(run) for run in load_config(path).experiments[0].runs()]
    assert [finished.status for finished in runs] == ["ok", "floor", "diverged"]
    unit = np.sqrt(16.0 * second) if norm == "l2" else 1.0
    assert runs[0].floor / unit == pytest.approx(100 * 2.0**-52 * 4, rel=1e-6)
