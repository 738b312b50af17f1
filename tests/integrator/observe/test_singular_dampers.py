"""Forces of Riemann-Liouville dampers above order 1 with a start velocity, and starts."""

import mpmath
import numpy as np
import pytest
from letters import spring

import fvi_cli as fvi

TIMES = np.array([0.1, 1.0, 2.5, 5.0])


def exact(order, power, times=TIMES):
    """x, its rate (power 0, 1) or derivative of any power, by Laplace inversion."""

    def transform(s):
        return s**power / (s**2 + 0.5 * s**order + 1)

    return np.array([float(mpmath.invertlaplace(transform, t, method="talbot")) for t in times])


@pytest.mark.parametrize("order", [1.95, 1.2])
def test_positions_velocities_and_deformations_above_order_1(order):
    scene = spring((order, 0.5), T=5.0, v=1.0, derivative="riemann-liouville")
    names = {"x": "x + deformation_1", "v": "vx"}
    run = fvi.integrate(scene, "gauss4", 160, output=TIMES, quantities=names)
    assert run.observed.quantities["x"] == pytest.approx(2 * exact(order, 0), abs=1e-8)
    assert run.observed.quantities["v"] == pytest.approx(exact(order, 1), abs=1e-8)


def test_velocities_and_their_gradients_behind_such_a_start():
    scene = spring((1.7, 0.5), T=5.0, v=1.0, derivative="riemann-liouville")
    found = fvi.gradient(scene, "gauss6", 160, fvi.position_at(2.5), ["initial_velocity"])
    # the motion is linear in the velocity
    assert found.derivatives["initial_velocity"] == pytest.approx(found.value, abs=1e-9)
    assert found.value == pytest.approx(exact(1.7, 0, [2.5])[0], abs=1e-9)


@pytest.mark.parametrize("quantity", ["ax", "dx", "force_1"])
def test_gradients_of_forces_below_order_1(quantity):
    """Riemann-Liouville of an initial position: the loads change with every parameter."""
    values = {"order": 0.6, "size": 0.5, "x": 1.0, "v": 0.3}

    def scene(order=0.6, size=0.5, x=1.0, v=0.3):
        return spring((order, size), T=3.0, x=x, v=v, derivative="riemann-liouville")

    def value(**changed):
        own = scene(**{**values, **changed})
        run = fvi.integrate(own, "gauss4", 60, output=[1.73], quantities={"q": quantity})
        return run.observed.quantities["q"][0]

    names = {
        "order": "damping.0.order",
        "size": "damping.0.coefficient",
        "x": "initial_position",
        "v": "initial_velocity",
    }
    of = fvi.quantity_at(quantity, 1.73)
    found = fvi.gradient(scene(), "gauss4", 60, of, list(names.values()))
    assert found.value == pytest.approx(value(), abs=1e-12)
    for name, at in values.items():
        slope = (value(**{name: at + 1e-5}) - value(**{name: at - 1e-5})) / 2e-5
        assert found[names[name]].item() == pytest.approx(slope, abs=1e-7), name
