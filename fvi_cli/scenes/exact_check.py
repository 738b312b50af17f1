"""Check whether a function that a user gives as exact solution begins with the initial data."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array

TOLERANCE = 1e-6
"""Permitted error at 0, relative to the largest value."""

RATE_STEPS = tuple(1e-4 / 16**k for k in range(5))
"""Steps of difference quotients at 0, as shares of T; so short since T may be many periods."""

ROUND_OFF = 1e-13
"""Relative round-off of a value of the function."""


def objection(exact: Callable[[Array], Array], scene: Scene) -> str:
    """Why `exact` does not begin with the initial data of `scene`; empty: it does."""
    start, velocity, end = scene.initial_position, scene.initial_velocity, scene.final_time
    steps = end * np.array(RATE_STEPS)
    with np.errstate(all="ignore"):
        values, found = exact(np.linspace(0.0, end, 257)), exact(np.zeros(1))[0]
        rates = (exact(steps) - found) / steps[:, None]
    size = float(np.abs(values).max(initial=0.0))
    if np.abs(found - start).max() > TOLERANCE * max(size, float(np.abs(start).max())):
        return f"is {_numbers(found)} at t = 0, but initial.position is {_numbers(start)}"
    wrong = np.abs(rates - velocity).max(axis=1)
    scale = max(float(np.abs(velocity).max()), size / end)
    least = 100 * TOLERANCE * scale + ROUND_OFF * size / float(steps[-1])
    # a difference that shrinks with the step is curvature, also that of many periods
    if wrong[-1] > max(least, 0.6 * float(wrong[-2])):
        rate = _numbers(rates[-1])
        return f"has the derivative {rate} at t = 0, but initial.velocity is {_numbers(velocity)}"
    return ""


def _numbers(values: Array) -> str:
    texts = [f"{value:.6g}" for value in values[:4]]
    return texts[0] if values.size == 1 else f"[{', '.join(texts)}{', ...' * (values.size > 4)}]"
