"""Derivatives of runs: against forty digits, differences, and each other."""

from functools import cache, partial
from typing import Any

import mpmath
import numpy as np
import pytest
from against_differences import changes, misses
from letters import spring, swing
from spread import spread

import fvi_cli as fvi
from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.gradient import gradient_of, run_steps
from fvi_cli.integrator.gradients.linearised import LinearisedRun
from fvi_cli.integrator.gradients.quantity import (
    acceleration_at,
    misfit,
    position_at,
    quantity_at,
)
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.mesh import graded_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observe.dampers import forces_along
from fvi_cli.integrator.observe.motion import Motion
from fvi_cli.integrator.observe.observer import Observer
from fvi_cli.integrator.observe.request import Observations, names_of
from fvi_cli.scenes.data import duffing, kepler
from fvi_cli.scenes.registry import build_problem

GAUSS3, GAUSS8 = (Method(cq="gauss", degree=m, start="none") for m in (3, 8))
FINE = AdaptiveSteps(tolerance=1e-10)
TIME = 3.7

# orders and coefficients of the terms
DAMPINGS = {
    "below 1": [(0.5, 0.4)],
    "small": [(0.05, 0.7)],
    "above 1": [(1.5, 0.6)],
    "near 2": [(1.9, 0.3)],
    "viscous": [(1.0, 0.3)],
    "on both sides of 1": [(0.3, 0.5), (1.7, 0.2)],
    "three": [(0.7, 0.2), (1.0, 0.1), (1.2, 0.4)],
}


def oscillator(name: str) -> Scene:
    return spring(*DAMPINGS[name], T=4.0, m=1.3, k=2.0, x=1.0, v=0.5)


@cache
def in_forty_digits(name: str, order: int = 0) -> dict[str, float]:
    """Derivatives of x(TIME) or x''(TIME), from inverted transforms; under ``value`` itself."""
    values = {"mass": 1.3, "stiffness": 2.0, "initial_position": 1.0, "initial_velocity": 0.5}
    for index, (power, coefficient) in enumerate(DAMPINGS[name]):
        values[f"damping.{index}.order"] = power
        values[f"damping.{index}.coefficient"] = coefficient

    def transform(s: Any, m: Any, k: Any, x0: Any, v0: Any, *terms: Any) -> Any:
        # Caputo: the transform of D^g x is s^g X - s^(g-1) x0 - [g > 1] s^(g-2) v0
        above, below = m * (s * x0 + v0), m * s**2 + k
        for g, c in zip(terms[::2], terms[1::2], strict=True):
            above += c * (s ** (g - 1) * x0 + (s ** (g - 2) * v0 if g > 1.01 else 0))
            below += c * s**g
        return s**2 * above / below - s * x0 - v0 if order else above / below

    def number(**changed: Any) -> Any:
        numbers = [mpmath.mpf(value) for value in {**values, **changed}.values()]
        return mpmath.invertlaplace(
            lambda s: transform(s, *numbers), TIME, method="talbot", degree=60
        )

    def rate(what: str) -> Any:
        h = mpmath.mpf(10) ** -12
        at = mpmath.mpf(values[what])
        return (number(**{what: at + h}) - number(**{what: at - h})) / (2 * h)

    with mpmath.workdps(40):
        return {"value": float(number())} | {what: float(rate(what)) for what in values}


def agree(found: Any, scene: Scene, expected: dict[str, float]) -> None:
    for one, change in zip(found, changes(scene), strict=True):
        assert one == pytest.approx(expected[change.name], rel=1e-9), change.name


@pytest.mark.few(2)
@pytest.mark.parametrize("name", DAMPINGS)
def test_against_forty_digits(name):
    scene = oscillator(name)
    _, found = gradient_of(scene, GAUSS8, FINE, position_at(TIME), changes(scene))
    agree(found, scene, in_forty_digits(name))


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["small", "near 2", "viscous", "on both sides of 1"])
def test_accelerations_and_forces_against_forty_digits(name):
    scene = oscillator(name)
    # what an order changes is singular at the start even where the motion is smooth
    steps = graded_mesh(4.0, 60, 6.0)
    position, acceleration = in_forty_digits(name), in_forty_digits(name, 2)
    force = {what: 1.3 * acceleration[what] + 2.0 * position[what] for what in position}
    force["mass"] += acceleration["value"]
    force["stiffness"] += position["value"]
    for quantity, expected in (
        (acceleration_at(TIME), acceleration),
        (quantity_at("dx", TIME), force),
    ):
        _, found = gradient_of(scene, GAUSS8, steps, quantity, changes(scene))
        agree(found, scene, expected)
        # the acceleration of another damping would be seen
        wrong = in_forty_digits("below 1", 2)
        assert found[0] != pytest.approx(wrong["mass"], rel=1e-3)


PENDULUM = swing((0.6, 0.3), T=6.0, omega=1.2, x=2.0, v=0.4, forcing="0.3*sin(2*t)")
SCENES = {
    "pendulum": PENDULUM,
    "duffing": duffing(
        mass=1.1,
        cubic_stiffness=1.5,
        damping=[FractionalDamping(order=1.4, coefficient=0.4)],
        initial_position=1.2,
        initial_velocity=0.3,
        final_time=5.0,
    ),
    "undamped": duffing(
        cubic_stiffness=1.5, initial_position=1.2, initial_velocity=0.3, final_time=3.0
    ),
    # a mass matrix that depends on the position
    "double pendulum": build_problem(
        {
            "kind": "double-pendulum",
            "lengths": [1.0, 0.8],
            "gravity": 2.0,
            "damping": [{"order": 0.5, "coefficient": [[0.3, 0.0], [0.0, 0.3]]}],
            "initial": {"position": [1.0, -0.5], "velocity": [0.2, 0.0]},
            "final_time": 2.0,
        }
    ).scene,
    "riemann-liouville": spring(
        (0.4, 0.5), T=3.0, k=3.0, x=0.7, v=0.2, derivative="riemann-liouville"
    ),
    "kepler": kepler(
        attraction=1.3,
        damping=[FractionalDamping(order=0.5, coefficient=0.05 * np.eye(2))],
        initial_position=[1.0, 0.1],
        initial_velocity=[0.1, 1.0],
        final_time=3.0,
    ),
    # beside a springpot
    "zener": spring(
        (0.3, 0.3),
        T=3.0,
        x=1.0,
        v=0.5,
        laws=(
            fvi.fractional_zener(order=0.6, time=0.4, relaxed=2.0, unrelaxed=5.0, coefficient=1.0),
        ),
    ),
}


@spread(few=1, name=list(SCENES))
def test_expressions_against_central_differences(name, monkeypatch):
    """Of accelerations, damping forces, velocities and positions."""
    scene = SCENES[name]
    steps = graded_mesh(scene.final_time, 12, 2.0)
    times = np.array([0.0, 0.9, 2.0] if name != "riemann-liouville" else [0.3, 0.9, 2.0])
    first, *_, last = names_of(scene) * 2
    d = scene.dimension
    text = f"a{last} - 0.3*d{first}*{last} + v{last}**2*{first}*cos(t)"
    quantity = misfit(times, np.zeros(3), of=text)

    def value(beside: Scene) -> float:
        # damping forces by the engine, which the derivative has from its own memory
        done = run_steps(beside, GAUSS3, steps)
        forces = partial(forces_along, [beside], GAUSS3, [done])
        motion = Motion([beside], [done], forces)
        asked = Observations(coordinates=names_of(beside))
        expression = quantity.expression(asked, beside)
        assert expression is not None
        along = Observer(motion, [asked]).along(expression)
        return quantity.value(along(*motion.located(0, times)))

    assert misses(scene, GAUSS3, steps, quantity, value).max() < 1.0
    if not scene.damping:
        return
    # without what the stages of the motion do it is another number
    tangent = LinearisedRun.tangent
    monkeypatch.setattr(
        LinearisedRun,
        "tangent",
        lambda run, change: tangent(run, change)._replace(velocity=np.zeros((12, 3, d, d))),
    )
    assert misses(scene, GAUSS3, steps, quantity, value, ("initial_position",)).max() > 1e3


@pytest.mark.parametrize(
    "terms", [[(1.5, 0.3)], [(0.5, 0.4)], [(1.5, 0.3), (0.5, 0.4)], [(1.8, 0.2), (1.2, 0.1)]]
)
def test_the_force_of_one_damper_by_initial_data(terms):
    """A start velocity counts once: in what derivatives of orders above 1 subtract, or not."""
    scene = spring(*terms, T=3.0, m=1.3, k=2.0, x=0.5, v=0.7)
    quantity = quantity_at("force_1", 1.7)

    def value(beside: Scene) -> float:
        return gradient_of(beside, GAUSS3, 40, quantity, [])[0]

    initial = ("initial_position", "initial_velocity")
    assert misses(scene, GAUSS3, 40, quantity, value, initial).max() < 1.0
