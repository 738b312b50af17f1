"""Derivatives by parameters of formulas, over long times, against complex steps elsewhere.

Oracles share no code with the package: the motion of x'' + x = f from rest is the integral of
``sin(T - s) f(s)``, taken by Gauss rules of f written in NumPy; others are integrated by DOP853
with complex parameters.
"""

import math
import random
from collections.abc import Callable, Mapping

import numpy as np
import pytest
from against_differences import by_function
from scipy.integrate import solve_ivp
from spread import spread

from fvi_cli.api.derivatives import gradient
from fvi_cli.effects.forcing import Forcing, ForcingPiece
from fvi_cli.effects.sampled import SampledForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.quantity import position_at, quantity_at
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.scenes.lagrangian import lagrangian_scene
from fvi_cli.scenes.problem import Problem
from fvi_cli.scenes.registry import build_problem
from fvi_cli.scenes.structures import linear_oscillator

STEP = 1e-30


def by_integral(
    force: Callable[..., np.ndarray], values: Mapping[str, float], final_time: float, edges=()
) -> dict[str, float]:
    """Derivatives of x(T) of x'' + x = force(t, **values) from rest."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    ends = np.unique([*np.linspace(0.0, final_time, int(8 * final_time) + 1), *edges])
    # towards 0 for powers of t
    ends = np.unique([*ends, *(ends[1] * 0.5 ** np.arange(1, 60))])
    half = np.diff(ends)[:, None] / 2
    times = (ends[:-1, None] + half) + half * nodes
    found = {}
    for name, value in values.items():
        given = {**values, name: value + 1j * STEP}
        rate = np.imag(force(times, **given) * np.ones_like(times)) / STEP
        found[name] = float((half * weights * np.sin(final_time - times) * rate).sum())
    return found


FORCES = {
    "a*sin(w*t + p)": lambda t, a, w, p: a * np.sin(w * t + p),
    "sin(w*t)*exp(-(a*2)*p)": lambda t, a, w, p: np.sin(w * t) * np.exp(-2 * a * p),
    "sin(w*t)*(1 + t/9)**(p/2) - a": lambda t, a, w, p: np.sin(w * t) * (1 + t / 9) ** (p / 2) - a,
    "tanh(a*sin(w*t))*p": lambda t, a, w, p: np.tanh(a * np.sin(w * t)) * p,
}


def force_of(text: str, values: Mapping[str, float]) -> Forcing:
    """A force whose formula names its parameters."""
    formula = Expression.parse(text, ("t",), values)
    return Forcing(pieces=(ForcingPiece(components=(formula,)),))


def drawn(seed: int) -> tuple[str, dict[str, float], float]:
    chance = random.Random(seed)
    text = sorted(FORCES)[seed % len(FORCES)]
    # 1 and 2 stand in formulas of their own
    values = {
        "a": chance.choice([1.0, 2.0, chance.uniform(0.3, 3.0)]),
        "w": chance.choice([5.0, chance.uniform(1.5, 6.0)]),
        "p": chance.uniform(0.2, 1.5),
    }
    return text, values, chance.choice([20.0, 200.0, 1000.0])


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(12))
def test_forces_with_drawn_numbers_over_long_times(seed):
    text, values, final_time = drawn(seed)

    def family(**given: float) -> Scene:
        return linear_oscillator(final_time=final_time, forcing=force_of(text, given))

    exact = by_integral(FORCES[text], values, final_time)
    n = int((14 if "tanh" in text else 4) * final_time)
    found = by_function(family, "gauss6", n, position_at(final_time), values)
    size = max(map(abs, exact.values()))
    for name in values:
        assert found[name] == pytest.approx(exact[name], rel=1e-8, abs=1e-10 * size), name


def test_named_constants_pieces_and_factors_of_samples():
    values = {"w": 3.0, "c": 0.7, "s": 2.5}
    knots = np.linspace(0.0, 60.0, 241)
    samples = np.cos(1.7 * knots)

    def family(w: float, c: float, s: float) -> Scene:
        first = Expression.parse("sin(w*t)*c**3", ("t",), {"w": w, "c": c})
        sampled = SampledForce.through(knots, samples, "linear")
        later = Expression.parse("e*t/w", ("t",), {"e": c, "w": w})
        pieces = (
            ForcingPiece(components=(first,), until=25.0),
            ForcingPiece(components=(sampled, later), weights=[[s, 1.0]]),
        )
        return linear_oscillator(final_time=60.0, forcing=Forcing(pieces=pieces))

    def force(t: np.ndarray, w: complex, c: complex, s: complex) -> np.ndarray:
        return np.where(t < 25, np.sin(w * t) * c**3, s * np.interp(t, knots, samples) + c * t / w)

    exact = by_integral(force, values, 60.0, edges=(25.0, *knots))
    found = by_function(family, "gauss6", 240, position_at(60.0), values)
    for name in values:
        assert found[name] == pytest.approx(exact[name], rel=1e-8), name


LAGRANGIANS = {
    "vx**2/2 + w**2*cos(x) - c*x**4/4": lambda x, v, t, w, c: -(w**2) * np.sin(x) - c * x**3,
    "vx**2/2 - (x**2 + c)**(w/2)": lambda x, v, t, w, c: -w * x * (x * x + c) ** (w / 2 - 1),
    "vx**2/2 - x**2/2 + x*c*sin(w*t)": lambda x, v, t, w, c: -x + c * np.sin(w * t),
    "w*vx**2/2 - c*x**2/2 - x": lambda x, v, t, w, c: (-c * x - 1) / w,
    "(1 + c*cos(x))*vx**2/2 + w*cos(x)": lambda x, v, t, w, c: (
        (c * np.sin(x) * v * v / 2 - w * np.sin(x)) / (1 + c * np.cos(x))
    ),
}


@spread(few=2, text=sorted(LAGRANGIANS), w=[1.0, 1.83])
def test_parameters_of_lagrangians(text, w):
    values, final_time = {"w": w, "c": 0.45}, 30.0

    def family(**given: float) -> Scene:
        return lagrangian_scene(
            coordinates=["x"],
            lagrangian=text,
            parameters=given,
            initial_position=0.8,
            initial_velocity=0.3,
            final_time=final_time,
        )

    found = by_function(family, "gauss6", 240, position_at(final_time), values)
    force = LAGRANGIANS[text]
    for name, value in values.items():
        given = {**values, name: value + 1j * STEP}
        run = solve_ivp(
            lambda t, y, given=given: np.array([y[1], force(y[0], y[1], t, **given)]),
            (0.0, final_time),
            np.array([0.8 + 0j, 0.3 + 0j]),
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
        )
        exact = run.y[0, -1].imag / STEP
        assert found[name] == pytest.approx(exact, rel=2e-8), name


def test_expressions_with_a_frequency_in_them():
    def family(w: float) -> Scene:
        return linear_oscillator(final_time=1000.0, initial_position=1.0)

    of = quantity_at("x*sin(w*t)", 1000.0)
    found = by_function(family, "gauss6", 4000, of, {"w": 5.0})
    exact = math.cos(1000.0) * 1000.0 * math.cos(5000.0)
    assert found["w"] == pytest.approx(exact, rel=1e-8)


def test_parameters_of_a_configuration_by_name():
    """In the force and in an expression, singular at the start; the control is another number."""
    values = {"w": 2.0, "p": -0.5}

    def problem(**given: float) -> Problem:
        return build_problem(
            {
                "kind": "damped-oscillator",
                "parameters": given,
                "forcing": "0.7*t**p*cos(w*t)",
                "damping": [{"order": 0.5, "coefficient": 0.3}],
                "initial": {"position": 1.0},
                "final_time": 6.0,
            }
        )

    of = quantity_at("x + ax + w*x", 4.3)
    made = by_function(problem, "gauss6", 60, of, values)
    named = gradient(problem(**values), "gauss6", 60, of, ["forcing.w", "forcing.p"])
    for name, value in values.items():
        sides = [
            gradient(problem(**{**values, name: value + h}), "gauss6", 60, of, []).value
            for h in (1e-4, -1e-4)
        ]
        expected = pytest.approx((sides[0] - sides[1]) / 2e-4, rel=1e-6)
        assert made[name] == expected
        assert float(named[f"forcing.{name}"]) == expected
    alone = gradient(problem(**values), "gauss6", 60, quantity_at("x + ax", 4.3), ["forcing.w"])
    assert float(alone["forcing.w"]) != pytest.approx(made["w"], rel=1e-2)
