"""Scenes from a Lagrangian: what is recognised, and what is refused."""

import numpy as np
import pytest
from letters import spring, swing

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.laws import fractional_zener
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.lagrangian import lagrangian_scene

GAUSS3 = Method(cq="gauss", degree=3, start="graded")


def single(lagrangian: str, **keywords: object) -> Scene:
    keywords = {"final_time": 4.0, "initial_position": 1.0, **keywords}
    return lagrangian_scene(coordinates=["x"], lagrangian=lagrangian, **keywords)


def test_the_pendulum_is_the_pendulum():
    damping = [FractionalDamping(order=0.5, coefficient=0.3)]
    text = "m*(l*vx)**2/2 - m*g*l*(1 - cos(x))"
    made = single(text, parameters={"m": 1.0, "l": 1.0, "g": 4.0}, damping=damping)
    named = swing(T=4.0, omega=2.0, x=1.0, damping=damping)
    assert isinstance(made.potential, ExpressionPotential)
    for method in (GAUSS3, Method(cq="bdf3", degree=2)):
        a, b = integrate(made, method, 64), integrate(named, method, 64)
        assert np.abs(a.position - b.position).max() < 1e-13
        assert a.energy is not None
        assert a.energy == pytest.approx(b.energy, abs=1e-13)
    # control: another length is another motion
    other = single(text, parameters={"m": 1.0, "l": 1.1, "g": 4.0}, damping=damping)
    assert np.abs(integrate(other, GAUSS3, 64).position - a.position).max() > 1e-3


def test_forces_in_the_lagrangian_are_forces():
    made = single("vx**2/2 - x**2 + x*sin(3*t) - 2*x", forcing=Forcing.from_text("t"))
    plain = spring(T=4.0, k=2.0, x=1.0, forcing="t + sin(3*t) - 2")
    a, b = integrate(made, GAUSS3, 32), integrate(plain, GAUSS3, 32)
    assert np.abs(a.position - b.position).max() < 1e-14


@pytest.mark.parametrize("names", [("x0", "x1"), ("x2", "x1"), ("phi", "s")])
@pytest.mark.parametrize("energy", ["-({0}**2 + 4*{1}**2)/2", "cos({0}) - {1}**4", "{0}*v{1}**2/9"])
def test_expressions_along_a_scene_know_the_names_that_it_was_made_with(names, energy):
    one, two = names
    scene = fvi.lagrangian(
        coordinates=names,
        lagrangian=f"v{one}**2/2 + v{two}**2/2 + {energy.format(one, two)}",
        initial_position=[0.3, -0.4],
        initial_velocity=[0.1, 0.2],
        final_time=1.0,
    )
    run = fvi.integrate(scene, "gauss3", 10, quantities={"first": one, "second": f"v{two}"})
    assert run.observed.quantities["first"] == pytest.approx(run.position[:, 0], abs=1e-12)
    # the derivative of the step's polynomial
    assert run.observed.quantities["second"][0] == pytest.approx(0.2, abs=1e-4)
    assert run.coordinates == names


def test_a_dense_relaxed_stiffness_beside_a_formula():
    """40 coordinates, 1,600 stiffnesses: the matrix stays one; V and -K q against NumPy."""
    n = 40
    random = np.random.default_rng(5)
    rows = random.normal(size=(n, n))
    coefficient = rows @ rows.T
    names = [f"x{k}" for k in range(n)]
    velocities = " + ".join(f"v{name}**2/2" for name in names)
    law = fractional_zener(order=0.5, relaxed=2.0, unrelaxed=3.0, time=0.7, coefficient=coefficient)
    place = random.normal(size=n)
    for text, general in [
        (f"{velocities} + cos(x0)", False),
        (f"{velocities} + cos(x0)*vx1**2/9 + cos(x0)", True),
    ]:
        made = lagrangian_scene(
            coordinates=names,
            lagrangian=text,
            laws=[law],
            initial_position=place,
            final_time=1.0,
        )
        stiffness = law.stiffness
        expected = -stiffness @ place
        expected[0] -= np.sin(place[0])
        if general:
            assert made.lagrangian is not None
            at = made.lagrangian.derivatives(place, np.zeros(n), 0.0)
            force, curvature = at.force, -at.stiffness
            energy = made.lagrangian.energy(place, np.zeros(n), 0.0)
        else:
            assert isinstance(made.potential, ExpressionPotential)
            potential = made.potential
            energy, gradient = potential.energy(place), potential.gradient(place)
            curvature = potential.hessian(place)
            force = -gradient
            assert made.potential.gradient(place) == pytest.approx(gradient, abs=0)
        assert force == pytest.approx(expected, rel=1e-12, abs=1e-10)
        exact = 0.5 * place @ stiffness @ place - np.cos(place[0])
        assert float(energy) == pytest.approx(exact, rel=1e-12)
        own = np.zeros((n, n))
        own[0, 0] = np.cos(place[0])
        assert curvature == pytest.approx(stiffness + own, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        # piecewise linear, piecewise constant in time, and a pulse that is 0 almost everywhere
        ("vx**2/2 - max(x - 1e6, 0) - max(-x, 0)", ExpressionPotential),
        ("vx**2/2 - x**2 - exp(-((x - 2)/1e-3)**2)", ExpressionPotential),
        ("vx**2/2 + min(vx, 0)", None),
        ("vx**2/2 - x**2*(2 + sign(t - 100))", None),
        ("vx**2/2 - x**2 + x*max(t - 100, 0)", QuadraticPotential),
    ],
)
def test_kinks_and_pulses_are_not_taken_for_constants(text, kind):
    made = single(text)
    assert (made.lagrangian is not None) == (kind is None)
    if kind is not None:
        assert isinstance(made.potential, kind)
    if kind is QuadraticPotential:
        assert made.forcing is not None
        assert made.forcing(np.array([3.0, 103.0]))[:, 0].tolist() == [0.0, 3.0]


def test_walls_far_from_zero_are_not_lost():
    """exp(200 (x - 4)) is not exp(-800) times anything: the gradient is 200 e^2 at 4.01."""
    made = single("vx**2/2 - exp(200*(x - 4))", initial_position=4.01)
    assert isinstance(made.potential, ExpressionPotential)
    found = made.potential.gradient(np.array([4.01]))
    assert found == pytest.approx([200 * np.exp(200 * (4.01 - 4))], rel=1e-12)
