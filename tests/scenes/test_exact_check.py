"""Closed forms solve their equations; a given solution must begin with the initial data."""

import numpy as np
import pytest
from command_line import fvi as command
from oracles.residuals import residual_of

from fvi_cli.scenes.exact_check import objection
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem


def problem_of(**keys: object) -> Problem:
    return build_problem({"kind": "damped-oscillator", "final_time": 8.0, **keys})


FREE = {"position": 1.0, "velocity": 0.5}
JUMP = {"pieces": [{"until": 1.0, "value": "8"}, {"value": "0"}]}
SOLVED = {
    "undamped": problem_of(initial=FREE),
    "viscous": problem_of(initial=FREE, damping=[{"order": 1.0, "coefficient": 0.7}]),
    "one half": problem_of(initial=FREE, damping=[{"order": 0.5, "coefficient": 0.7}]),
    "three halves": problem_of(initial=FREE, damping=[{"order": 1.5, "coefficient": 0.7}]),
    "any order": problem_of(initial=FREE, damping=[{"order": 1.9, "coefficient": 0.7}]),
    "stepped": problem_of(
        kind="bagley-torvik", forcing=JUMP, damping=[{"order": 1.5, "coefficient": 0.5}]
    ),
    "riemann-liouville": problem_of(
        initial=FREE, derivative="riemann-liouville", damping=[{"order": 0.5, "coefficient": 0.7}]
    ),
    "two masses": problem_of(
        kind="bagley-torvik",
        mass=[[1, 0], [0, 1]],
        stiffness=[[2, -1], [-1, 2]],
        damping=[{"order": 0.5, "coefficient": [[2, -1], [-1, 2]]}],
        initial={"position": [1, 0], "velocity": 0},
    ),
}


@pytest.mark.few(2)
@pytest.mark.parametrize("name", SOLVED)
def test_closed_forms_solve_their_equations_and_others_do_not(name):
    problem = SOLVED[name]
    exact = problem.exact
    assert exact is not None
    assert objection(exact, problem.scene) == ""
    assert residual_of(exact, problem.scene) < 1e-6
    start = problem.scene.initial_position

    def in_excess(t: np.ndarray) -> np.ndarray:
        """Off by a part in 10,000 that begins like t^3: the initial data are right."""
        return exact(t) + 1e-4 * t[:, None] ** 3 / 512 * np.abs(exact(np.array([2.0]))).max()

    assert residual_of(in_excess, problem.scene) > 1e-6
    assert "at t = 0, but initial.position" in objection(lambda t: exact(t) + 1e-3, problem.scene)
    assert "derivative" in objection(
        lambda t: exact(t) + 0.05 * t[:, None] * np.ones_like(start), problem.scene
    )


def test_a_motion_that_is_zero():
    assert objection(lambda t: np.zeros((t.size, 1)), problem_of().scene) == ""
    assert "derivative 0 at t = 0, but initial.velocity is 0.5" in objection(
        lambda t: np.zeros((t.size, 1)), problem_of(initial={"velocity": 0.5}).scene
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("problem.initial.position=5", "is 0 at t = 0, but initial.position is 5"),
        ("problem.initial.velocity=1.0", "has the derivative 1.2 "),
    ],
)
def test_a_changed_problem_with_the_old_solution_is_refused_at_its_line(change, told):
    for name in ("check", "convergence"):
        result = command(name, "damped-oscillator", "--set", change, code=2)
        assert f":18:10: problem.exact: {told}" in result.stderr
    found = ["check", "damped-oscillator", "--set", change, "--set", "problem.exact=auto"]
    command(*found, code=0)


@pytest.mark.parametrize("place", range(7))
def test_a_rate_that_is_off_by_a_hundredth_behind_many_periods(place):
    end = 10.0 ** (place - 3)
    w = 10.0 ** (place % 5 + 0.5) / end
    keys = {"kind": "damped-oscillator", "stiffness": w * w, "final_time": end}
    right = lambda t: np.sin(w * t)[:, None]  # noqa: E731
    for factor in (1.0, 1.01):
        start = {"position": 0.0, "velocity": factor * w}
        found = objection(right, build_problem({**keys, "initial": start}).scene)
        assert ("has the derivative" in found) == (factor != 1.0)
