"""Lagrangians whose mass matrix is not constant."""

import math
from dataclasses import replace

import numpy as np
import pytest
from letters import swing
from spread import spread

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.meshes.graded import order_on
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.lagrangian import double_pendulum, lagrangian_scene

GAUSS3 = Method(cq="gauss", degree=3)


def as_general(scene: Scene, text: str) -> Scene:
    """The same scene, its energies taken through the general Lagrangian."""
    formula = Expression.parse(text, variables=("x", "vx", "t")).system
    return replace(scene, potential=None, lagrangian=Lagrangian(coordinates=("x",), value=formula))


def damped_pendulum(order: float, derivative: str = "caputo") -> Scene:
    return swing(
        (order, 0.3),
        T=4.0,
        x=1.0 if derivative == "caputo" else 0.0,
        v=0.7,
        forcing="sin(t)",
        derivative=derivative,
    )


@spread(
    order=[0.5, 1.0, 1.5],
    derivative=["caputo", "riemann-liouville"],
    method=[
        GAUSS3,
        Method(cq="gauss", degree=3, start="graded"),
        Method(cq="lobatto-iiic", degree=2),
        Method(cq="bdf3", degree=2, forcing_quadrature="exact"),
        Method(cq="bdf4", degree=2),
        Method(cq="bdf2", degree=1, sampling="nodes"),
    ],
)
def test_the_general_route_gives_what_the_special_one_gives(order, derivative, method):
    scene = damped_pendulum(order, derivative)
    general = as_general(scene, "vx**2/2 + cos(x)")
    a, b = integrate(scene, method, 48), integrate(general, method, 48)
    assert b.status == "ok"
    assert np.abs(a.position - b.position).max() < 1e-13
    assert np.abs(a.momentum - b.momentum).max() < 1e-13
    # the energies differ by the constant that the potential of the pendulum has
    assert np.abs(a.energy - b.energy - 1.0).max() < 1e-13
    wrong = as_general(scene, "vx**2/2 + 1.001*cos(x)")
    assert np.abs(integrate(wrong, method, 48).position - a.position).max() > 1e-5


def bent(order: float = 0.5, coefficient: float = 0.2, final_time: float = 4.0) -> Scene:
    joints = [FractionalDamping(order=order, coefficient=coefficient)] if coefficient else []
    return double_pendulum(final_time=final_time, joints=joints, initial_position=[1.0, -0.5])


def orders(scene: Scene, method: Method, ladder: tuple[int, ...], finest: int) -> np.ndarray:
    reference = integrate(scene, Method(cq="gauss", degree=4, start="graded"), finest).position
    errors = []
    for n in ladder:
        run = integrate(scene, method, n)
        assert run.status == "ok"
        errors.append(np.abs(run.position - reference[:: finest // n]).max())
    return np.log2(np.array(errors[:-1]) / errors[1:])


@pytest.mark.few(1)
@pytest.mark.parametrize("degree", [2, 3])
def test_full_order_of_nonlinear_scenes(degree):
    method = Method(cq="gauss", degree=degree, start="graded")
    found = orders(bent(), method, (64, 128, 256), 512)
    assert found == pytest.approx(np.full(2, 2.0 * degree), abs=0.1)


def test_without_a_graded_start_the_order_is_lost():
    found = orders(bent(1.5), GAUSS3, (64, 128, 256), 512)
    assert found == pytest.approx(np.full(2, 2.5), abs=0.1)


@pytest.mark.few(1)
@pytest.mark.parametrize(("order", "degree"), [(1.5, 3), (1.9, 3), (1.9, 4)])
def test_orders_above_one_meet_the_stages(order, degree):
    method = Method(cq="gauss", degree=degree, start="graded")
    found = orders(bent(order), method, (64, 128), 512)[0]
    stated = degree + 4 - order
    assert math.isnan(order_on(bent(order), method))
    assert stated - 0.35 < found < stated + 0.1


@pytest.mark.parametrize("stages", [2, 3])
def test_a_lagrangian_that_depends_on_time(stages):
    # Caldirola and Kanai: exp(c t) (v^2 - x^2)/2 is x'' + c x' + x = 0
    scene = lagrangian_scene(
        final_time=4.0,
        coordinates=["x"],
        lagrangian="exp(0.4*t)*(vx**2 - x**2)/2",
        initial_position=1.0,
    )
    w = np.sqrt(0.96)
    errors = []
    for n in (16, 32, 64):
        run = integrate(scene, Method(cq="gauss", degree=stages, start="graded"), n)
        t = run.time
        exact = np.exp(-0.2 * t) * (np.cos(w * t) + 0.2 / w * np.sin(w * t))
        errors.append(np.abs(run.position[:, 0] - exact).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(
        np.full(2, 2.0 * stages), abs=0.1
    )


def test_a_force_of_gyroscopic_kind():
    # a charge in a magnetic field moves on circles
    scene = lagrangian_scene(
        final_time=5.0,
        coordinates=["x", "y"],
        lagrangian="(vx**2 + vy**2)/2 + b*(x*vy - y*vx)/2",
        parameters={"b": 2.0},
        initial_velocity=[1.0, 0.0],
    )
    assert scene.lagrangian is not None
    run = integrate(scene, Method(cq="gauss", degree=4), 64)
    t = run.time
    assert run.position[:, 0] == pytest.approx(np.sin(2 * t) / 2, abs=1e-9)
    assert run.position[:, 1] == pytest.approx((np.cos(2 * t) - 1) / 2, abs=1e-9)


def single(lagrangian: str, **keywords: object) -> Scene:
    keywords = {"final_time": 4.0, "initial_position": 1.0, **keywords}
    return lagrangian_scene(coordinates=["x"], lagrangian=lagrangian, **keywords)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x*vx**2/2 - x", "not positive definite|did not converge|not finite"),
        ("vx**2*(1 + x**2)/2 - log(x)", "did not converge|not finite"),
        ("vx**2*(1 + x**2)/2 + sqrt(x)*0.1 - x", "not finite|did not converge"),
    ],
)
def test_a_run_that_cannot_go_on_says_where(text, message):
    run = integrate(single(text), GAUSS3, 64)
    assert run.status == "failed"
    assert "t = " in run.message
    assert any(part in run.message for part in message.split("|"))
    assert 1 < run.time.size < 65
    assert np.isfinite(run.position).all()


def test_a_jump_of_the_force_keeps_the_run_going():
    (piece,) = Forcing.from_text("1", "0").pieces
    stopped = Forcing(pieces=(replace(piece, until=1.0), Forcing.from_text("0", "0").pieces[0]))
    method = Method(cq="gauss", degree=3, start="graded")
    assert orders(replace(bent(), forcing=stopped), method, (128, 256), 512)[0] > 5.8
