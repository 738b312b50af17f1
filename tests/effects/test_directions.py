"""Linear combinations of coordinates on which a force acts."""

import numpy as np
import pytest

from fvi_cli.effects.directions import read_directions
from fvi_cli.effects.matrices import Factored


def test_combinations_are_read_exactly():
    rows = read_directions(["(a - 2*b)/4 + 3*(b + a)", "-a", "+b**1 - (1 - 1)"], ("a", "b"))
    assert rows.tolist() == [[3.25, 2.5], [-1.0, 0.0], [0.0, 1.0]]


def test_a_matrix_couples_the_directions():
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(2, 4))
    inner = np.array([[2.0, -1.0], [-1.0, 3.0]])
    matrix = Factored(rows=rows, inner=inner).form
    v = rng.normal(size=4)
    # the power of the force is that of the forces along the directions
    assert v @ matrix @ v == pytest.approx((rows @ v) @ inner @ (rows @ v), rel=1e-14)
    assert np.array_equal(matrix, matrix.T)
