"""Effects as values."""

import numpy as np
import pytest

from fvi_cli.effects.potential import ExpressionPotential
from fvi_cli.mathematics.expressions import Expression


def test_expression_potentials_have_its_derivatives():
    potential = ExpressionPotential(
        coordinates=("x", "y"),
        parameters={"k": 1.7},
        energy_expression=Expression.parse("k*x**2*y + cos(y)", variables=("x", "y", "k")),
    )
    points = np.random.default_rng(1).normal(size=(5, 2))
    eps = 1e-6
    for axis in range(2):
        move = eps * np.eye(2)[axis]
        slope = (potential.energy(points + move) - potential.energy(points - move)) / (2 * eps)
        assert slope == pytest.approx(potential.gradient(points)[:, axis], abs=1e-8)
        change = (potential.gradient(points + move) - potential.gradient(points - move)) / (2 * eps)
        assert change == pytest.approx(potential.hessian(points)[:, :, axis], abs=1e-8)
