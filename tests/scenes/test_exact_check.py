"""A given solution is believed only where it solves the equation from the initial data."""

import os
import random

import numpy as np
import pytest
from command_line import fvi as command
from spread import SEED, spread

from fvi_cli.mathematics.expressions import Expression
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
    start = problem.scene.initial_position

    def in_excess(t: np.ndarray) -> np.ndarray:
        """Off by a part in 10,000 that begins like t^3: the initial data are right."""
        return exact(t) + 1e-4 * t[:, None] ** 3 / 512 * np.abs(exact(np.array([2.0]))).max()

    assert "does not solve the equation" in objection(in_excess, problem.scene)
    assert "at t = 0, but initial.position" in objection(lambda t: exact(t) + 1e-3, problem.scene)
    assert "derivative" in objection(
        lambda t: exact(t) + 0.05 * t[:, None] * np.ones_like(start), problem.scene
    )


def test_a_nonlinear_scene():
    """The pendulum from rest at the bottom with rate 2, without damping: 2 asin(tanh t)."""
    pendulum = {
        "kind": "pendulum",
        "initial": {"position": 0.0, "velocity": 2.0},
        "final_time": 12.0,
    }
    scene = build_problem(pendulum).scene
    solution = lambda t: 2 * np.arcsin(np.tanh(t))[:, None]  # noqa: E731
    assert objection(solution, scene) == ""
    slower = lambda t: 2 * np.arcsin(np.tanh(t - 1e-4 * t**3 / (1 + t**3)))[:, None]  # noqa: E731
    assert "does not solve" in objection(slower, scene)


def test_a_motion_that_is_zero():
    assert objection(lambda t: np.zeros((t.size, 1)), problem_of().scene) == ""
    assert "derivative 0 at t = 0, but initial.velocity is 0.5" in objection(
        lambda t: np.zeros((t.size, 1)), problem_of(initial={"velocity": 0.5}).scene
    )


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("problem.damping.0.order=0.5", "does not solve the equation"),
        ("problem.damping.0.coefficient=0.2001", "does not solve the equation"),
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


SIN = {"forcing": "sin(t)", "initial": {"position": 0.0, "velocity": 0.0}}


@pytest.mark.parametrize(
    "wrong",
    ["0", "t**2*sin(t)*0", "t**3/6", "sin(t) - t", "t - t"],
)
def test_a_wrong_solution_that_begins_like_the_right_one(wrong):
    """From rest everything begins with 0, and so does a formula that is 0 for ever."""
    scene = problem_of(**SIN).scene
    formula = Expression.parse(wrong, ("t",))

    def given(t: np.ndarray) -> np.ndarray:
        return np.broadcast_to(formula.evaluate({"t": t}), t.shape)[:, None]

    assert "does not solve the equation" in objection(given, scene)


@spread(
    time=[1e-6, 1.0, 1e6],
    length=[3.0, 40.0, 900.0],
    kind=["phase", "late", "bump", "amplitude", "slow"],
)
def test_wrong_solutions_of_many_kinds_over_long_times(time, length, kind):
    r"""x'' + w^2 x = w^2 from rest: 1 - cos(w t); its double integral grows like t^2."""
    w = 1.0 / time
    scene = build_problem(
        {
            "kind": "damped-oscillator",
            "stiffness": w * w,
            "forcing": repr(w * w),
            "final_time": length * time,
        }
    ).scene
    end = scene.final_time

    def right(t: np.ndarray) -> np.ndarray:
        return 1 - np.cos(w * t)[:, None]

    def excess(t: np.ndarray) -> np.ndarray:
        tau = (t / end)[:, None]
        rise = np.where(tau > 0.5, (2 * tau - 1) ** 4, 0.0)
        return {
            "phase": 1e-2 * tau * np.sin(w * t)[:, None] * tau**2,
            "late": 1e-2 * rise,
            "bump": 1e-2 * np.exp(-(((tau - 0.55) / 0.05) ** 2)),
            "amplitude": -1e-2 * tau**4 * np.cos(w * t)[:, None],
            "slow": 1e-2 * tau**3,
        }[kind]

    assert objection(right, scene) == ""
    assert "does not solve" in objection(lambda t: right(t) + excess(t), scene)


def test_right_solutions_over_long_times_are_not_refused():
    """Both rules may miss thousands of turns alike at one place, and say so at others."""
    for end in np.geomspace(1e3, 4e4, 50):
        keys = {"kind": "damped-oscillator", "forcing": "1.0", "final_time": float(end)}
        assert objection(lambda t: 1 - np.cos(t)[:, None], build_problem(keys).scene) == ""


WRONG = {
    "amplitude": lambda t, w, end: 1.01 * (1 - np.cos(w * t)),
    "frequency": lambda t, w, end: 1 - np.cos(1.01 * w * t),
    "phase": lambda t, w, end: 1 - np.cos(w * t * (1 - 1e-2 * t / end)),
}


@spread(few=3, place=range(10), coefficient=[0.0, 0.02])
def test_many_periods_of_a_right_solution_and_of_wrong_ones(place, coefficient):
    """Up to ten million radians, over all scales: x = a (1 - cos w t), and what is 1 % off."""
    chance = random.Random(f"{os.environ[SEED]} periods {place} {coefficient}")
    for decade in range(8):
        radians, end = 10 ** chance.uniform(decade - 1, decade), 10 ** chance.uniform(-6, 6)
        size = chance.choice([-1, 1]) * 10 ** chance.uniform(-6, 6)
        w = radians / end
        damped = size * coefficient * w * w
        scene = build_problem(
            {
                "kind": "damped-oscillator",
                "stiffness": w * w,
                "damping": [{"order": 1.0, "coefficient": coefficient * w}],
                "forcing": f"{size * w * w!r} + {damped!r}*sin({w!r}*t)",
                "final_time": end,
            }
        ).scene
        right = lambda t, w=w, size=size: size * (1 - np.cos(w * t))[:, None]  # noqa: E731
        assert objection(right, scene) == "", (radians, end, size)
        if radians < 1:
            continue
        name = chance.choice(list(WRONG))
        wrong = lambda t, w=w, size=size, end=end, n=name: (  # noqa: E731
            size * WRONG[n](t, w, end)[:, None]
        )
        assert "does not solve" in objection(wrong, scene), (name, radians, end, size)


@pytest.mark.parametrize("place", range(10))
def test_a_rate_that_is_off_by_a_hundredth_behind_many_periods(place):
    chance = random.Random(f"{os.environ[SEED]} rates {place}")
    end = 10 ** chance.uniform(-3, 3)
    w = 10 ** chance.uniform(0, 5) / end
    keys = {"kind": "damped-oscillator", "stiffness": w * w, "final_time": end}
    right = lambda t: np.sin(w * t)[:, None]  # noqa: E731
    for factor in (1.0, 1.01):
        start = {"position": 0.0, "velocity": factor * w}
        found = objection(right, build_problem({**keys, "initial": start}).scene)
        assert ("has the derivative" in found) == (factor != 1.0)
