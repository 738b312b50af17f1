"""Power series with real exponents: arithmetic, functions, what is known, and what is refused."""

import math
from dataclasses import replace

import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from fvi_cli.mathematics.algebra.arithmetic import NUMPY_FUNCTIONS
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.series.power_series import (
    PowerSeries,
    expand,
)
from fvi_cli.mathematics.series.terms import merged_terms


def series(terms: dict[float, float], cutoff: float) -> PowerSeries:
    return PowerSeries(
        exponents=np.array(list(terms)), coefficients=np.array(list(terms.values())), cutoff=cutoff
    )


def truncated(whole: PowerSeries, cutoff: float) -> PowerSeries:
    return replace(whole, cutoff=min(cutoff, whole.cutoff))


def expansion(text: str, cutoff: float = 4.0, at: float = 0.0) -> PowerSeries:
    return expand(Expression.parse(text, ("t",)), cutoff, at)


EXPANDABLE = [
    "15/4*sqrt(t) + 15/8*sqrt(pi)*t + t**2.5", "sin(t)/t", "exp(sqrt(t))*cos(t**0.3)",
    "1/(1 + t**0.7)", "(1 + t**0.5)**-0.3", "t**-0.5 + cbrt(t)", "cbrt(-t - t**2)",
    "abs(sin(t) - t**0.9)", "sign(t - 1)*t", "tan(1 + t)", "tanh(sqrt(t) - 3)",
    "sinh(t)*cosh(1 - t)", "arcsin(t/2 + 0.3) + arccos(t/2)", "arctan(1 + 2*sqrt(t))",
    "arcsinh(3*t - 1)", "arccosh(2 + t)", "arctanh(0.5 - t)",
    "log(2 + t) + log1p(sqrt(t)) + expm1(t)", "2**t", "(2 + t)**sqrt(t)",
    "(t - 1)**3 + (1 + t)**20 + (1 + t)**-2", "t**0.01*sin(t)",
    "arccos(1 - t)", "arccosh(1 + sqrt(t))", "arcsin(1 - t**1.5)*t",
]  # fmt: skip


@pytest.mark.parametrize("text", EXPANDABLE)
def test_the_rest_of_an_expansion_falls_as_the_cutoff_says(text):
    """Against the formula itself; too small a power of t in the rest would show as a slope."""
    found = expansion(text)
    assert found.cutoff == 4.0
    expression = Expression.parse(text, ("t",))
    times = np.array([2e-3, 1e-3])
    exact = np.asarray(expression.evaluate({"t": times}))
    sizes = np.abs(found.coefficients).max()
    assert np.all(np.abs(found(times) - exact) <= 1e7 * sizes * times**4 + 1e-14 * sizes)
    # The control: without its last term the expansion is worse.
    if found.exponents.size > 1 and found.exponents[-1] < 2.6:
        shorter = truncated(found, found.exponents[-1])
        assert abs(shorter(times[0]) - exact[0]) > 10 * abs(found(times[0]) - exact[0])


@pytest.mark.parametrize(
    ("text", "at"),
    [("exp(-t)*sqrt(t)", 2.25), ("1/(t - 3)", 1.0), ("t**2.5", 1.0), ("tan(t)*gamma(5)", 0.4)],
)
def test_expansion_at_another_point_is_the_taylor_series(text, at):
    found = expansion(text, 8.0, at)
    functions = {"exp": mpmath.exp, "sqrt": mpmath.sqrt, "tan": mpmath.tan}
    expression = Expression.parse(text, ("t",))
    with mpmath.workdps(40):
        exact = mpmath.taylor(lambda t: expression.evaluate({"t": t}, functions), at, 7)
    np.testing.assert_array_equal(found.exponents, np.arange(8.0))
    np.testing.assert_allclose(found.coefficients, [float(c) for c in exact], rtol=2e-13)


@pytest.mark.parametrize(
    "name",
    [
        "exp", "expm1", "log", "sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsin", "arccos",
        "arctan", "arcsinh", "arccosh", "arctanh",
    ],
)  # fmt: skip
def test_taylor_coefficients_agree_with_extended_precision(name):
    at = 1.375 if name == "arccosh" else 0.375
    reference = getattr(mpmath, name.replace("arc", "a"))
    with mpmath.workdps(60):
        exact = [float(c) for c in mpmath.taylor(reference, at, 9)]
    found = expansion(f"{name}(t)", 10.0, at)
    np.testing.assert_allclose(found.coefficients, exact, rtol=5e-13, atol=1e-15)


def test_every_function_of_expressions_is_known():
    for name, function in NUMPY_FUNCTIONS.items():
        near = PowerSeries.variable(2.0, 1.5 if name == "arccosh" else 0.5)
        if name != "gamma":
            assert function(near, 1.0) if name in ("min", "max") else function(near)


def test_exponents_are_matched_with_a_tolerance_and_integers_restored():
    found = series({0.1 + 0.2: 1.0, 0.3: 2.0, 2.9999999999999: 1.0, -0.5: 3.0}, 4.0)
    np.testing.assert_allclose(found.exponents, [-0.5, 0.3, 3.0], atol=1e-15)
    assert found.exponents[2] == 3.0
    np.testing.assert_array_equal(found.coefficients, [3, 3, 1])
    assert found.coefficient(0.3) == 3.0
    assert found.coefficient(0.4) == 0.0


def test_round_off_of_a_cancellation_is_no_term_but_a_small_term_is():
    residue = 0.1 + 0.2 - 0.3
    assert residue != 0
    cancelled = series({1.0: 0.1}, 4.0) + series({1.0: 0.2}, 4.0) - series({1.0: 0.3}, 4.0)
    assert cancelled.exponents.size == 0
    assert (series({1.0: 1e-30}, 4.0) + 1.0).coefficient(1.0) == 1e-30


def test_a_result_claims_no_more_than_its_operands_determine():
    a, b = series({-0.5: 1.0, 1.0: 2.0}, 3.0), series({1.0: 1.0}, 3.5)
    assert (a + b).cutoff == 3.0
    assert (a * b).cutoff == 3.0
    assert (b / a).cutoff == 4.0
    assert (a * a).cutoff == 2.5
    assert a.fractional_derivative(0.75).cutoff == 2.25
    assert a.fractional_derivative(-1.0).cutoff == 4.0
    assert (b**0.5).cutoff == 3.0
    assert PowerSeries.variable(3.0)(2.0) == 2.0


def test_exact_sums_stay_exact_until_a_function_needs_a_cutoff():
    t = PowerSeries.variable(math.inf)
    cube = (1 + t) ** 3
    np.testing.assert_array_equal(cube.coefficients, [1, 3, 3, 1])
    assert math.isinf(cube.cutoff)


def test_fractional_derivative_by_the_power_rule():
    with mpmath.workdps(30):
        for sigma in (-0.5, 0.0, 0.3, 1.0, 2.5, 7.75):
            for order in (-1.5, -1.0, 0.5, 1.0, 1.25, 1.9):
                found = series({sigma: 1.0}, 200.0).fractional_derivative(order)
                exact = float(mpmath.gammaprod([sigma + 1], [sigma + 1 - order]))
                if exact == 0:
                    assert found.exponents.size == 0
                else:
                    assert found.coefficient(sigma - order) == pytest.approx(exact, rel=2e-15)


def test_derivatives_compose():
    a = expansion("exp(t) + t**1.5", 6.0)
    half = a.fractional_derivative(0.5)
    # D^{1/2} D^{1/2} = D only where the half derivative has no term t**-1/2 that is lost.
    for left, right in [
        (a.fractional_derivative(-0.5).fractional_derivative(0.5), a),
        (half.fractional_derivative(-0.5), a),
        (a.fractional_derivative(-1.0).derivative(), a),
        (
            a.without_initial_terms(1).fractional_derivative(0.5).fractional_derivative(0.5),
            a.derivative(),
        ),
    ]:
        common = min(left.cutoff, right.cutoff)
        np.testing.assert_allclose(
            truncated(left, common).coefficients, truncated(right, common).coefficients, rtol=1e-13
        )
    assert a.without_initial_terms(0.5).coefficient(0.0) == 0.0
    assert a.without_initial_terms(0.5).coefficient(1.0) == 1.0
    assert a.without_initial_terms(1.5).coefficient(1.0) == 0.0
    assert a.without_initial_terms(1.5).coefficient(1.5) == 1.0


def test_evaluation_at_zero():
    assert series({0.0: 2.0, 0.5: 1.0}, 3.0)(0.0) == 2.0
    assert series({-0.5: 2.0}, 3.0)(0.0) == np.inf
    np.testing.assert_array_equal(series({}, 3.0)(np.ones((2, 3))), np.zeros((2, 3)))


def test_numbers_may_stand_on_either_side():
    t = PowerSeries.variable(3.0)
    for number in (2, 2.0, np.float64(2.0)):
        assert (number + t).coefficient(0.0) == 2.0
        assert (number - t).coefficient(1.0) == -1.0
        assert (number * t).coefficient(1.0) == 2.0
        assert (t / number).coefficient(1.0) == 0.5
        assert (number / (1 + t)).coefficient(1.0) == -2.0
        assert (number**t).coefficient(1.0) == pytest.approx(math.log(2))
    assert "t**1" in repr(t)


def test_merging_keeps_further_axes():
    exponents, coefficients = merged_terms(
        np.array([1.0, 0.0, 1.0]), np.array([[1.0, 2], [3, 4], [-1, 5]]), 2.0
    )
    np.testing.assert_array_equal(exponents, [0, 1])
    np.testing.assert_array_equal(coefficients, [[3, 4], [0, 7]])


lattices = st.dictionaries(
    st.sampled_from([0.0, 0.3, 0.5, 1.0, 1.3, 2.0, 2.5]),
    st.floats(-3, 3, allow_nan=False).filter(lambda c: abs(c) > 1e-3),
    max_size=4,
)


@settings(max_examples=100, deadline=None)
@given(lattices, lattices, lattices)
def test_ring_laws(a, b, c):
    x, y, z = (series(terms, 3.0) for terms in (a, b, c))
    for left, right in [
        ((x + y) + z, x + (y + z)),
        (x * y, y * x),
        (x * (y + z), x * y + x * z),
        ((x * y) * z, x * (y * z)),
    ]:
        common = min(left.cutoff, right.cutoff)
        difference = truncated(left - right, common)
        assert np.all(np.abs(difference.coefficients) < 1e-12)


@settings(max_examples=100, deadline=None)
@given(lattices.filter(bool), st.sampled_from([-2, -1, 2, 3, 0.5, -0.7, 1.5]))
def test_powers_invert_each_other(terms, exponent):
    terms = {k: abs(v) for k, v in terms.items()}
    lead = min(terms)
    terms = {k: v if k == lead else v * terms[lead] / 9 for k, v in terms.items()}
    x = series(terms, 4.0)
    back = (x**exponent) ** (1 / exponent)
    assume(back.cutoff > lead)
    difference = truncated(back - x, min(back.cutoff, 4.0))
    assert np.all(np.abs(difference.coefficients) < 1e-9 * terms[lead])
