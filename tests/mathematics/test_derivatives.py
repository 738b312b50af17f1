"""Derivatives of formulas against 50 digits, and the programs made of them."""

import mpmath
import numpy as np
import pytest

from fvi_cli.mathematics.algebra import builder
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.algebra.builder import Builder, derivatives
from fvi_cli.mathematics.algebra.formulas import FormulaSystem
from fvi_cli.mathematics.expressions import FUNCTION_NAMES, Expression

NAMES = ("x", "y")
TEXTS = [
    "x*y - 3*x**2/7 + 2", "sin(x)*cos(y)*exp(-x*y)", "sqrt(x**2 + y**2)", "x**y + y**-2.5",
    "(2*x - y)**3/(1 + x*y)", "tanh(x)*log1p(y) - expm1(x/2)",
    "arctan(x/y) + arcsinh(x) - arcsin(x/4)", "cbrt(x) + abs(y - 5)**1.5 + gamma(y)/gamma(7)",
    "tan(x/3)*sinh(y) - cosh(x)*log(y)", "-x/y/2", "x", "3", "arccosh(y + x) + arctanh(x/7)",
    "min(x*y, exp(x)) + max(sin(y), x)**2", "arccos(x/5)*sign(x - y)", "2**x + x**(y/2)",
]  # fmt: skip
PRECISE = {
    "arcsin": mpmath.asin, "arccos": mpmath.acos, "arctan": mpmath.atan, "arcsinh": mpmath.asinh,
    "arccosh": mpmath.acosh, "arctanh": mpmath.atanh, "abs": abs, "min": min, "max": max,
} | {
    name: getattr(mpmath, name)
    for name in sorted(FUNCTION_NAMES)
    if hasattr(mpmath, name) and name not in ("arg",)
}  # fmt: skip


def system(text: str) -> FormulaSystem:
    return Expression.parse(text, variables=NAMES).system


@pytest.mark.parametrize("text", TEXTS)
def test_first_and_second_derivatives_are_those_of_50_digits(text):
    first = derivatives(system(text), [{"x": 1.0}, {"y": 1.0}])
    at = {"x": np.array([1.3, 1.7]), "y": np.array([2.2, 0.9])}
    found = first.evaluate(at)
    has_gamma = "gamma" in text
    if not has_gamma:
        second = derivatives(first[1:], [{"x": 1.0}, {"y": 1.0}])
        found += second.evaluate(at)[2:]
    expression = Expression.parse(text, variables=NAMES)
    orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (1, 1), (0, 2)]
    with mpmath.workdps(50):

        def value(x: object, y: object) -> object:
            return mpmath.mpf(1) * expression.evaluate({"x": x, "y": y}, PRECISE)

        for numbers, order in zip(found, orders, strict=False):
            for index, (x, y) in enumerate(zip(at["x"], at["y"], strict=True)):
                place = (mpmath.mpf(float(x)), mpmath.mpf(float(y)))
                exact = float(mpmath.diff(value, place, order) if any(order) else value(*place))
                one = np.broadcast_to(numbers, 2)[index]
                assert one == pytest.approx(exact, rel=1e-12, abs=1e-13), order


def test_the_control_notices_a_wrong_derivative():
    (_, wrong) = derivatives(system("sin(x)"), [{"x": 1.0 + 1e-9}]).evaluate({"x": 1.3})
    assert wrong != pytest.approx(np.cos(1.3), rel=1e-12)


def test_only_nodes_of_the_list_become_source():
    """The control of what is compiled: whatever else stands in a program is refused."""
    own = Builder()
    x = own.variable("x")
    for kind in ("__import__", "eval", "x); import os; (", "lambda", "globals"):
        crafted = FormulaSystem((("variable", "x"), (kind, 0)), (1,))
        with pytest.raises(ExpressionError, match="not a node of a formula"):
            crafted.evaluate({"x": 1.0})
    # names of variables are places in a list of arguments, whatever they look like
    odd = FormulaSystem((("variable", "__import__('os')"), ("sin", 0)), (1,))
    assert odd.evaluate({"__import__('os')": 0.5}) == [np.sin(0.5)]
    assert own.system([x("sin")]).evaluate({"x": 0.5}) == [np.sin(0.5)]


def test_hundreds_of_terms_are_differentiated_twice():
    """Programs know no depth: a chain of 40 masses with hardening springs, 1,600 second ones."""
    names = [f"x{k}" for k in range(40)]
    text = " + ".join(f"(x{k + 1} - x{k})**2/2 + (x{k + 1} - x{k})**4/4" for k in range(39))
    formula = Expression.parse(text, variables=names).system
    along = [{name: 1.0} for name in names]
    second = derivatives(derivatives(formula, along)[1:], along)[40:]
    place = dict.fromkeys(names, 0.0) | {"x7": 0.5}
    matrix = np.array(second.evaluate(place)).reshape(40, 40)
    assert np.array_equal(matrix, matrix.T)
    assert matrix[7, 7] == pytest.approx(2 * (1 + 3 * 0.25))
    assert matrix[7, 8] == pytest.approx(-(1 + 3 * 0.25))
    assert matrix[20, 20] == 2.0


def test_derivatives_that_would_explode_are_refused(monkeypatch):
    names = [f"x{k}" for k in range(12)]
    text = " + ".join(f"sin({' + '.join(f'{j + k}*x{k}' for k in range(12))})" for j in range(9))
    along = [{name: 1.0} for name in names]
    formula = Expression.parse(text, variables=names).system
    assert len(derivatives(derivatives(formula, along)[1:], along).outputs) == 12 * 13
    monkeypatch.setattr(builder, "MOST_INSTRUCTIONS", 1_000)
    with pytest.raises(ExpressionError, match="too long: with its derivatives more than 1000 op"):
        derivatives(derivatives(formula, along)[1:], along)
