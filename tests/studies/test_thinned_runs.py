"""What is stored, and measured, of a run that keeps every n-th point only."""

from dataclasses import replace

import numpy as np
import pytest
from spread import spread
from stored_runs import read_back

from fvi_cli.config import load_config
from fvi_cli.studies.reference import Reference
from fvi_cli.studies.study import execute, judged

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
method: {rk: gauss, degree: 1, start: none}
ladder: {steps: [250]}
store: {every: 100}
report: {norm: NORM}
"""


def runs_of(tmp_path, norm, every=100, steps="[250]", more=""):
    path = tmp_path / "thinned.yaml"
    text = CONFIG.replace("NORM", norm).replace("every: 100", f"every: {every}")
    path.write_text(text.replace("[250]", f"{steps}{more}"))
    return load_config(path).experiments[0].runs()


@spread(norm=["max", "final", "l2"], every=[7, 100, 1000], steps=["[30]", "[250]", "[999]"])
def test_errors_do_not_depend_on_what_is_stored(tmp_path, norm, every, steps):
    whole = [execute(run).error for run in runs_of(tmp_path, norm, 1, steps)]
    thin = [execute(run) for run in runs_of(tmp_path, norm, every, steps)]
    assert [one.error for one in thin] == pytest.approx(whole, rel=1e-12)
    count = thin[0].run.n_steps
    assert read_back(None, thin[0]).trajectory.time.size == 1 + -(-count // every)


JUMPS = """\
name: jumps
problem:
  kind: frame
  storeys: BODIES
  mass: 1.0
  stiffness: 4.0
  ground_acceleration: {pieces: [{until: END, value: 1.0}, {value: -2.0}]}
  final_time: 1.0
method: {rk: gauss, degree: 2}
ladder: {steps: [7]}
report: {norm: l2}
"""


@spread(few=2, bodies=[1, 3], end=[0.07, 0.3, 0.61, 0.95])
def test_l2_is_an_integral_on_unequal_steps_and_a_sum_over_components(tmp_path, bodies, end):
    path = tmp_path / "jumps.yaml"
    path.write_text(JUMPS.replace("BODIES", str(bodies)).replace("END", str(end)))
    (run,) = load_config(path).experiments[0].runs()
    rest = Reference(values=lambda t: np.zeros((t.size, bodies)), error=0.0, source="rest")
    found = execute(run, rest)
    steps = np.diff(found.trajectory.time)
    assert np.ptp(steps) > 1e-3
    squares = (found.trajectory.position[1:] ** 2).sum(axis=1)
    assert found.error == pytest.approx(np.sqrt((steps * squares).sum()), rel=1e-12)
    # the norm of a floor in every component
    constant = replace(found.measured, largest=1.0)
    floor = judged(run, "ok", constant)["floor"]
    assert floor == pytest.approx(np.sqrt(bodies) * constant.floor, rel=1e-12)


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
report: {{norm: {norm}}}
"""
    path = tmp_path / "clocks.yaml"
    path.write_text(text)
    runs = [execute(run) for run in load_config(path).experiments[0].runs()]
    assert [finished.status for finished in runs] == ["ok", "floor", "diverged"]
    unit = np.sqrt(16.0 * second) if norm == "l2" else 1.0
    assert runs[0].floor / unit == pytest.approx(100 * 2.0**-52 * 4, rel=1e-6)
