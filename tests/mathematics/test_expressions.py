"""Expressions: what is understood, what is refused and where, and that nothing is ever executed."""

import pickle

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import FUNCTION_NAMES, Expression

TIMES = np.array([0.0, 0.25, 1.0, 3.0])


def at_times(text: str) -> np.ndarray:
    return np.asarray(Expression.parse(text, ("t",)).evaluate({"t": TIMES}))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t**2.5", TIMES**2.5),
        ("15/4*sqrt(t) + 15/8*sqrt(pi)*t", 3.75 * TIMES**0.5 + 1.875 * np.pi**0.5 * TIMES),
        ("-t**2", -(TIMES**2)),
        ("2**-1*t", TIMES / 2),
        ("t - 1 - 2", TIMES - 3),
        ("t/2/4", TIMES / 8),
        ("2**3**2", np.float64(512)),
        ("+t*-2", -2 * TIMES),
        ("  exp(\n -t ) ", np.exp(-TIMES)),
        ("asin(t/4) + arcsin(t/4)", 2 * np.arcsin(TIMES / 4)),
        ("gamma(5)*gamma(t + 1)", 24 * np.array([1, 0.906402477055477, 1, 6])),
        ("abs(t - 1)*sign(t - 1)", TIMES - 1),
        ("max(0, t - 1, 2 - t)", np.maximum(np.maximum(0, TIMES - 1), 2 - TIMES)),
        ("min(t, 2)**2 + max(2, 3) - min(4, -1)", np.minimum(TIMES, 2) ** 2 + 4),
        ("e**t", np.exp(TIMES)),
    ],
)
def test_value(text, expected):
    np.testing.assert_allclose(at_times(text), expected, rtol=1e-14)


def test_every_function_agrees_with_extended_precision():
    special = {"arcsin": "asin", "arccos": "acos", "arctan": "atan", "abs": "fabs"}
    special |= {"arcsinh": "asinh", "arccosh": "acosh", "arctanh": "atanh", "ln": "log"}
    for name in sorted(FUNCTION_NAMES - {"min", "max"}):
        at = 1.25 if "cosh" in name else 0.375
        value = Expression.parse(f"{name}(t)", ("t",)).evaluate({"t": at})
        reference = getattr(mpmath, special.get(name, name))(at)
        assert value == pytest.approx(float(reference), rel=1e-15), name
        folded = Expression.parse(f"{name}({at})")
        assert folded.evaluate({}, {}) == value
        assert not folded.names


def test_numbers_stand_for_themselves():
    for number in (3, 0.1, -2.5, 1e-300):
        assert Expression.parse(number).evaluate({}, {}) == number
    for wrong in (float("inf"), float("nan"), 10**400, True, None, [1]):
        with pytest.raises(ExpressionError):
            Expression.parse(wrong)


def test_names_constants_and_equality():
    expression = Expression.parse("a*sin(x) + 0*y", ("x", "y", "z"), {"a": 2.0})
    assert expression.names == {"x", "y"}
    assert expression.functions == {"sin"}
    assert expression.evaluate({"x": 1.0, "y": 0.0}, {}) == 2 * np.sin(1.0)
    again = Expression.parse("a*sin(x) + 0*y", ("x", "y", "z"), {"a": 2.0})
    assert expression == again
    assert hash(expression) == hash(again)
    assert expression != Expression.parse("a*sin(x) + 0*y", ("x", "y", "z"), {"a": 3.0})
    assert expression != Expression.parse("a*sin(x)+0*y", ("x", "y", "z"), {"a": 2.0})
    assert pickle.loads(pickle.dumps(expression)) == expression
    with pytest.raises(ExpressionError, match="no value was given for the variable 'y'"):
        expression.evaluate({"x": 1.0}, {})


def test_singular_values_neither_warn_nor_raise():
    np.testing.assert_array_equal(at_times("t**0.5")[0], 0.0)
    assert at_times("t**-0.5")[0] == np.inf
    assert at_times("log(t)")[0] == -np.inf
    assert np.isnan(at_times("(t - 1)**0.5")[0])
    assert np.isnan(Expression.parse("t**0.5", ("t",)).evaluate({"t": -1.0}, {}))
    assert Expression.parse("1/t", ("t",)).evaluate({"t": 0}, {}) == np.inf
    integers = Expression.parse("t**-1", ("t",)).evaluate({"t": np.array([1, 2])})
    np.testing.assert_array_equal(integers, [1, 0.5])


ATTACKS = [
    "__import__('os').system('true')",
    "().__class__.__bases__[0].__subclasses__()",
    "(lambda: t)()",
    "[t for t in (1,)]",
    "not t",
    "t[0]",
    "None",
    "eval(t)",
    "sin.func(t)",
    "sin(x=t)",
    "t\\",
    "\x00",
    "ｔ + 1",
    "t" * 20_000,
    "9" * 5_000,
    "-" * 9_990 + "t",
    "(" * 250 + "t" + ")" * 250,
    "t**" * 3_000 + "t",
    "sin(" * 99 + "t" + ")" * 98,
    "t*0." + "9" * 9_000 + "e",
    "0777",
]


@pytest.mark.parametrize("text", ATTACKS, ids=range(len(ATTACKS)))
def test_attacks_are_refused(text):
    with pytest.raises(ExpressionError):
        Expression.parse(text, ("t",))


@pytest.mark.parametrize("name", ["sin", "asin", "pi", "lambda", "1x", "x y", "ü", ""])
def test_variables_with_another_meaning_are_refused(name):
    with pytest.raises(ExpressionError):
        Expression.parse("1", (name,))
    with pytest.raises(ExpressionError):
        Expression.parse("1", (), {name: 1.0})


def test_a_variable_may_hide_eulers_number_only_by_declaration():
    assert Expression.parse("e", ("e",)).evaluate({"e": 0.5}, {}) == 0.5
    assert Expression.parse("e", (), {"e": 0.25}).evaluate({}, {}) == 0.25
    with pytest.raises(ExpressionError, match="meaning here already"):
        Expression.parse("e", ("e",), {"e": 1.0})


@settings(max_examples=100, deadline=None)
@given(st.text(alphabet="t0123456789.e+-*/() ,sincoqrtlgx_", max_size=40) | st.text(max_size=20))
def test_any_text_is_understood_or_refused(text):
    try:
        expression = Expression.parse(text, ("t",))
    except ExpressionError as error:
        column = 1 if error.column is None else error.column
    else:
        column = 1
        value = expression.evaluate({"t": TIMES})
        assert np.broadcast_to(np.asarray(value), TIMES.shape).dtype == float
    assert 1 <= column <= len(text) + 1


@st.composite
def formulas(draw: st.DrawFn, depth: int = 3) -> str:
    if depth == 0 or draw(st.booleans()):
        return draw(st.sampled_from(["t", "2", "0.5", "pi", "7"]))
    left, right = draw(formulas(depth - 1)), draw(formulas(depth - 1))
    shape = draw(st.sampled_from(["({}+{})", "({}-{})", "({}*{})", "(sin({})/(2+cos({})))"]))
    return shape.format(left, right)


@settings(max_examples=100, deadline=None)
@given(formulas())
def test_agrees_with_pythons_own_arithmetic(text):
    names = {"t": TIMES, "pi": np.pi, "sin": np.sin, "cos": np.cos}
    expected = eval(text, {"__builtins__": {}}, names)
    np.testing.assert_allclose(
        np.broadcast_to(at_times(text), TIMES.shape),
        np.broadcast_to(expected, TIMES.shape),
        rtol=1e-13,
        atol=1e-13,
    )
