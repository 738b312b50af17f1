"""States for the past against sums that are written out, on equal steps."""

import math
from dataclasses import replace

import numpy as np
import pytest
from spread import spread
from written_out import integrate_written_out

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.named import linear_oscillator, pendulum

GAUSS2 = Method(cq="gauss", degree=2)


def damping(*orders: float) -> list[FractionalDamping]:
    return [FractionalDamping(order=g, coefficient=0.7) for g in orders]


def oscillator(*orders: float) -> Scene:
    return linear_oscillator(
        final_time=8.0,
        damping=damping(*orders),
        stiffness=2.0,
        initial_position=1.0,
        initial_velocity=0.5,
        forcing=Forcing.from_text("cos(t) + sqrt(t)"),
    )


def largest_difference(scene: Scene, method: Method, n_steps: int) -> float:
    """Between the two, relative, over positions and momenta."""
    one = integrate(scene, method, n_steps)
    other = integrate_written_out(scene, method, n_steps)
    assert one.status == "ok"
    return max(
        float(np.abs(getattr(one, name) - getattr(other, name)).max())
        / float(np.abs(getattr(other, name)).max())
        for name in ("position", "momentum")
    )


@spread(
    orders=[(0.5,), (1.5,), (1.0,), (0.5, 1.5, 1.0), ()],
    degree=[1, 2, 3],
    cq=["gauss", "radau-iia", "lobatto-iiic"],
)
def test_all_families_and_orders(cq, degree, orders):
    # less than a block, and a few blocks
    for n_steps in (5, 64, 300):
        method = Method(cq=cq, degree=degree)
        assert largest_difference(oscillator(*orders), method, n_steps) < 1e-12


def test_a_wrong_order_is_seen():
    """The control."""
    one = integrate(oscillator(0.5), GAUSS2, 400)
    other = integrate_written_out(oscillator(0.5 + 1e-9), GAUSS2, 400)
    assert np.abs(one.position - other.position).max() > 1e-10


@pytest.mark.parametrize("quadrature", ["exact", "projected"])
def test_load_vectors(quadrature):
    """Forces with breaks, and none at all."""
    pieces = (
        replace(Forcing.from_text("8").pieces[0], until=4.0),
        replace(Forcing.from_text("sqrt(t)").pieces[0], until=5.0),
        Forcing.from_text("0").pieces[0],
    )
    method = replace(GAUSS2, forcing_quadrature=quadrature)
    for forcing in (Forcing(pieces=pieces), Forcing.from_text("sqrt(t)"), None):
        scene = replace(oscillator(1.5), forcing=forcing)
        assert largest_difference(scene, method, 256) < 1e-12


def test_riemann_liouville_with_a_jump():
    scene = replace(oscillator(0.5), derivative="riemann-liouville")
    assert largest_difference(scene, GAUSS2, 420) < 1e-12


def test_nonlinear_scenes():
    scene = pendulum(
        final_time=20.0, damping=damping(0.5, 1.5), initial_position=1.0, initial_velocity=0.3
    )
    assert largest_difference(scene, GAUSS2, 400) < 1e-12


def test_a_step_without_a_unique_solution_fails_with_what_was_finished():
    """One stage: 1 + h^2 k / 4 = 0 for k = -4 / h^2."""
    h = 0.25
    scene = linear_oscillator(final_time=2.0, stiffness=-4 / h**2, initial_position=1.0)
    found = integrate(scene, Method(cq="gauss", degree=1), 8)
    assert found.status == "failed"
    assert found.time.size == 1
    assert "have no unique solution; take another number of steps" in found.message
    assert integrate(scene, Method(cq="gauss", degree=1), 64).time.size > 1


def test_a_singular_mass_matrix_stops_the_run_where_it_is():
    scene = lagrangian_scene(
        coordinates=("x",),
        lagrangian="vx**2*(1 - x)/2",
        final_time=20.0,
        damping=damping(0.5),
        initial_velocity=5.0,
    )
    times = 20.0 * np.linspace(0.0, 1.0, 201)
    for steps in (200, mesh_of(times)):
        found = integrate(scene, GAUSS2, steps)
        assert found.status == "failed"
        assert found.message.startswith("step ")
        assert np.isfinite(found.position).all()
        assert found.position.max() < 1.0


@pytest.mark.parametrize("count", [64, 4500])
def test_operations_are_linear_in_the_number_of_steps(count):
    one = integrate(oscillator(0.5), GAUSS2, count).history_operations
    two = integrate(oscillator(0.5), GAUSS2, 2 * count).history_operations
    assert two < 2.6 * one
    assert integrate(oscillator(), GAUSS2, count).history_operations == 0
    assert not math.isclose(one, 0)
