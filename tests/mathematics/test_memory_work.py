"""Fractional integrals and works by splines."""

import math

import numpy as np
import pytest
from oracles.memory_work import fractional_integral, work_along


@pytest.mark.parametrize("order", [0.1, 0.5, 1.0, 1.7])
def test_quintic_polynomials_are_integrated_exactly(order):
    t = np.arange(65) / 16
    powers = np.arange(6)
    values = t[:, None] ** powers
    exact = [
        math.gamma(p + 1) / math.gamma(p + 1 + order) * t ** (p + order) for p in powers.tolist()
    ]
    found = fractional_integral(order, 1 / 16, values)
    size = np.abs(exact).max(axis=1)
    assert (np.abs(found - np.transpose(exact)).max(axis=0) / size).max() < 1e-12
    wrong = fractional_integral(order + 1e-6, 1 / 16, values)
    assert (np.abs(wrong - np.transpose(exact)).max(axis=0) / size).max() > 1e-7


def test_order_six_or_more_on_a_smooth_function():
    """J^{1/2} of sin by its power series."""
    errors = []
    for n in (32, 64, 128):
        t = 3.0 * np.arange(n + 1) / n
        exact = sum((-1) ** k * t ** (2 * k + 1.5) / math.gamma(2 * k + 2.5) for k in range(25))
        found = fractional_integral(0.5, 3.0 / n, np.sin(t)[:, None])[:, 0]
        errors.append(np.abs(found - exact).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert 5.7 < orders[-1] < 7.0
    assert errors[-1] < 1e-10


def test_work_of_a_spring():
    t = 2.0 * np.arange(201) / 200
    work = work_along(np.stack([np.sin(t), t], 1), np.stack([np.cos(t), t**2], 1), 0.01)
    np.testing.assert_allclose(work, np.sin(t) ** 2 / 2 + t**4 / 4, atol=1e-12)
    assert np.abs(work - np.sin(t) ** 2 / 2).max() > 1.0
