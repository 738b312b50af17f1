"""A given solution must begin with the initial data."""

import numpy as np
import pytest
from command_line import fvi as command

from fvi_cli.scenes.exact_check import objection
from fvi_cli.scenes.registry import build_problem


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("problem.initial.position=5", "is 0 at t = 0, but initial.position is 5"),
        ("problem.initial.velocity=1.0", "has the derivative 1.2 "),
    ],
)
def test_a_changed_problem_with_the_old_solution_is_refused_at_its_line(change, told):
    result = command("check", "damped-oscillator", "--set", change, code=2)
    assert f":18:10: problem.exact: {told}" in result.stderr
    command("check", "damped-oscillator", "--set", change, "--set", "problem.exact=auto", code=0)


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


def test_a_motion_that_is_zero():
    scene = build_problem({"kind": "damped-oscillator", "final_time": 8.0}).scene
    assert objection(lambda t: np.zeros((t.size, 1)), scene) == ""
