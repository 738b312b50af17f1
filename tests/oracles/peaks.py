"""Peaks of a sum of oscillators in many digits: every pole is walked around in small steps."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mpmath

DIGITS = 30
STEP = 0.1
"""Between two points, in asinh of the distance from a pole in its widths."""


@dataclass(frozen=True, kw_only=True)
class Oscillator:
    """gain / (k - w^2 + c (i w)^order), mass 1."""

    stiffness: float
    coefficient: float
    order: float
    gain: float

    def pole(self) -> mpmath.mpc:
        """The zero s of the denominator, by Newton's iteration from the undamped one."""
        s = mpmath.mpc(0, mpmath.sqrt(self.stiffness))
        for _ in range(60):
            value = s**2 + self.coefficient * s**self.order + self.stiffness
            change = value / (2 * s + self.coefficient * self.order * s ** (self.order - 1))
            s -= change
            if abs(change) < abs(s) * mpmath.mpf(10) ** (-DIGITS + 8):
                break
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
    with mpmath.workdps(DIGITS):

        def size(hertz: mpmath.mpf) -> mpmath.mpf:
            s = mpmath.mpc(0, 2 * mpmath.pi * hertz)
            return abs(
                sum(
                    one.gain / (one.stiffness + s**2 + one.coefficient * s**one.order)
                    for one in oscillators
                )
            )

        points = {mpmath.mpf(low), mpmath.mpf(high)}
        for one in oscillators:
            pole = one.pole()
            centre, width = pole.imag / (2 * mpmath.pi), abs(pole.real) / (2 * mpmath.pi)
            reach = math.asinh(float((high - low) / width)) + 1
            for k in range(-int(reach / STEP), int(reach / STEP) + 1):
                place = centre + width * mpmath.sinh(STEP * k)
                if low < place < high:
                    points.add(place)
        grid = sorted(points)
        sizes = [size(one) for one in grid]
        found = []
        tops = [
            k
            for k in range(1, len(grid) - 1)
            if sizes[k - 1] < sizes[k] and sizes[k] >= sizes[k + 1]
        ]
        for k in tops:
            best = _maximum(size, grid[k - 1], grid[k + 1])
            largest = size(best)
            ends, valleys = [], []
            for step in (-1, 1):
                end, valley = _walk(size, grid, sizes, k, step, best, largest)
                ends.append(end)
                valleys.append(valley)
            found.append(
                OutsidePeak(
                    hertz=float(best),
                    magnitude=float(largest),
                    low=ends[0],
                    high=ends[1],
                    prominence=float(1 - max(valleys) / largest),
                )
            )
        return found


def _maximum(size, left, right):
    """Golden section."""
    ratio = (mpmath.sqrt(5) - 1) / 2
    for _ in range(70):
        one, other = right - ratio * (right - left), left + ratio * (right - left)
        if size(one) > size(other):
            right = other
        else:
            left = one
    return (left + right) / 2


def _walk(size, grid, sizes, top, step, best, largest):
    """The half-power point on one side, nan where the size rises before, and the lowest size."""
    limit = largest / mpmath.sqrt(2)
    inside, before, lowest, end = best, largest, largest, math.nan
    k = top + step
    while 0 <= k < len(grid) and sizes[k] <= before:
        before = lowest = sizes[k]
        if sizes[k] <= limit and math.isnan(end):
            outside = grid[k]
            for _ in range(60):
                middle = (inside + outside) / 2
                if size(middle) > limit:
                    inside = middle
                else:
                    outside = middle
            end = float(inside)
        if math.isnan(end):
            inside = grid[k]
        k += step
    return end, lowest
