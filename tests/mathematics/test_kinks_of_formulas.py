"""min, max, abs and sign as primitives: values, derivatives, series, steps."""

import random

import mpmath
import numpy as np
import pytest

from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.expressions import Expression, slopes_of
from fvi_cli.scenes.lagrangian import lagrangian_scene


def value(text: str, at: float) -> float:
    return float(Expression.parse(text, ("t",)).evaluate({"t": np.array(at)}))


def slope(text: str, at: float) -> float:
    return float(slopes_of(Expression.parse(text, ("t",)), {"t": np.array(at)}, ["t"])["t"])


@pytest.mark.parametrize(
    ("text", "at", "expected", "derivative"),
    [
        ("min(1/t, 5)", 0.0, 5.0, 0.0),
        ("max(log(t), -5)", 0.0, -5.0, 0.0),
        ("min(exp(200*t), 5)", 10.0, 5.0, 0.0),
        ("max(-exp(200*t), -5)", 10.0, -5.0, 0.0),
        ("min(t, 1)", 1e-17, 1e-17, 1.0),
        ("max(t, -1e17)", 3.5, 3.5, 1.0),
        ("min(t, 2, 1/t)", 4.0, 0.25, -1 / 16),
        # at a kink the mean of both sides
        ("min(t, 0)", 0.0, 0.0, 0.5),
        ("max(2*t, 0)", 0.0, 0.0, 1.0),
        ("abs(t)", 0.0, 0.0, 0.0),
        ("sign(t)", 0.0, 0.0, 0.0),
        ("abs(t)", -1e-300, 1e-300, -1.0),
    ],
)
def test_values_and_slopes(text, at, expected, derivative):
    assert value(text, at) == expected
    assert slope(text, at) == derivative


def drawn(chance: random.Random, depth: int) -> str:
    if depth == 0:
        scale = 10.0 ** chance.uniform(-9, 9)
        return chance.choice(["t", f"{chance.choice('+-')}{scale:.3g}", f"t*{scale:.3g}"])
    first, second = drawn(chance, depth - 1), drawn(chance, depth - 1)
    shape = chance.choice(
        ["min({}, {})", "max({}, {})", "abs({} - {})", "({})*sign({})", "{} + {}", "arctan({})*{}"]
    )
    return shape.format(first, second)


PRECISE = {
    "min": lambda a, b: min(mpmath.mpf(a), mpmath.mpf(b)),
    "max": lambda a, b: max(mpmath.mpf(a), mpmath.mpf(b)),
    "abs": abs,
    "sign": mpmath.sign,
    "arctan": mpmath.atan,
}


@pytest.mark.parametrize("seed", range(40))
def test_drawn_formulas_agree_with_50_digits(seed):
    """Values, and slopes between kinks."""
    chance = random.Random(seed)
    text, at = drawn(chance, 3), chance.choice((-1, 1)) * 10.0 ** chance.uniform(-9, 9)
    formula = Expression.parse(text, ("t",))
    with mpmath.workdps(60):

        def precise(t: object) -> object:
            return formula.evaluate({"t": t}, PRECISE)

        exact = float(precise(mpmath.mpf(at)))
        h = mpmath.mpf(abs(at)) / 10**25
        sides = [float((precise(at + s * h) - precise(mpmath.mpf(at))) / (s * h)) for s in (1, -1)]
    size = sum(abs(float(x)) for x in (exact, at)) + 1e-300
    assert value(text, at) == pytest.approx(exact, rel=1e-7, abs=1e-12 * size)
    found = slope(text, at)
    if sides[0] == pytest.approx(sides[1], rel=1e-9, abs=1e-20):
        assert found == pytest.approx(sides[0], rel=1e-6, abs=1e-9 * max(map(abs, sides)))


def test_a_force_that_overflows_where_it_is_not_taken_ends_no_run():
    """V = -5 x beyond a wall of exp(200 x): the motion is a parabola with x'' = -200 or 5."""
    scene = lagrangian_scene(
        coordinates=["x"],
        lagrangian="0.5*vx**2 + min(exp(200*(x - 4)), 5*x)",
        initial_position=5.0,
        final_time=2.0,
    )
    found = integrate(scene, Method(cq="gauss", degree=2), 32)
    assert found.status == "ok"
    assert found.position[-1, 0] == pytest.approx(15.0, rel=1e-12)
