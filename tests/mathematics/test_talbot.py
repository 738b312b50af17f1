"""Inversion of Laplace transforms in many digits."""

import math

import mpmath
import numpy as np
import pytest
from oracles.contour import talbot_inverse


def test_values_from_outside():
    """Unit step from rest, x'' + D^g x + x = 1 (oracles: closed form and 120-digit Talbot)."""
    table = {
        0.5: (0.387738214241533, 0.887286182411692, 0.668914627671081, 0.877181068558190),
        1.5: (0.289440727849072, 0.842623502331295, 1.48771200400921, 0.990454834432767),
    }
    times = (1.0, 2.0, 5.0, 20.0)
    for order, values in table.items():
        found = talbot_inverse(
            lambda s, g=order: 1 / s / (s**2 + s ** mpmath.mpf(g) + 1), times, largest_frequency=1.5
        )
        np.testing.assert_allclose(found, values, rtol=2e-14)


def test_poles_on_the_imaginary_axis_at_long_times():
    times = (10.0, 100.0)
    exact = [t * math.sin(t) / 2 for t in times]
    found = talbot_inverse(lambda s: s / (s * s + 1) ** 2, times, largest_frequency=1.0)
    np.testing.assert_allclose(found, exact, rtol=1e-14)
    # a contour too small for the pole goes wrong
    small = talbot_inverse(lambda s: s / (s * s + 1) ** 2, times, largest_frequency=0.0)
    assert abs(small[1] - exact[1]) > 1e-3


@pytest.mark.parametrize("time", [0.0, -1.0, math.inf, math.nan])
def test_times_out_of_range_are_refused(time):
    with pytest.raises(ValueError, match="times"):
        talbot_inverse(lambda s: 1 / s, (time,), largest_frequency=1.0)
