"""Ranges of formulas hold every value, and shrink with what they are taken of."""

import numpy as np
import pytest

from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.intervals.functions import Interval

FORMULAS = [
    "x**3 - 2*x + 1/3", "-5*exp(-((x-2)/0.03)**2)", "sin(7*x)*cos(x) - tan(x/9)",
    "1/(x**2 + 0.01)", "x/(3 - x)", "abs(x - 1)*sign(x) + cosh(x)",
    "(x + 5)**1.5 + (x + 5)**(-2) + 2**x", "x**x0 + arctan(x) + tanh(3*x) + sqrt(x + 4)",
    "log(x + 4) + log1p(x + 3) + arcsin(x/9) - arccos(x/9)",
    "gamma(x + 4.5) + arcsinh(x) + cbrt(x) + expm1(x) + arctanh(x/9) + sinh(x)",
]  # fmt: skip


def at(text: str, value: object) -> object:
    formula = Expression.parse(text.replace("x0", "3"), variables=("x",))
    return formula.evaluate({"x": value})


@pytest.mark.parametrize("text", FORMULAS)
def test_every_value_lies_in_the_range(text):
    random = np.random.default_rng(3)
    low = random.uniform(-3.5, 3.5, 200)
    high = low + 10.0 ** random.uniform(-4, 0, 200)
    found = at(text, Interval(low, high))
    assert isinstance(found, Interval)
    inside = low + (high - low) * np.linspace(0, 1, 41)[:, None]
    with np.errstate(all="ignore"):
        values = np.asarray(at(text, inside))
    values = np.where(np.isnan(values), 0.5 * (np.maximum(found.low, -1e300) + found.high), values)
    slack = 1e-12 * (1 + np.abs(values))
    known = np.isfinite(values)
    assert ((values >= found.low - slack) | ~known).all()
    assert ((values <= found.high + slack) | ~known).all()


@pytest.mark.parametrize("text", FORMULAS[:4])
def test_ranges_shrink_to_the_values(text):
    """The control: an enclosure that is always everything would pass the test above."""
    points = np.linspace(-1.0, 2.5, 57)
    narrow = at(text, Interval(points, points + 1e-9))
    assert isinstance(narrow, Interval)
    values = np.asarray(at(text, points))
    assert (narrow.width <= 1e-5 * (1 + np.abs(values))).all()


def test_a_narrow_wall_shows_in_the_range():
    wall = at("-5*exp(-((x-2)/0.003)**2)", Interval(np.array([1.0]), np.array([3.0])))
    assert isinstance(wall, Interval)
    assert wall.low[0] == -5.0
    assert wall.high[0] == pytest.approx(0.0, abs=1e-12)


@np.errstate(divide="ignore")
def test_quotients_and_powers_at_zero():
    around = Interval(np.array([-1.0, 1.0]), np.array([1.0, 2.0]))
    assert around.inverse().low.tolist() == [-np.inf, 0.5]
    assert (around**2).low.tolist() == [0.0, 1.0]
    assert (around**-2).high.tolist() == [np.inf, 1.0]
    assert (around**3).low.tolist() == [-1.0, 1.0]
