import mpmath
import numpy as np
import pytest

from fvi_cli.mathematics.power_times_sine import derivative_of_power_times_sine


def by_integral(b: float, order: float, time: float) -> float:
    """Caputo's definition, with the derivative under the integral written out."""
    with mpmath.workdps(30):
        b_, order_, t = mpmath.mpf(b), mpmath.mpf(order), mpmath.mpf(time)
        times = 1 if order < 1 else 2

        def inner(s: mpmath.mpf) -> mpmath.mpf:
            first = (b_ - 1) * s ** (b_ - 2) * mpmath.sin(s) + s ** (b_ - 1) * mpmath.cos(s)
            if times == 1:
                return first
            return (
                (b_ - 1) * (b_ - 2) * s ** (b_ - 3) * mpmath.sin(s)
                + 2 * (b_ - 1) * s ** (b_ - 2) * mpmath.cos(s)
                - s ** (b_ - 1) * mpmath.sin(s)
            )

        kernel = times - order_
        # s = t (1 - u^(1/kernel)) takes the singularity of the kernel away.
        value = mpmath.quad(
            lambda u: inner(t * (1 - u ** (1 / kernel))) * t**kernel / kernel,
            [0, 0.2, 0.5, 0.8, 0.99, 1],
        )
        return float(value / mpmath.gamma(kernel))


@pytest.mark.parametrize("b", [1.0, 3.0, 4.0, 5.0, 3.7])
@pytest.mark.parametrize("order", [0.3, 0.5, 1.5])
def test_series_equals_the_definition_of_caputo(b, order):
    times = np.array([0.25, 1.0, 5.0])
    expected = [by_integral(b, order, t) for t in times]
    # b = 3.7 leaves an algebraic end point to the reference quadrature.
    tolerance = 1e-14 if b == int(b) else 1e-9
    assert derivative_of_power_times_sine(b, order, times) == pytest.approx(
        expected, rel=tolerance, abs=tolerance
    )


def test_order_one_is_the_derivative():
    t = np.linspace(0.0, 8.0, 50)
    for b in (1.0, 2.0, 3.5):
        classical = t ** (b - 1) * np.cos(t)
        if b > 1:
            classical += (b - 1) * np.where(t > 0, t, 1.0) ** (b - 2) * np.sin(t)
        scale = np.abs(classical).max()
        assert derivative_of_power_times_sine(b, 1.0, t) == pytest.approx(
            classical, abs=1e-13 * scale
        )


def test_value_at_zero():
    at_zero = [derivative_of_power_times_sine(b, 0.5, np.zeros(1))[0] for b in (0.3, 0.5, 1.0)]
    assert at_zero[0] == np.inf
    assert at_zero[1] == pytest.approx(float(mpmath.gamma(1.5)), rel=1e-15)
    assert at_zero[2] == 0.0


@pytest.mark.parametrize(
    ("b", "order", "time"),
    [(1.0, 0.0, 1.0), (1.0, 2.0, 1.0), (0.0, 0.5, 1.0), (0.9, 1.5, 1.0), (1.0, 0.5, 9.0)],
)
def test_refuses_what_it_cannot_do(b, order, time):
    with pytest.raises(ValueError, match="must"):
        derivative_of_power_times_sine(b, order, np.array([time]))
