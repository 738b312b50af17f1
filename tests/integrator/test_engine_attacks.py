"""Extreme data and loads of forces: right numbers, or a status that says what is wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import in_pieces, spring
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.graded import graded_start_mesh
from fvi_cli.integrator.meshes.mesh import uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.lagrange import lobatto_basis


def gauss(degree: int, start: str = "none") -> Method:
    return Method(cq="gauss", degree=degree, start=start)


def damped(order: float, coefficient: float = 0.5) -> list[FractionalDamping]:
    return [FractionalDamping(order=order, coefficient=np.array([[coefficient]]))]


def pushed(order: float, until: float, final_time: float = 10.0) -> Scene:
    return spring(T=final_time, x=1.0, damping=damped(order), forcing=in_pieces("1", until, "0"))


@pytest.mark.parametrize(("degree", "order"), [(3, 1.98), (6, 1.5), (10, 0.5)])
def test_finer_steps_behind_a_break_point_end_where_round_off_begins(degree, order):
    scene = pushed(order, 7.3)
    fine = integrate(scene, gauss(degree, "graded"), 1000)
    adaptive = integrate(scene, gauss(8), AdaptiveSteps(tolerance=1e-9))
    assert fine.status == adaptive.status == "ok"
    assert abs(fine.position[-1, 0] - adaptive.position[-1, 0]) < 1e-12


@pytest.mark.parametrize("until", [1 - 1e-9, 1 - 1e-12, 1 - 1e-15, 1e-12])
def test_a_break_point_next_to_an_end(until):
    found = integrate(pushed(1.5, until, final_time=1.0), gauss(3, "graded"), 16)
    plain = integrate(pushed(1.5, until, final_time=1.0), gauss(8), 64)
    assert found.status == "ok"
    assert abs(found.position[-1, 0] - plain.position[-1, 0]) < 1e-6


def test_a_mesh_behind_a_break_point_has_steps_of_more_than_round_off():
    equal = uniform_mesh(10.0, 4096, (7.3,))
    mesh = graded_start_mesh(equal, stages=10, exponent=lambda at_start: 2.02)
    assert all(one.step_size > 100 * math.ulp(one.begin) for one in mesh.stretches)


def test_a_break_point_a_little_beside_a_fine_grid():
    n_steps = 2**20
    until = (n_steps - 3 + 5e-4) / n_steps
    mesh = uniform_mesh(1.0, n_steps, (until,))
    assert mesh.stretches[1].begin == until
    assert mesh.n_steps == n_steps


def test_riemann_liouville_of_order_near_one_pushes_at_the_start():
    """The force of an initial position tends to a push: the limit is order 1 with v0 - mu q0."""
    order, mass_free = 1 - 1e-6, {"final_time": 4.0, "initial_position": 1.0}
    near = spring(damping=damped(order), derivative="riemann-liouville", **mass_free)
    limit = spring(v=-0.5, damping=damped(1.0), **mass_free)
    wanted = integrate(limit, gauss(4), 200).position[-1, 0]
    for method, steps in (
        (gauss(4, "graded"), 200),
        (gauss(4), 200),
        (gauss(6), AdaptiveSteps(tolerance=1e-9)),
    ):
        assert abs(integrate(near, method, steps).position[-1, 0] - wanted) < 1e-5


@spread(order=[0.01, 0.5, 0.9, 0.999], ratio=[math.inf, 1.0, 80.0, 1e9])
def test_loads_of_riemann_liouville(order, ratio):
    """Their sum over the basis is the integral of the force."""
    scene = spring(T=1.0, x=1.0, damping=damped(order), derivative="riemann-liouville")
    method, h = gauss(5), 0.25
    begin = h / ratio
    found = StepLoads(scene, method, step_tables(method)).of_steps(begin, h, 1, is_fresh=begin == 0)
    power = 1 - order
    wanted = -0.5 * ((begin + h) ** power - begin**power) / math.gamma(2 - order)
    assert abs(found.sum() / wanted - 1) < 1e-12


@pytest.mark.parametrize("order", [1e-17, 1e-300])
def test_orders_below_round_off(order):
    scene = spring(T=2.0, x=1.0, damping=damped(order))
    found = integrate(scene, gauss(4), 32)
    # D^0 of q - q0 is a spring
    wanted = (0.5 + math.cos(2.0 * math.sqrt(1.5))) / 1.5
    assert found.status == "ok"
    assert abs(found.position[-1, 0] - wanted) < 1e-8


@pytest.mark.few(1)
@pytest.mark.parametrize("degree", [4, 7, 10])
def test_a_tolerance_below_round_off_of_the_position(degree):
    scene = spring(T=9.0, x=1e30, damping=damped(0.5, 0.3))
    found = integrate(scene, gauss(degree), AdaptiveSteps(tolerance=1e-6, most_steps=3000))
    small = spring(T=9.0, x=1.0, damping=damped(0.5, 0.3))
    wanted = integrate(small, gauss(degree), AdaptiveSteps(tolerance=1e-12)).position[-1, 0]
    assert found.status == "ok"
    assert abs(found.position[-1, 0] / 1e30 - wanted) < 1e-12


def loads(text: str, method: Method, h: float, n_steps: int) -> np.ndarray:
    """Load vectors of a force on equal steps from 0 on."""
    scene = spring(T=h * n_steps, forcing=text)
    found = StepLoads(scene, method, step_tables(method)).of_steps(0.0, h, n_steps, is_fresh=True)
    assert found is not None
    return found


@pytest.mark.parametrize("power", [-0.9, -0.5, 0.5, 1.5, 3.0])
def test_exact_moments_of_powers(power):
    """Against the integrals of t**(power + j), on the first, second and tenth step."""
    method = Method(cq="bdf1", degree=2, forcing_quadrature="exact")
    force, h = f"t**({power})", 0.3
    moments = loads(force, method, h, 12)[:, :, 0]
    basis = lobatto_basis(2)
    # coefficients of the basis in powers of tau
    vandermonde = np.vander(basis.control_points, increasing=True)
    coefficients = np.linalg.inv(vandermonde).T
    for k in (0, 1, 9):
        # int_0^1 tau^j (k + tau)^power: from integrals of (k + tau)^(power + i)
        integrals = [
            ((k + 1.0) ** (power + i + 1) - float(k) ** (power + i + 1)) / (power + i + 1)
            for i in range(3)
        ]
        shifted = [
            sum(math.comb(j, i) * (-k) ** (j - i) * integrals[i] for i in range(j + 1))
            for j in range(3)
        ]
        expected = h ** (power + 1) * coefficients @ np.array(shifted)
        assert moments[k] == pytest.approx(expected, rel=1e-12 if k < 2 else 1e-10, abs=1e-13)
    plain = loads(force, replace(method, forcing_quadrature="galerkin"), h, 12)[:, :, 0]
    if power != 3.0:
        assert abs(plain[0] - moments[0]).max() > 1e-6
