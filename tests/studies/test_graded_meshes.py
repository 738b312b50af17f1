"""Graded meshes and graded starts from configuration to file, and runs without a reference."""

import math
from typing import Any

import numpy as np
import pytest
from oracles.linear_response import match_scene

import fvi_cli as fvi
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.scenes.registry import build_problem
from fvi_cli.storage.identity import identity_of
from fvi_cli.studies import reference
from fvi_cli.studies.order import fit_slope
from fvi_cli.studies.study import execute


def free(order: float, **changes: Any) -> dict[str, Any]:
    """An oscillator that starts with a velocity, so that its start is singular."""
    return {
        "kind": "damped-oscillator",
        "stiffness": 2.0,
        "damping": [{"order": order, "coefficient": 0.7}],
        "initial": {"position": 1.0, "velocity": 0.5},
        "final_time": 8.0,
        **changes,
    }


def experiment(ladder: dict[str, Any], problem: dict[str, Any], **method: Any) -> fvi.Experiment:
    source = {"name": "mesh", "problem": problem, "ladder": ladder}
    if method:
        source["method"] = method
    (found,) = fvi.load(source).experiments
    return found


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("order", "degree", "grading", "expected", "steps"),
    [
        (0.5, 3, 1.0, 2.5, [64, 128, 256]),
        (0.5, 4, 1.5, 3.75, [64, 128, 256]),
        (0.8, 4, 1.5, 3.3, [64, 128, 256]),
        (1.5, 4, 2.0, 5.0, [32, 64, 128]),
        (1.8, 4, 2.0, 4.4, [32, 64, 128]),
        (0.5, 2, 2.0, 4.0, [64, 128, 256]),
        (1.3, 3, 3.0, 6.0, [32, 64, 128]),
    ],
)
def test_a_graded_mesh_multiplies_the_order_of_a_singular_start(
    order, degree, grading, expected, steps
):
    ladder = {"steps": steps, "grading": grading}
    own = experiment(ladder, free(order), rk="gauss", degree=degree, start="none")
    runs = list(map(execute, own.runs()))
    numbers, errors = zip(*((one.run.n_steps, one.error) for one in runs), strict=True)
    slope = fit_slope(numbers, errors)
    squares = np.polyfit(np.log10(numbers), np.log10(errors), 1, full=True)[1]
    assert np.sqrt(squares.sum() / len(runs)) < 0.05
    stated = 2.0 * degree if expected == 2.0 * degree else math.nan
    assert [one.order_smooth for one in runs] == pytest.approx([stated] * len(runs), nan_ok=True)
    assert slope == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("order", [0.4, 1.6])
def test_the_adaptive_reference_knows_its_error(order):
    problem = build_problem(free(order))
    exact = match_scene(problem.scene).position
    found = reference.find_reference(problem)
    times = graded_mesh(8.0, 300, 2.0)
    at = np.array([one.end for one in times.stretches])
    true = float(np.abs(found.values(at) - exact(at)).max())
    assert found.error < 1e-12
    assert true < max(3.0 * found.error, 1e-13)
    assert "adaptive steps" in found.source


PULSE = {
    "kind": "pendulum",
    "damping": [{"order": 0.5, "coefficient": 0.7}],
    "forcing": {"pieces": [{"until": 1.0, "value": 1}, {"value": 0}]},
    "initial": {"position": 1.0},
    "final_time": 7.3,
}


def test_break_points_are_points_of_a_graded_mesh():
    own = experiment({"steps": [16, 32, 64], "grading": 2.5}, PULSE, rk="gauss", degree=2)
    runs = list(map(execute, own.runs()))
    for one in runs:
        assert 1.0 in one.trajectory.time
        assert one.trajectory.time.size == one.run.n_steps + 1
    slope = fit_slope([one.run.n_steps for one in runs], [one.error for one in runs])
    assert slope == pytest.approx(4.0, abs=0.15)
    assert runs[0].order_smooth == 4.0


def test_the_mesh_is_part_of_a_run_and_is_stored(tmp_path):
    source = {
        "name": "mesh",
        "problem": free(0.5),
        "ladder": {"steps": [16], "grading": 2.0},
        "store": {"every": 3},
    }
    fvi.run(source, output=tmp_path)
    (outcome,) = fvi.recall(tmp_path / "mesh.h5")
    (stored,) = outcome.finished
    mesh = 8.0 * (np.arange(17) / 16) ** 2
    assert np.array_equal(stored.trajectory.time, mesh[[0, 3, 6, 9, 12, 15, 16]])
    assert stored.trajectory.step_size == 0.5
    runs = []
    for grading in (2.0, 2.5, 1.0):
        ladder = {"steps": [16], "grading": grading}
        own = experiment(ladder, free(0.5), rk="gauss", start="none")
        runs += own.runs()
    plain = experiment({"steps": [16]}, free(0.5), rk="gauss", start="none").runs()[0]
    assert len({identity_of(run) for run in runs}) == 3
    assert identity_of(plain) == identity_of(runs[-1])


def test_members_of_a_sweep_have_the_mesh_and_the_start_they_ask_for(tmp_path):
    for ladder, start in (({"steps": 64, "grading": 2.0}, "none"), ({"steps": 64}, "graded")):
        source = {
            "name": f"sweep-{start}",
            "problem": free(0.5),
            "method": {"rk": "gauss", "degree": 2, "start": start},
            "ladder": ladder,
            "sweep": {"problem.stiffness": [1.0, 2.0, 3.0]},
        }
        (outcome,) = fvi.run(source, output=tmp_path)
        middle = outcome.finished[1]
        alone = integrate(middle.run.problem.scene, middle.run.method, middle.run.steps)
        # computed as a batch
        assert np.abs(middle.trajectory.position - alone.position).max() < 1e-14
        (again,) = fvi.recall(tmp_path / f"sweep-{start}.h5")
        assert np.array_equal(again.finished[1].trajectory.time, alone.time)
        assert again.finished[1].error == middle.error


def test_no_reference_is_computed_where_none_is_wanted(monkeypatch, tmp_path):
    calls, own = [], reference.solve_by_two_runs
    monkeypatch.setattr(reference, "solve_by_two_runs", lambda *a: calls.append(a) or own(*a))
    for exact, computed in (("none", False), ("auto", True)):
        source = {"name": exact, "problem": {**PULSE, "exact": exact}, "ladder": {"steps": [73]}}
        (outcome,) = fvi.run(source, output=tmp_path)
        (run,) = outcome.finished
        assert bool(calls) == computed
        assert math.isnan(run.error) != computed
        assert run.status == "ok"
        assert (run.reference == "none, as asked for") != computed
        assert math.isnan(fvi.order_tables([outcome])[0].cases[0].rows[0].error) != computed
        names = {one.partition("-")[2] for one in fvi.figures([outcome])}
        assert names == {"trajectory", "energy"}
