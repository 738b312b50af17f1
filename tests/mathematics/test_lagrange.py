"""The Lagrange basis on [0, 1]."""

import mpmath as mp
import numpy as np
import pytest

from fvi_cli.mathematics.lagrange import lobatto_basis
from fvi_cli.mathematics.quadrature import gauss_rule

DEGREES = range(1, 21)


@pytest.mark.parametrize("degree", DEGREES)
def test_polynomials_are_reproduced_up_to_the_degree_and_no_further(degree):
    basis = lobatto_basis(degree)
    assert np.array_equal(basis.values(basis.control_points), np.eye(degree + 1))
    points = gauss_rule(7).nodes
    for power in range(degree + 1):
        nodal = basis.control_points**power
        np.testing.assert_allclose(nodal @ basis.values(points), points**power, atol=2e-15)
        slope = power * points ** max(power - 1, 0)
        np.testing.assert_allclose(
            nodal @ basis.derivatives(points), slope, atol=2e-15 * degree**2 + 1e-15
        )
    if degree <= 8:
        beyond = basis.control_points ** (degree + 1) @ basis.values(points)
        assert np.abs(beyond - points ** (degree + 1)).max() > 1e-8


@pytest.mark.parametrize("degree", [1, 2, 3, 7, 13, 20])
def test_values_and_derivatives_against_products_in_fifty_digits(degree):
    basis = lobatto_basis(degree)
    points = np.concatenate(
        [np.linspace(0, 1, 8), basis.control_points[:3], [1e-9, 1 - 1e-12, 0.5 + 1e-15]]
    )
    values, derivatives = basis.values(points), basis.derivatives(points)
    scale = np.abs(derivatives).max()
    with mp.workdps(50):
        control = [mp.mpf(float(d)) for d in basis.control_points]
        for j, own in enumerate(control):
            others = [d for m, d in enumerate(control) if m != j]
            for i, point in enumerate(points):
                factors = [(mp.mpf(float(point)) - d) / (own - d) for d in others]
                slope = mp.fsum(
                    mp.fprod(factors[:k] + factors[k + 1 :]) / (own - d)
                    for k, d in enumerate(others)
                )
                assert abs(values[j, i] - mp.fprod(factors)) < 1e-15
                assert abs(derivatives[j, i] - slope) < 2e-15 * scale
