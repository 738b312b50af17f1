"""The solution's expansion at the start, against its Laplace transform."""

import math

import numpy as np
import pytest

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansions.expansion import solution_expansion

STIFFNESS, DAMPING = 2.0, 0.7


def oscillator(order: float, coefficient: float = DAMPING) -> Scene:
    return Scene(
        inertia=Inertia(mass=np.eye(1)),
        initial_position=np.ones(1),
        initial_velocity=np.zeros(1),
        final_time=8.0,
        potential=QuadraticPotential(stiffness=STIFFNESS * np.eye(1)),
        damping=(FractionalDamping(order=order, coefficient=coefficient * np.eye(1)),),
    )


def transformed_back(order: float, cutoff: float) -> dict[float, float]:
    r"""Coefficients by powers, from 1/s - k/s sum (-1)^n (mu s^gamma + k)^n / s^(2 n + 2)."""
    found = {0.0: 1.0}
    for n in range(200):
        for j in range(n + 1):
            power = 2 * n + 2 - j * order
            if power >= cutoff - 1e-9:
                continue
            term = math.comb(n, j) * DAMPING**j * STIFFNESS ** (n - j) / math.gamma(power + 1)
            key = round(power, 6)
            found[key] = found.get(key, 0.0) - STIFFNESS * (-1) ** n * term
    return {power: found[power] for power in sorted(found)}


@pytest.mark.parametrize("order", [0.37, 0.5, 1.2, 1.5, 1.9])
def test_coefficients_are_those_of_the_laplace_transform(order):
    """Orders whose powers meet among them: 1.5 has t**4 in two ways."""
    expected = transformed_back(order, 8.0)
    found = solution_expansion(oscillator(order), 8.0)
    np.testing.assert_allclose(found.exponents, list(expected), atol=1e-6)
    coefficients = found.coefficients[:, 0]
    np.testing.assert_allclose(coefficients, list(expected.values()), rtol=1e-11)
    # control: a damping that is 1e-9 stronger shows
    other = solution_expansion(oscillator(order, DAMPING * (1 + 1e-9)), 8.0).coefficients[:, 0]
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(other, list(expected.values()), rtol=1e-11)
