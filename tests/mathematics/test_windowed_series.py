"""Windowed powers and their fractional derivatives against 50-digit arithmetic."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from fvi_cli.mathematics.graded_panels import tabulated
from fvi_cli.mathematics.power_series import PowerSeries
from fvi_cli.mathematics.windowed_series import WindowedSeries

DECAY = 0.625
SCALED_TIMES = np.array([1e-12, 1e-8, 1e-4, 1e-2, 0.3, 1.0, 4.0, 11.0, 27.0, 45.0, 1e2, 1e3, 1e4])


def single(exponent: float, decay: float = DECAY) -> WindowedSeries:
    return WindowedSeries(
        exponents=np.array([exponent]), coefficients=np.array([[1.0]]), decay=decay
    )


def reference(sigma: float, order: float, t: float, *, caputo: bool, decay: float = DECAY) -> float:
    """Power rule on the Taylor series of the window; its asymptotic form far away."""
    s, g, time = mpmath.mpf(sigma), mpmath.mpf(order), mpmath.mpf(t)
    z = decay * time
    first = 0
    if caputo and sigma == int(sigma):
        first = max(0, math.ceil(order) - int(sigma))
    if z <= 100:
        with mpmath.workdps(120):
            total = mpmath.mpf(0)
            for k in range(first, 60 + 5 * int(z)):
                ratio = mpmath.gammaprod([s + k + 1], [s + k + 1 - g])
                total += (-z) ** k / mpmath.factorial(k) * ratio
            return total * time ** (s - g)
    with mpmath.workdps(50):
        value = mpmath.gammaprod([s + 1], [s + 1 - g]) * time ** (s - g)
        value *= mpmath.hyp1f1(s + 1, s + 1 - g, -z)
        for k in range(first):
            ratio = mpmath.gammaprod([s + k + 1], [s + k + 1 - g])
            value -= (-z) ** k / mpmath.factorial(k) * ratio * time ** (s - g)
        return value


@pytest.mark.parametrize("order", [0.05, 0.5, 0.999, 1.001, 1.5, 1.95])
@pytest.mark.parametrize("kind", ["caputo", "riemann-liouville"])
def test_fractional_derivative_of_a_windowed_power(order: float, kind: str) -> None:
    times = SCALED_TIMES / DECAY
    for sigma in (0.0, 1.0, 2 - order / 2, 2.0, 3.5, 9.0):
        found = single(sigma).fractional_derivative(times, order, kind)[:, 0]
        exact = [reference(sigma, order, t, caputo=kind == "caputo") for t in times]
        for value, number in zip(found, exact, strict=True):
            # Where the exponential gives way to the algebraic tail the value is tiny or changes
            # its sign; there the error is measured on the scale of the function.
            scale = DECAY ** (order - sigma) * max(1.0, (sigma / math.e) ** sigma)
            assert abs(value - number) <= 2e-13 * abs(number) + 1e-15 * scale


def test_the_special_forms_are_needed() -> None:
    """Control: subtracting the initial term afterwards loses most digits at small t."""
    t, order = 1e-8, 1.5
    exact = reference(0.0, order, t, caputo=True)
    naive = single(0.0).fractional_derivative(t, order, "riemann-liouville")[0]
    naive -= t**-order / math.gamma(1 - order) - DECAY * t ** (1 - order) / math.gamma(2 - order)
    good = single(0.0).fractional_derivative(t, order, "caputo")[0]
    assert abs(good / float(exact) - 1) < 1e-14
    assert abs(naive / float(exact) - 1) > 1e-5


def test_poles_of_the_general_form() -> None:
    for sigma, order in [(0.5, 1.5), (-0.5, 0.5), (-0.25, 1.75)]:
        found = single(sigma).fractional_derivative(SCALED_TIMES, order, "caputo")[:, 0]
        exact = [float(reference(sigma, order, t, caputo=False)) for t in SCALED_TIMES[:10]]
        np.testing.assert_allclose(found[:10], exact, rtol=1e-12)


def test_without_decay_it_is_the_power_rule() -> None:
    times = np.array([1e-3, 0.7, 5.0])
    for sigma, order in [(2.5, 1.5), (1.0, 0.5), (3.0, 1.25)]:
        found = single(sigma, 0.0).fractional_derivative(times, order, "caputo")[:, 0]
        ratio = math.gamma(sigma + 1) / math.gamma(sigma + 1 - order)
        np.testing.assert_allclose(found, ratio * times ** (sigma - order), rtol=1e-14)


def combination() -> WindowedSeries:
    return WindowedSeries(
        exponents=np.array([0.0, 1.0, 1.5, 2.75, 4.0]),
        coefficients=np.array([[1.0, 0], [0.5, -1], [2, 0.25], [-1, 1], [0.125, 3]]),
        decay=1.5,
    )


def test_ordinary_derivatives() -> None:
    window = combination()

    def component(t: mpmath.mpf, index: int) -> mpmath.mpf:
        powers = [t ** mpmath.mpf(s) for s in window.exponents]
        total = mpmath.fdot(powers, [mpmath.mpf(c) for c in window.coefficients[:, index]])
        return total * mpmath.exp(-window.decay * t)

    times = [0.01, 0.5, 3.0, 20.0]
    with mpmath.workdps(40):
        for n, values in enumerate(
            (window.position(times), window.velocity(times), window.acceleration(times))
        ):
            for t, row in zip(times, values, strict=True):
                for index in range(2):
                    exact = mpmath.diff(lambda u, i=index: component(u, i), mpmath.mpf(t), n)
                    assert row[index] == pytest.approx(float(exact), rel=1e-13, abs=1e-16)
    np.testing.assert_array_equal(
        window.fractional_derivative(times, 1.0, "caputo"), window.velocity(times)
    )


def test_values_at_zero() -> None:
    window = combination()
    np.testing.assert_array_equal(window.position(0.0), [1, 0])
    np.testing.assert_array_equal(window.velocity(0.0), [0.5 - 1.5, -1])
    np.testing.assert_array_equal(np.abs(window.acceleration(0.0)), [np.inf, np.inf])
    np.testing.assert_array_equal(window.fractional_derivative(0.0, 0.5, "caputo"), [0, 0])
    assert window.position(np.zeros((3, 2))).shape == (3, 2, 2)


def test_matching_agrees_with_the_series_up_to_the_cutoff() -> None:
    exponents, coefficients = np.array([0.0, 1.0, 2.5]), np.array([[1.0], [-0.5], [0.75]])
    exact = PowerSeries(exponents=exponents, coefficients=coefficients[:, 0], cutoff=9.0)
    times = np.array([0.04, 0.02])
    for cutoff, first_missing in [(5.0, 5.5), (3.0, 3.0), (2.75, 3.0)]:
        window = WindowedSeries.matching(exponents, coefficients, cutoff=cutoff, decay=-np.log(0.1))
        rest = window.position(times)[:, 0] - exact(times)
        assert np.log2(rest[0] / rest[1]) == pytest.approx(first_missing, abs=0.25)


def test_a_long_grid_is_tabulated_without_loss() -> None:
    window = combination()
    times = 2.0**-9 * (np.arange(20_000) + 0.2)
    few = slice(3, None, 997)
    for evaluate in (
        window.position,
        window.velocity,
        window.acceleration,
        lambda t: window.fractional_derivative(t, 0.5, "caputo"),
        lambda t: window.fractional_derivative(t, 1.75, "caputo"),
    ):
        direct, table = evaluate(times[few]), evaluate(times)[few]
        np.testing.assert_allclose(table, direct, rtol=3e-14, atol=1e-14)


def test_a_long_grid_is_not_evaluated_directly() -> None:
    calls: list[int] = []

    def function(argument: np.ndarray) -> np.ndarray:
        calls.append(argument.size)
        return np.sqrt(argument)[:, None]

    times = np.arange(100_000) / 7
    np.testing.assert_allclose(tabulated(function, times)[:, 0], np.sqrt(times), rtol=1e-14)
    assert sum(calls) < 1000


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"exponents": np.array([-1.0])}, "exceed -1"),
        ({"decay": -0.5}, "decay"),
        ({"decay": math.inf}, "decay"),
        ({"coefficients": np.ones((2, 1))}, "does not fit"),
        ({"coefficients": np.ones(1)}, "does not fit"),
    ],
)
def test_what_makes_no_window_is_refused(changes: dict[str, object], message: str) -> None:
    arguments = {"exponents": np.zeros(1), "coefficients": np.ones((1, 1)), "decay": 1.0}
    with pytest.raises(ValueError, match=message):
        WindowedSeries(**{**arguments, **changes})
    for order in (0.0, 2.0, -0.5):
        with pytest.raises(ValueError, match="must lie in"):
            single(1.0).fractional_derivative(1.0, order, "caputo")


def test_matching_in_units_at_the_edge_of_the_numbers() -> None:
    """Products from the cutoff on leave the range of numbers; they are not part of the window."""
    exponents, second = np.array([0.0, 2.5, 9.5]), 1e-11
    plain = WindowedSeries.matching(exponents, np.ones((3, 1)), cutoff=10.0, decay=3.0)
    scaled = WindowedSeries.matching(
        exponents, 1e150 * second ** -exponents[:, None], cutoff=10.0, decay=3.0 / second
    )
    time = np.array([0.1, 1.0, 4.0])
    np.testing.assert_allclose(
        scaled.position(time * second) / 1e150, plain.position(time), rtol=1e-12
    )
    wider = WindowedSeries.matching(exponents, np.ones((3, 1)), cutoff=11.0, decay=3.0)
    assert np.abs(wider.position(time) - plain.position(time)).max() > 1e-3


def test_windows_side_by_side_keep_their_values() -> None:
    alone = [
        WindowedSeries(exponents=[0.0, 1.0, 2.5], coefficients=np.ones((3, 1)), decay=0.7),
        WindowedSeries(exponents=[1.0, 2.2], coefficients=[[1.0, -2.0], [0.5, 0.0]], decay=30.0),
        WindowedSeries(exponents=[0.0, 1.5], coefficients=[[1e-3], [4.0]], decay=0.0),
    ]
    together = WindowedSeries.side_by_side(alone)
    assert together.dimension == 4
    time = np.linspace(0.01, 20.0, 3000)
    for name in ("position", "velocity", "acceleration"):
        expected = np.concatenate([getattr(one, name)(time) for one in alone], axis=1)
        np.testing.assert_allclose(getattr(together, name)(time), expected, rtol=0, atol=1e-11)
    for kind in ("caputo", "riemann-liouville"):
        for order in (0.5, 1.0, 1.5):
            expected = np.concatenate(
                [one.fractional_derivative(time, order, kind) for one in alone], axis=1
            )
            found = together.fractional_derivative(time, order, kind)
            scale = np.abs(expected).max(axis=0)
            assert (np.abs(found - expected).max(axis=0) <= 1e-13 * scale).all()
    # the rates are told apart
    wrong = WindowedSeries(
        exponents=together.exponents, coefficients=together.coefficients, decay=0.7
    )
    assert np.abs(wrong.position(time) - together.position(time)).max() > 0.1


def test_rates_that_fit_no_component() -> None:
    with pytest.raises(ValueError, match="2 rates do not fit 3 components"):
        WindowedSeries(
            exponents=np.ones(1), coefficients=np.ones((1, 3)), decay=np.array([1.0, 2.0])
        )
