"""States for the past against sums that are written out, on equal steps."""

from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring, swing
from spread import spread
from written_out import integrate_written_out

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.mesh import mesh_of
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene

GAUSS2 = Method(cq="gauss", degree=2)


def damping(*orders: float) -> list[FractionalDamping]:
    return [FractionalDamping(order=g, coefficient=0.7) for g in orders]


def oscillator(*orders: float) -> Scene:
    return spring(T=8.0, k=2.0, x=1.0, v=0.5, damping=damping(*orders), forcing="cos(t) + sqrt(t)")


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
    pieces = in_pieces("8", 4.0, "sqrt(t)", 5.0, "0")
    method = replace(GAUSS2, forcing_quadrature=quadrature)
    for forcing in (pieces, Forcing.from_text("sqrt(t)"), None):
        scene = replace(oscillator(1.5), forcing=forcing)
        assert largest_difference(scene, method, 256) < 1e-12


def test_riemann_liouville_with_a_jump():
    scene = replace(oscillator(0.5), derivative="riemann-liouville")
    assert largest_difference(scene, GAUSS2, 420) < 1e-12


def test_nonlinear_scenes():
    scene = swing(T=20.0, x=1.0, v=0.3, damping=damping(0.5, 1.5))
    assert largest_difference(scene, GAUSS2, 400) < 1e-12


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
