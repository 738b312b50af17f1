"""Kinks of formulas on the polynomial of a step.

They are where an argument of ``abs`` or ``sign`` is zero, or both arguments of ``min`` or ``max``
are equal.

A step that crosses a kink is done again so that it ends there; steps on either side see a smooth
force and have their full order.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvi_cli.integrator.local_error.defect import ON_KINK
from fvi_cli.mathematics.arrays import Array

AT_END = 1e-13
"""Kinks as close to the end of a step as this, in steps, lie at its end."""
MOST_ITERATIONS = 60
ROUND_OFF = 4e-15
BEYOND = np.array([1.02, 1.1, 1.3])
"""Where a step that was cut too short is continued to find its kink."""


def first_crossing(
    arguments: Array, places: Array, *, starts_on: int | None
) -> tuple[int, float, float] | None:
    """The first kink that is crossed: its number and the places before and behind; None: none.

    Arguments of the functions with kinks are ``(k, n)`` at places ``(n,)`` in [0, 1]; the sign of
    the one on which the step begins says nothing.
    """
    found: tuple[int, float, float] | None = None
    for number, values in enumerate(arguments):
        largest = float(np.abs(values).max())
        if not largest > 0 or not np.isfinite(values).all():
            continue
        begins_on = number == starts_on or abs(values[0]) <= ON_KINK * largest
        signs = np.sign(values[1:] if begins_on else values)
        at = places[1:] if begins_on else places
        changed = np.flatnonzero(signs[1:] * signs[:-1] < 0)
        if changed.size == 0:
            continue
        place = int(changed[0])
        if found is None or at[place] < found[1]:
            found = (number, float(at[place]), float(at[place + 1]))
    return found


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a function that changes its sign between two places (the Illinois method).

    Every third place is the middle: an exponential is far from straight.
    """
    at_low, at_high = function(low), function(high)
    last, side = high, 0
    least = ROUND_OFF * max(abs(at_low), abs(at_high))
    for iteration in range(MOST_ITERATIONS):
        place = 0.5 * (low + high)
        if iteration % 3 < 2 and at_high != at_low:
            chord = (at_low * high - at_high * low) / (at_low - at_high)
            place = chord if low < chord < high else place
        value = function(place)
        if abs(value) <= least or abs(place - last) <= ROUND_OFF:
            return place
        if value * at_high > 0:
            high, at_high = place, value
            at_low *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            low, at_low = place, value
            at_high *= 0.5 if side > 0 else 1.0
            side = 1
        last = place
    return last
