"""A given solution must begin with the initial data."""

import pytest
from command_line import fvi as command


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("problem.initial.position=5", "is [0.0] at t = 0, but initial.position is [5.0]"),
    ],
)
def test_a_changed_problem_with_the_old_solution_is_refused_at_its_line(change, told):
    result = command("check", "damped-oscillator", "--set", change, code=2)
    assert f":18:10: problem.exact: {told}" in result.stderr
    command("check", "damped-oscillator", "--set", change, "--set", "problem.exact=auto", code=0)
