"""Elements of a piecewise polynomial acceleration, and its fractional integrals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.special import betainc, gamma, rgamma

Array = NDArray[np.float64]

QUADRATURE_NODES = 18


@dataclass(frozen=True, eq=False)
class Element:
    start: float
    length: float
    position: Array
    velocity: Array
    coefficients: Array
    """Legendre coefficients of the acceleration, shape ``(m, d)``."""

    def acceleration(self, places: Array) -> Array:
        """Acceleration at places in [0, 1], shape ``(n, d)``."""
        return legendre.legvander(2 * places - 1, len(self.coefficients) - 1) @ self.coefficients

    def motion(self, places: Array) -> tuple[Array, Array]:
        """Position and velocity at places in [0, 1], each of shape ``(n, d)``."""
        h, c = self.length, self.coefficients
        once = integrate_legendre(places, len(c), 1) @ c
        twice = integrate_legendre(places, len(c), 2) @ c
        moved = np.multiply.outer(h * places, self.velocity)
        return self.position + moved + h * h * twice, self.velocity + h * once


@dataclass(frozen=True, eq=False)
class Series:
    """Acceleration sum_k c_k t**p_k on [0, length]."""

    length: float
    powers: Array
    coefficients: Array

    def motion(self, times: Array, position: Array, velocity: Array) -> tuple[Array, Array]:
        """Position and velocity at times, from those at 0, each of shape ``(n, d)``."""
        p = self.powers
        with np.errstate(divide="ignore"):
            once = np.power.outer(times, p + 1) / (p + 1)
        twice = once * times[:, None] / (p + 2)
        start = position + np.multiply.outer(times, velocity)
        return start + twice @ self.coefficients, velocity + once @ self.coefficients

    def memory(self, exponent: float, times: Array) -> Array:
        """I^exponent of the acceleration on [0, length] at later times."""
        p = self.powers
        whole = gamma(p + 1) * rgamma(p + 1 + exponent)
        part = betainc(p + 1, exponent, self.length / times[:, None])
        return (whole * part * np.power.outer(times, p + exponent)) @ self.coefficients


class History:
    """The accelerations of all elements so far, as sums over quadrature nodes."""

    def __init__(self, series: Series) -> None:
        self.series = series
        self.elements: list[Element] = []
        points, weights = legendre.leggauss(QUADRATURE_NODES)
        self.places, self.weights = (points + 1) / 2, weights / 2
        self.times = np.empty(0)
        self.values: Array | None = None
        self.ends = np.empty(0)
        self.lengths = np.empty(0)

    def append(self, element: Element) -> None:
        """Add the element that follows."""
        self.elements.append(element)
        self.times = np.append(self.times, element.start + element.length * self.places)
        found = (element.length * self.weights)[:, None] * element.acceleration(self.places)
        self.values = found if self.values is None else np.concatenate([self.values, found])
        self.ends = np.append(self.ends, element.start + element.length)
        self.lengths = np.append(self.lengths, element.length)

    def integrate(self, exponent: float, start: float, times: Array) -> Array:
        """I^exponent of the accelerations before `start` at later times, shape ``(n, d)``."""
        total = self.series.memory(exponent, times)
        if self.values is None:
            return total
        is_near = start - self.ends < self.lengths
        far = ~np.repeat(is_near, QUADRATURE_NODES)
        kernel = (times[:, None] - self.times[far]) ** (exponent - 1)
        part = kernel @ self.values[far]
        for n in np.flatnonzero(is_near):
            part = part + self._near(exponent, self.elements[n], times)
        return total + rgamma(exponent) * part

    def _near(self, exponent: float, element: Element, times: Array) -> Array:
        """One element in pieces, each at most as long as its distance from the times."""
        end = element.start + element.length
        pieces = max(1, math.ceil(math.log2(element.length / (times.min() - end)))) + 1
        edges = np.append(0.5 ** np.arange(pieces), 0.0)
        left, size = edges[:-1, None], -np.diff(edges)[:, None]
        back = (left - size * self.places).ravel()
        values = (element.length * size * self.weights).ravel()[:, None] * element.acceleration(
            1 - back
        )
        return ((times - end)[:, None] + element.length * back) ** (exponent - 1) @ values


def integrate_legendre(places: Array, n: int, times: int) -> Array:
    """Integrals from 0, once or twice, of n shifted Legendre polynomials at places in [0, 1]."""
    coefficients = legendre.legint(np.eye(n), m=times, lbnd=-1, scl=1) / 2.0**times
    return legendre.legvander(2 * places - 1, n - 1 + times) @ coefficients
