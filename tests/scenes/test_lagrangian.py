"""Scenes from a Lagrangian: what is recognised, and what is refused."""

import numpy as np
import pytest
from letters import spring, swing

from fvi_cli.config import parse_config
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.forcing import Forcing
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import RequestError
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.scenes.chains import chain
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


def test_a_chain_is_recognised_as_matrices():
    damping = [FractionalDamping(order=0.5, coefficient=0.2 * np.eye(3))]
    made = lagrangian_scene(
        final_time=4.0,
        coordinates=["a", "b", "c"],
        lagrangian="m*(va**2+vb**2+vc**2)/2 - k*(a**2 + (b-a)**2 + (c-b)**2 + c**2)/2",
        parameters={"m": 2.0, "k": 3.0},
        damping=damping,
        initial_position=[1.0, 0.0, 0.5],
    )
    named = chain(
        final_time=4.0,
        masses=3,
        mass=2.0,
        stiffness=3.0,
        damping=damping,
        initial_position=[1.0, 0.0, 0.5],
    )
    assert isinstance(made.potential, QuadraticPotential)
    assert made.is_linear
    assert isinstance(named.potential, QuadraticPotential)
    assert made.potential.stiffness == pytest.approx(named.potential.stiffness, abs=1e-15)
    assert made.inertia.mass == pytest.approx(named.inertia.mass, abs=1e-15)
    a, b = integrate(made, GAUSS3, 32), integrate(named, GAUSS3, 32)
    assert np.abs(a.position - b.position).max() < 1e-13


def test_forces_in_the_lagrangian_are_forces():
    made = single("vx**2/2 - x**2 + x*sin(3*t) - 2*x", forcing=Forcing.from_text("t"))
    plain = spring(T=4.0, k=2.0, x=1.0, forcing="t + sin(3*t) - 2")
    a, b = integrate(made, GAUSS3, 32), integrate(plain, GAUSS3, 32)
    assert np.abs(a.position - b.position).max() < 1e-14


def test_a_spring_whose_end_is_shaken():
    made = single("vx**2/2 - (x - sin(3*t))**2")
    plain = spring(T=4.0, k=2.0, x=1.0, forcing="2*sin(3*t)")
    assert isinstance(made.potential, QuadraticPotential)
    a, b = integrate(made, GAUSS3, 32), integrate(plain, GAUSS3, 32)
    assert np.abs(a.position - b.position).max() < 1e-14


def test_a_mass_that_is_constant_after_all():
    made = single("((l*cos(x)*vx)**2 + (l*sin(x)*vx)**2)/2 + cos(x)", parameters={"l": 2.0})
    assert made.inertia.mass == pytest.approx(np.array([[4.0]]), abs=1e-14)
    assert isinstance(made.potential, ExpressionPotential)


def test_free_motion_has_no_potential():
    made = single("m*vx**2/2 + 3 + 0*x", parameters={"m": 2.0})
    assert made.potential is None
    assert made.forcing is None


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"lagrangian": "x**2"}, "no velocity occurs"),
        ({"lagrangian": "vx**2 + q"}, "lagrangian: column 9: unknown name 'q'"),
        ({"lagrangian": "vx**2 +"}, "lagrangian: column"),
        ({"lagrangian": "vx"}, "not positive definite: its smallest eigenvalue is 0"),
        ({"lagrangian": "-vx**2"}, "not positive definite: its smallest eigenvalue is -2"),
        ({"lagrangian": "vx**2 + gamma(x)"}, "'gamma' cannot be differentiated"),
        ({"lagrangian": "vx**2*sqrt(-1)"}, "not a real number"),
        ({"lagrangian": "vx**2/m", "parameters": {"m": 0.0}}, "divides by zero"),
        ({"lagrangian": "__import__('os')"}, "lagrangian: "),
        ({"lagrangian": "vx.__class__"}, "lagrangian: "),
        ({"parameters": {"x": 1.0}}, "parameters.x: the name is a coordinate"),
        ({"parameters": {"vx": 1.0}}, "parameters.vx: the name is the velocity of x"),
        ({"parameters": {"sin": 1.0}}, "parameters.sin: "),
        ({"coordinates": ["x", "vx"]}, "coordinates.1: 'vx' is the velocity of x already"),
        ({"coordinates": ["x", "x"]}, "coordinates.1: 'x' is a coordinate already"),
        ({"coordinates": ["t"]}, "coordinates.0: 't' is the time already"),
        ({"coordinates": ["x y"]}, "coordinates.0: 'x y' cannot be a variable"),
        (
            {"coordinates": ["x", "y"], "lagrangian": "vx**2 - x*y"},
            "vy does not occur quadratically",
        ),
    ],
)
def test_mistakes_are_named(keywords, message):
    given: dict[str, object] = {
        "coordinates": ["x"],
        "lagrangian": "vx**2 - x**2",
        "final_time": 1.0,
        **keywords,
    }
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        lagrangian_scene(**given)


CASE = """name: a
problem:
  kind: lagrangian
  coordinates: [x, y]
  parameters: {m: 1.0}
  lagrangian: m*(vx**2 + vy**2)/2 - (x - y)**2
  damping: [{order: 0.5, coefficient: 1.0, acts_on: [x - y]}]
  final_time: 1
ladder: {steps: [4]}
"""


def test_a_configuration_names_its_coordinates():
    (experiment,) = parse_config(CASE, "a.yaml").experiments
    scene = experiment.problem.scene
    assert scene.damping[0].coefficient.tolist() == [[1.0, -1.0], [-1.0, 1.0]]
    assert scene.potential.stiffness.tolist() == [[2.0, -2.0], [-2.0, 2.0]]


@pytest.mark.parametrize(
    ("old", "new", "messages"),
    [
        ("[x, y]", "[x, vx]", ["a.yaml:4", "problem.coordinates.1", "velocity of x"]),
        ("(x - y)**2", "(x - z)**2", ["a.yaml:6", "problem.lagrangian", "unknown name 'z'"]),
        ("{m: 1.0}", "{m: a}", ["a.yaml:5", "problem.parameters.m", "a finite number"]),
        ("{m: 1.0}", "{t: 1.0}", ["problem.parameters.t", "the time"]),
        ("[x - y]", "[x - z]", ["problem.damping.0.acts_on.0", "unknown name 'z'"]),
        ("lagrangian: m", "lagrange: m", ["problem.lagrange", "lagrangian"]),
        (
            "  final",
            "  initial: {position: [1]}\n  final",
            ["problem.initial", "coordinates for 2"],
        ),
    ],
)
def test_mistakes_in_a_configuration(old, new, messages):
    with pytest.raises(RequestError) as caught:
        parse_config(CASE.replace(old, new), "a.yaml")
    for message in messages:
        assert message in str(caught.value)
