"""What is stored, and measured, of a run that keeps every n-th point only."""

from dataclasses import replace

import numpy as np
import pytest
from spread import spread
from stored_runs import read_back

from fvi_cli.config import load_config
from fvi_cli.studies import study
from fvi_cli.studies.norms import point_weights
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


def without_room(run, monkeypatch):
    """A run of which nothing is kept but what is stored, as of those of more than 32 MB."""
    with monkeypatch.context() as patch:
        patch.setattr(study, "KEPT_BYTES", 0)
        return execute(run)


@pytest.mark.parametrize("norm", ["max", "final", "l2"])
def test_long_runs_have_the_errors_of_the_kept_points(tmp_path, norm, monkeypatch):
    (run,) = runs_of(tmp_path, norm)
    whole, thin = execute(run), without_room(run, monkeypatch)
    assert whole.trajectory.time.size == 251
    assert np.allclose(thin.trajectory.time, [0.0, 0.4, 0.8, 1.0])
    error = np.abs(thin.trajectory.position[:, 0] - thin.trajectory.time**4)
    weights = np.array([0.202, 0.4, 0.3, 0.102])
    expected = {"max": error.max(), "final": error[-1], "l2": np.sqrt((weights * error**2).sum())}
    assert thin.error == pytest.approx(expected[norm], rel=1e-12)
    # what is stored is thinned once, whoever did it
    first, second = (read_back(None, finished).trajectory for finished in (whole, thin))
    assert first.time.size == second.time.size == 4
    assert np.allclose(first.position, second.position, atol=1e-13)
    again = read_back(None, read_back(None, thin)).trajectory
    assert np.array_equal(again.time, second.time)


@spread(norm=["max", "final", "l2"], every=[7, 100, 1000], steps=["[30]", "[250]", "[999]"])
def test_errors_do_not_depend_on_what_is_stored(tmp_path, norm, every, steps):
    whole = [execute(run).error for run in runs_of(tmp_path, norm, 1, steps)]
    thin = [execute(run) for run in runs_of(tmp_path, norm, every, steps)]
    assert [one.error for one in thin] == pytest.approx(whole, rel=1e-12)
    count = thin[0].run.n_steps
    assert read_back(None, thin[0]).trajectory.time.size == 1 + -(-count // every)


MEMBERS = """\
name: members
problem:
  kind: damped-oscillator
  damping: [{order: 0.5, coefficient: 0.3}]
  stiffness: 1.0
  initial: {position: 1.0}
  final_time: 2.0
method: {rk: gauss, degree: 2, start: none}
ladder: {steps: [120]GRADED}
store: {every: EVERY}
report: {norm: NORM}
SWEEP
"""


@spread(
    norm=["max", "l2"], graded=["", ", grading: 2"], sweep=["", "problem.stiffness: [1.0, 2.0]"]
)
def test_graded_meshes_and_sweeps_too(tmp_path, norm, graded, sweep):
    found = []
    for every in (1, 50):
        text = MEMBERS.replace("NORM", norm).replace("EVERY", str(every))
        text = text.replace("GRADED", graded)
        path = tmp_path / "members.yaml"
        path.write_text(text.replace("SWEEP", f"sweep: {{{sweep}}}" if sweep else ""))
        found.append([execute(run).error for run in load_config(path).experiments[0].runs()])
    assert found[1] == pytest.approx(found[0], rel=1e-12)
    assert min(found[0]) > 0


def test_weights_of_kept_points_are_the_integral_of_all(tmp_path, monkeypatch):
    """The control: to their own accuracy; with weights of every h each it was 15 times as large."""
    (run,) = runs_of(tmp_path, "l2", 5)
    whole, thin = execute(run).error, without_room(run, monkeypatch).error
    assert thin == pytest.approx(whole, rel=0.02)
    time = np.linspace(0.0, 1.0, 31)
    kept = time[[0, 30]]
    assert point_weights(kept, 1 / 30, 1000).sum() == pytest.approx(1 + 1 / 30)
    assert point_weights(time, 1 / 30, 1) == pytest.approx(1 / 30)


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
