"""The solution's expansion at the start, against its Laplace transform."""

import math

import numpy as np
import pytest
from letters import spring

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.starts.expansion import solution_expansion
from fvi_cli.mathematics.series.power_series import SeriesError
from fvi_cli.scenes.lagrangian import lagrangian_scene

STIFFNESS, DAMPING = 2.0, 0.7


def oscillator(order: float, coefficient: float = DAMPING) -> Scene:
    return spring((order, coefficient), T=8.0, k=STIFFNESS, x=1.0)


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


@pytest.mark.parametrize("rate", [2.0, 2.0 * (1 + 1e-9)])
def test_a_mass_that_varies_has_the_coefficients_of_the_free_motion(rate):
    """L = exp(2 x) v^2/2 is (d exp(x)/dt)^2/2: x = log(1 + v0 t)."""
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian=f"exp({rate!r}*x)*vx**2/2",
        initial_velocity=0.5,
        final_time=1.0,
    )
    found = solution_expansion(scene, 8.0)
    np.testing.assert_array_equal(found.exponents, np.arange(1.0, 8.0))
    expected = [-((-0.5) ** n) / n for n in range(1, 8)]
    agrees = np.allclose(found.coefficients[:, 0], expected, rtol=1e-11, atol=0.0)
    assert agrees == (rate == 2.0)


def test_powers_that_cancel_are_absent():
    """A charge in a magnetic field moves on a circle: x = sin(2 t)/2, y = (cos(2 t) - 1)/2."""
    scene = lagrangian_scene(
        final_time=5.0,
        coordinates=["x", "y"],
        lagrangian="(vx**2 + vy**2)/2 + x*vy - y*vx",
        initial_velocity=[1.0, 0.0],
    )
    found = solution_expansion(scene, 8.0)
    np.testing.assert_array_equal(found.exponents, np.arange(1.0, 8.0))
    x, y = found.coefficients.T
    assert np.flatnonzero(x).tolist() == [0, 2, 4, 6]
    assert np.flatnonzero(y).tolist() == [1, 3, 5]
    np.testing.assert_allclose(x[::2], [1, -2 / 3, 2 / 15, -4 / 315], rtol=1e-14)


@pytest.mark.parametrize(
    ("order", "coefficient", "message"),
    [(1.99, DAMPING, "more than 128"), (1.9, 1e300, "not finite")],
)
def test_what_has_no_usable_expansion_is_named(order, coefficient, message):
    with pytest.raises(SeriesError, match=message):
        solution_expansion(oscillator(order, coefficient), 8.0)
