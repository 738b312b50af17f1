"""Least squares and profile intervals by brute force, for models in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares
from scipy.stats import t as student

Array = NDArray[np.float64]
Residuals = Callable[[Array], Array]


def springpot_response(hertz: Array, stiffness: float, *terms: tuple[float, float]) -> Any:
    """Position of a mass of 1 under a harmonic force of 1, terms as pairs (order, coefficient)."""
    s = 2j * np.pi * hertz
    return 1.0 / (s**2 + stiffness + sum(c * s**g for g, c in terms))


def zener_modulus(hertz: Array, unrelaxed: float, order: float, time: float) -> Any:
    """Complex modulus of a Cole-Cole law without relaxed modulus."""
    power = (2j * np.pi * hertz * time) ** order
    return unrelaxed * power / (1 + power)


def least(
    residuals: Residuals, starts: Sequence[Array], low: Array, high: Array
) -> tuple[Array, float]:
    """The best of several searches within bounds, and its sum of squares."""
    if not low.size:
        return np.zeros(0), float(np.sum(residuals(np.zeros(0)) ** 2))
    found = [
        least_squares(residuals, np.clip(s, low, high), bounds=(low, high), x_scale="jac")
        for s in starts
    ]
    best = min(found, key=lambda one: one.cost)
    return best.x, 2.0 * float(best.cost)


def increase(
    residuals: Residuals,
    best: Array,
    index: int,
    value: float,
    low: Array,
    high: Array,
) -> float:
    """The least sum of squares with one parameter held."""
    others = np.delete(np.arange(best.size), index)

    def held(point: Array) -> Array:
        whole = np.empty(best.size)
        whole[others], whole[index] = point, value
        return residuals(whole)

    middle = best[others]
    starts = [middle, middle * 1.3 + 1e-3, middle * 0.5]
    return least(held, starts, low[others], high[others])[1]


def interval(
    residuals: Residuals,
    best: Array,
    index: int,
    low: Array,
    high: Array,
    *,
    freedom: float,
    variance: float | None = None,
) -> tuple[float, float]:
    """The 95 % interval of a parameter by profile likelihood; bounds where they come first."""
    cost = float(np.sum(residuals(best) ** 2))
    size = cost / freedom if variance is None else variance
    rise = float(student.ppf(0.975, freedom)) ** 2 * size

    def beyond(value: float) -> float:
        return increase(residuals, best, index, value, low, high) - cost - rise

    ends = []
    for sign, bound in ((-1.0, low[index]), (1.0, high[index])):
        step = 0.02 * max(abs(best[index]), 0.01)
        inner, outer = best[index], best[index] + sign * step
        while sign * (outer - bound) < 0 and beyond(outer) < 0:
            inner, step = outer, 1.7 * step
            outer = outer + sign * step
        outer = bound if sign * (outer - bound) > 0 else outer
        if outer == bound and beyond(outer) < 0:
            ends.append(float(bound))
        else:
            ends.append(float(brentq(beyond, inner, outer, xtol=1e-6 * abs(outer), rtol=1e-5)))
    return ends[0], ends[1]


def restricted_deviations(residuals: Array, jacobian: Array, sizes: Sequence[int]) -> Array:
    """Root of sum r^2 / (n_c - tr H_c) of every column, from unweighted numbers, iterated.

    `residuals` are those of a *linear* model with this Jacobian at its truth (pure noise).
    """
    ends = np.cumsum(sizes)[:-1]
    found = np.array([np.std(part) for part in np.split(residuals, ends)])
    for _ in range(200):
        weight = np.repeat(1.0 / found, sizes)
        basis, _ = np.linalg.qr(jacobian * weight[:, None])
        scaled = residuals * weight
        left = (scaled - basis @ (basis.T @ scaled)) / weight
        squares = [float(part @ part) for part in np.split(left, ends)]
        used = [float(np.sum(part**2)) for part in np.split(basis, ends)]
        fresh = np.sqrt(np.array(squares) / (np.array(sizes) - np.array(used)))
        if np.max(np.abs(fresh / found - 1)) < 1e-10:
            return fresh
        found = fresh
    return found
