import math

import pytest

from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.expressions import Expression
from fvi_cli.mathematics.series.power_sum import POWER_SUM_FUNCTIONS, NotAPowerSum, PowerSum


def read(text: str) -> PowerSum:
    value = Expression.parse(text, variables=("t",)).evaluate(
        {"t": PowerSum.variable()}, POWER_SUM_FUNCTIONS
    )
    return PowerSum.lift(value)


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("8", {0.0: 8.0}),
        ("1 - t", {0.0: 1.0, 1.0: -1.0}),
        ("(1 + t)**2 / 4", {0.0: 0.25, 1.0: 0.5, 2.0: 0.25}),
        ("15/4*sqrt(t) + 15/8*sqrt(pi)*t", {0.5: 3.75, 1.0: 1.875 * math.sqrt(math.pi)}),
        ("t**(1/3) * t**(2/3)", {1.0: 1.0}),
        ("t**2.5 / (4*t)", {1.5: 0.25}),
        ("(4*t)**0.5", {0.5: 2.0}),
        ("2**3 * t - sin(1)", {1.0: 8.0, 0.0: -math.sin(1)}),
        ("cbrt(8*t**3)", {1.0: 2.0}),
        ("3 - t - (3 - t)", {}),
    ],
)
def test_sums_of_powers_are_read_off(text, terms):
    found = {e: c for e, c in read(text).terms.items() if c}
    assert found == pytest.approx(terms, rel=1e-15)


@pytest.mark.parametrize("text", ["1/(1 + t)", "sqrt(1 + t)", "2**t", "(1+t)**-1"])
def test_what_leaves_the_sums_is_refused(text):
    with pytest.raises(NotAPowerSum):
        read(text)


def test_other_functions_are_not_there():
    with pytest.raises(ExpressionError, match="sin"):
        read("sin(t)")


def test_shift_is_exact_for_polynomials_only():
    shifted = read("t**3 - 2*t").shifted(3.0)
    assert dict(shifted.terms) == {0.0: 21.0, 1.0: 25.0, 2.0: 9.0, 3.0: 1.0}
    # (t - 1)^8 about 1 is t^8 alone, although its coefficients are large.
    assert dict(read("(t - 1)**8").shifted(1.0).terms) == {8.0: 1.0}
    with pytest.raises(NotAPowerSum):
        read("sqrt(t)").shifted(1.0)


def test_transform():
    assert read("t**3 + 2").transform() == {-4.0: 6.0, -1.0: 2.0}
    with pytest.raises(NotAPowerSum):
        read("1/t").transform()
