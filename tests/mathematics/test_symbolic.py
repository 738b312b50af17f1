"""Symbolic derivatives and the programs made of them."""

import mpmath
import numpy as np
import pytest

from fvi_cli.mathematics import symbolic
from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS, ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.series.power_series import SERIES_FUNCTIONS, PowerSeries

NAMES = ("x", "y")
TEXTS = [
    "x*y - 3*x**2/7 + 2", "sin(x)*cos(y)*exp(-x*y)", "sqrt(x**2 + y**2)", "x**y + y**-2.5",
    "(2*x - y)**3/(1 + x*y)", "tanh(x)*log1p(y) - expm1(x/2)",
    "arctan(x/y) + arcsinh(x) - arcsin(x/4)", "cbrt(x) + abs(y - 5)**1.5",
    "tan(x/3)*sinh(y) - cosh(x)*log(y)", "-x/y/2", "x", "3",
]  # fmt: skip


def tree(text: str) -> symbolic.Symbolic:
    return symbolic.symbolic(Expression.parse(text, variables=NAMES))


@pytest.mark.parametrize("text", TEXTS)
def test_a_formula_survives_both_ways_out(text):
    values = {"x": np.array([0.7, 1.3, 2.9]), "y": np.array([0.4, 2.2, 1.1])}
    direct = Expression.parse(text, variables=NAMES).evaluate(values, NUMPY_FUNCTIONS)
    (program,) = symbolic.compile_formulas([tree(text)]).evaluate(values, NUMPY_FUNCTIONS)
    again = symbolic.as_expression(tree(text), NAMES)
    assert program == pytest.approx(direct, rel=1e-14)
    assert again.evaluate(values, NUMPY_FUNCTIONS) == pytest.approx(direct, rel=1e-14)


@pytest.mark.parametrize("text", TEXTS)
def test_derivatives_are_those_of_50_digits(text):
    (derivative,) = symbolic.compile_formulas([tree(text).diff(symbolic.symbol("x"))]).evaluate(
        {"x": np.array([1.3]), "y": np.array([2.2])}, NUMPY_FUNCTIONS
    )
    functions = {
        "sqrt": mpmath.sqrt,
        "cbrt": mpmath.cbrt,
        "exp": mpmath.exp,
        "expm1": mpmath.expm1,
        "log": mpmath.log,
        "log1p": lambda v: mpmath.log(1 + v),
        "sin": mpmath.sin,
        "cos": mpmath.cos,
        "tan": mpmath.tan,
        "sinh": mpmath.sinh,
        "cosh": mpmath.cosh,
        "tanh": mpmath.tanh,
        "arcsin": mpmath.asin,
        "arctan": mpmath.atan,
        "arcsinh": mpmath.asinh,
        "abs": abs,
    }
    expression = Expression.parse(text, variables=NAMES)
    with mpmath.workdps(50):
        y = mpmath.mpf(2.2)
        expected = mpmath.diff(lambda x: expression.evaluate({"x": x, "y": y}, functions), 1.3)
    assert np.broadcast_to(derivative, 1)[0] == pytest.approx(float(expected), rel=1e-13, abs=1e-14)


def test_equal_parts_are_computed_once():
    x = symbolic.symbol("x")
    formula = tree("sin(x*y)*exp(sin(x*y))")
    program = symbolic.compile_formulas([formula, formula.diff(x), formula.diff(x, x)])
    calls = [str(kind) for kind, *_ in program.instructions if kind in NUMPY_FUNCTIONS]
    assert sorted(calls) == ["cos", "exp", "sin"]


def test_programs_work_on_power_series():
    t = PowerSeries.variable(6.0)
    (value,) = symbolic.compile_formulas([tree("sin(x)/(1 + y**2)")]).evaluate(
        {"x": t, "y": t**1.5}, SERIES_FUNCTIONS
    )
    assert isinstance(value, PowerSeries)
    at = np.array(0.1)
    assert value(at) == pytest.approx(np.sin(0.1) / 1.001, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "number"),
    [("(cos(x)*y)**2 + (sin(x)*y)**2 - y**2 + 3", 3.0), ("(x + y)**2 - x**2 - y**2 - 2*x*y", 0.0)],
)
def test_variables_that_drop_out_are_seen_to(text, number):
    assert symbolic.constant(symbolic.settled(tree(text))) == pytest.approx(number, abs=1e-14)


def test_a_variable_that_stays_is_no_constant():
    assert symbolic.constant(symbolic.settled(tree("(x + y)**2 - x**2"))) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gamma(x)", "cannot be differentiated"),
        ("x/(1 - 1*1)", "divides by zero"),
        ("((2*x)**9000)**9000", "not a finite real number"),
    ],
)
def test_what_has_no_real_derivative_is_refused(text, message):
    with pytest.raises(ExpressionError, match=message):
        symbolic.compile_formulas([tree(text)])


def test_huge_powers_are_not_multiplied_out():
    # at once, without integers of a billion digits
    formula = tree("(x + 2*y)**900000")
    assert symbolic.settled(formula) == formula


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sin(" * 60 + "x" + ")" * 60, "nested more than 24 deep"),
        ("*".join(f"(x + {k}*y)" for k in range(40)), "more than 16 factors"),
        (" + ".join(f"sin({k}*x)*cos({k}*y)" for k in range(400)), "more than 3000"),
    ],
)
def test_formulas_that_would_explode_are_refused(text, message):
    with pytest.raises(ExpressionError, match=message):
        tree(text)
