"""Peaks of a sum of oscillators: every pole is walked around in small steps."""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar
from scipy.signal import argrelmax

Array = NDArray[np.float64]
STEP = 0.1
"""Between two points, in asinh of the distance from a pole in its widths."""


@dataclass(frozen=True, kw_only=True)
class Oscillator:
    """gain / (k - w^2 + c (i w)^order), mass 1."""

    stiffness: float
    coefficient: float
    order: float
    gain: float

    def pole(self) -> complex:
        """The zero s of the denominator, by Newton's iteration from the undamped one."""
        s = 1j * cmath.sqrt(self.stiffness)
        for _ in range(60):
            power = self.coefficient * s**self.order
            s -= (s**2 + power + self.stiffness) / (2 * s + power * self.order / s)
        return s


@dataclass(frozen=True, kw_only=True)
class OutsidePeak:
    """Frequency, size and half-power points; how far the valleys beside it lie below, as a part."""

    hertz: float
    magnitude: float
    low: float
    high: float
    prominence: float


def peaks(oscillators: Sequence[Oscillator], low: float, high: float) -> list[OutsidePeak]:
    """Maxima of |sum| between two frequencies."""

    def size(hertz: Array | float) -> Array:
        s = 2j * np.pi * np.asarray(hertz, dtype=float)
        parts = (o.gain / (o.stiffness + s**2 + o.coefficient * s**o.order) for o in oscillators)
        return np.abs(sum(parts))

    places = [np.array([low, high])]
    for one in oscillators:
        pole = one.pole() / (2 * np.pi)
        reach = math.asinh((high - low) / abs(pole.real)) + 1
        places.append(pole.imag + abs(pole.real) * np.sinh(np.arange(-reach, reach, STEP)))
    grid = np.unique(np.concatenate(places))
    grid = grid[(grid >= low) & (grid <= high)]
    sizes = size(grid)
    found = []
    for top in argrelmax(sizes)[0].tolist():
        left, width = grid[top - 1], grid[top + 1] - grid[top - 1]
        share = minimize_scalar(
            lambda x, a=left, w=width: -size(a + x * w), bounds=(0.0, 1.0), options={"xatol": 1e-10}
        ).x
        best = float(left + share * width)
        largest = float(size(best))
        sides = [
            _side(size, np.append(best, grid[own]), np.append(largest, sizes[own]))
            for own in (np.arange(top - 1, -1, -1), np.arange(top + 1, grid.size))
        ]
        (start, valley), (end, other) = sides
        prominence = 1 - max(valley, other) / largest
        peak = OutsidePeak(
            hertz=best, magnitude=largest, low=start, high=end, prominence=prominence
        )
        found.append(peak)
    return found


def _side(size, places, sizes):  # type: ignore[no-untyped-def]
    """The half-power point on one side, nan where the size rises before, and the lowest size."""
    rising = np.flatnonzero(np.diff(sizes) > 0)
    last = int(rising[0]) if rising.size else sizes.size - 1
    limit = sizes[0] / math.sqrt(2)
    below = np.flatnonzero(sizes[: last + 1] <= limit)
    end = math.nan
    if below.size:
        ends = sorted((places[below[0] - 1], places[below[0]]))
        end = float(brentq(lambda hertz: size(hertz) - limit, *ends, xtol=1e-300, rtol=1e-14))
    return end, float(sizes[last])
