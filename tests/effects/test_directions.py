"""Linear combinations of coordinates on which a force acts."""

import numpy as np
import pytest

from fvi_cli.effects.directions import Directions


def test_a_damper_between_two_bodies():
    directions = Directions.from_text(["x2 - x1"], ("x1", "x2", "x3"))
    assert directions.rows.tolist() == [[-1.0, 1.0, 0.0]]
    assert directions.factored(0.5).form.tolist() == [[0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0, 0, 0]]


def test_combinations_are_read_exactly():
    directions = Directions.from_text(
        ["(a - 2*b)/4 + 3*(b + a)", "-a", "+b**1 - (1 - 1)"], ("a", "b")
    )
    assert directions.rows.tolist() == [[3.25, 2.5], [-1.0, 0.0], [0.0, 1.0]]


def test_a_matrix_couples_the_directions():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(2, 4))
    inner = np.array([[2.0, -1.0], [-1.0, 3.0]])
    matrix = Directions(rows=rows).factored(inner).form
    v = rng.normal(size=4)
    # the power of the force is that of the forces along the directions
    assert v @ matrix @ v == pytest.approx((rows @ v) @ inner @ (rows @ v), rel=1e-14)
    assert np.array_equal(matrix, matrix.T)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x1*x2", "acts_on.0: not linear"), ("x1**2", "acts_on.0: not linear"),
        ("2**x1", "acts_on.0: not linear"), ("1/x1", "acts_on.0: not linear"),
        ("sin(x1)", "acts_on.0: not linear: a function"), ("x1/x2", "acts_on.0: not linear"),
        ("x1*(x2 - x2)", "contains no coordinate, or"),
        ("x1 + 1", "holds the constant 1"), ("x1 - x1", "contains no coordinate, or"),
        ("3", "contains no coordinate, or"), ("x3", "unknown name 'x3'"), ("x1 +", "complete"),
    ],
)  # fmt: skip
def test_what_is_not_linear_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        Directions.from_text([text], ("x1", "x2"))


def test_a_matrix_of_the_wrong_size_is_refused():
    directions = Directions.from_text(["x1"], ("x1", "x2"))
    with pytest.raises(ValueError, match="size 2 for 1 entries"):
        directions.factored(np.eye(2))
