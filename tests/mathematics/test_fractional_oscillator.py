"""The contour against Laplace inversion, against the branch-cut integral itself, and controls."""

import dataclasses

import mpmath
import numpy as np
import pytest
from spread import spread

from fvi_cli.mathematics.transforms import fractional_oscillator
from fvi_cli.mathematics.transforms.characteristic import (
    characteristic_terms,
    characteristic_zeros,
)


def contour_response(*arguments):
    return fractional_oscillator.contour_response(*arguments)[0]


def oscillator(stiffness, *damping, mass=1.0):
    characteristic = characteristic_terms(mass=mass, stiffness=stiffness, damping=damping)
    return characteristic, characteristic_zeros(characteristic)


def transform(characteristic, numerator, s):
    top = mpmath.fsum(mpmath.mpf(c) * s ** mpmath.mpf(p) for p, c in numerator.items())
    bottom = mpmath.fsum(mpmath.mpf(c) * s ** mpmath.mpf(p) for p, c in characteristic)
    return top / bottom


def by_talbot(characteristic, numerator, time):
    with mpmath.workdps(50):
        value = mpmath.invertlaplace(
            lambda s: transform(characteristic, numerator, s),
            mpmath.mpf(time),
            method="talbot",
            degree=120,
        )
        return float(value)


def free_numerator(order, coefficient):
    numerator = {1.0: 1.0, 0.0: 0.5, order - 1.0: coefficient}
    if order > 1:
        numerator[order - 2.0] = 0.5 * coefficient
    return numerator


ORDERS = [0.05, 0.3, 0.5, 0.8, 0.97, 1.03, 1.25, 1.5, 1.8, 1.95]


@spread(few=2, order=ORDERS, coefficient=(0.05, 3.0))
def test_agrees_with_laplace_inversion(order, coefficient):
    characteristic, zeros = oscillator(2.0, (order, coefficient))
    numerator = free_numerator(order, coefficient)
    times = np.array([0.01, 15.0])
    expected = np.array([by_talbot(characteristic, numerator, t) for t in times])
    found = contour_response(characteristic, zeros, numerator, times)
    assert np.abs(found - expected).max() < 3e-14


def test_a_wrong_pole_shows():
    characteristic, zeros = oscillator(2.0, (0.5, 0.7))
    numerator = free_numerator(0.5, 0.7)
    times = np.linspace(0.2, 20.0, 100)
    right = contour_response(characteristic, zeros, numerator, times)
    wrong = tuple(dataclasses.replace(z, center=z.center * (1 + 1e-10)) for z in zeros)
    assert np.abs(contour_response(characteristic, wrong, numerator, times) - right).max() > 1e-11
    missing = contour_response(characteristic, (), numerator, times)
    assert np.abs(missing - right).max() > 0.1


@spread(few=2, power=[0.0, 0.4, 1.0, 3.0, 8.0], order=[0.2, 0.5, 1.3, 1.5, 1.9])
def test_small_times_keep_their_relative_accuracy(order, power):
    # m x'' = t^power to leading order, with the first correction of the damping.
    characteristic, zeros = oscillator(3.0, (order, 1.0))
    numerator = {-power - 1.0: float(mpmath.gamma(power + 1))}
    times = np.array([1e-6, 1e-3, 0.05])
    expected = [by_talbot(characteristic, numerator, t) for t in times]
    found = contour_response(characteristic, zeros, numerator, times)
    assert found == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("order", [0.3, 0.5, 1.5, 1.8])
def test_tail_is_algebraic_and_accurate(order):
    characteristic, zeros = oscillator(1.0, (order, 1.0))
    numerator = {1.0: 1.0, order - 1.0: 1.0}
    # 1/P by powers of s: x = sum of s^(order n + 2 m) terms, here to high order at a large t.
    time = 1e4
    with mpmath.workdps(40):
        g = mpmath.mpf(order)
        series = mpmath.mpf(0)
        for n in range(30):
            for m in range(8):
                # (s + s^(g-1)) times (-1)^(n+m) binomial s^(g n + 2 m)
                weight = (-1) ** (n + m) * mpmath.binomial(n + m, n)
                for shift in (mpmath.mpf(1), g - 1):
                    p = g * n + 2 * m + shift
                    if p < 12:
                        series += weight * mpmath.mpf(time) ** (-p - 1) * mpmath.rgamma(-p)
    found = contour_response(characteristic, zeros, numerator, np.array([time]))[0]
    assert found == pytest.approx(float(series), rel=1e-11)


@spread(few=2, order=[0.3, 0.5, 1.2, 1.5], change=[0.0, 1e-12, 1e-4, -1e-2])
def test_nearly_double_growing_modes(order, change):
    coefficient = -2 / order
    characteristic, zeros = oscillator(2 / order - 1 + change, (order, coefficient))
    numerator = {1.0: 0.7, 0.0: -0.4, -1.0: 1.0, -3.0: 2.0}
    times = np.array([0.1, 2.9, 3.1])
    expected = np.array([by_talbot(characteristic, numerator, t) for t in times])
    found = contour_response(characteristic, zeros, numerator, times)
    assert np.abs(found / expected - 1.0).max() < 2e-13


def test_several_orders_at_once():
    damping = ((0.3, 0.4), (1.0, 0.2), (1.6, 0.9))
    characteristic, zeros = oscillator(5.0, *damping, mass=1.3)
    numerator = {1.0: 1.3, -0.7: 0.4, 0.0: 0.2, 0.6: 0.9, -2.5: 1.0}
    times = np.array([0.2, 2.0, 9.0])
    expected = np.array([by_talbot(characteristic, numerator, t) for t in times])
    found = contour_response(characteristic, zeros, numerator, times)
    assert np.abs(found - expected).max() < 2e-14


@spread(coefficient=[0.2, 2.0, 2.0 * np.sqrt(3.0), 5.0, 50.0], change=[-1e-9, 0.0, 1e-9])
def test_orders_next_to_one_are_harmless(coefficient, change):
    # The density on the cut is nearly singular there; with v0 = 0 the limit is the classical one.
    characteristic, zeros = oscillator(3.0, (1.0 + change, coefficient))
    times = np.linspace(0.1, 10.0, 100)
    found = contour_response(characteristic, zeros, {1.0: 1.0, change: coefficient}, times)
    a = coefficient / 2
    root = np.sqrt(complex(3.0 - a * a))
    classical = np.exp(-a * times) * (
        np.cos(root * times) + a * times * np.sinc(root * times / np.pi)
    )
    assert np.abs(found - classical.real).max() < (1e-13 if change == 0 else 1e-7)


def test_shapes_and_refusals():
    characteristic, zeros = oscillator(1.0, (0.5, 1.0), mass=2.0)
    grid = np.array([[0.5, 1.0], [2.0, 3.0]])
    assert contour_response(characteristic, zeros, {1.0: 3.0}, grid).shape == (2, 2)
    assert not contour_response(characteristic, zeros, {}, grid).any()
    with pytest.raises(ValueError, match="above 1"):
        contour_response(characteristic, zeros, {1.5: 1.0}, grid)
    with pytest.raises(ValueError, match="positive"):
        contour_response(characteristic, zeros, {0.0: 1.0}, -grid)
