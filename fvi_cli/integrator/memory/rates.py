r"""Rates for integrals over spectra of memory, by the trapezoidal rule in a stretched logarithm."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fvi_cli.mathematics.arrays import Array

# With log x = u - exp(first - u) + exp(u - last) the ends begin where x T respectively its
# counterpart K N / (h x) is 1; the integrand grows by exp(1) off the real axis.
_END_ERROR = 20.0
# densities that are singular nearer to the real axis than this have nodes crowded around there
_WIDE = 0.55 * math.pi
_PEAK_MARGIN = 3.0  # least distance of a peak from the ends, as logarithms
# ends are moved for a peak in steps of this size, so that similar laws have the same rates
_ROOM = 2.0
# nodes farther than this (in logarithms) beyond the ends have the same effect to every accuracy
_ALIKE = 120.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RateRule:
    """The trapezoidal rule for some densities, with the nodes that are merged at its ends."""

    # logarithms of all nodes y, merged ones included, and their weights for integrals over log y
    logs: Array
    density: Array
    n_below: int  # nodes that are merged into the first one, and nodes that are kept
    n_kept: int

    @property
    def rates(self) -> Array:
        """The rates that are kept, shape ``(J,)``."""
        return np.exp(self._parts(self.logs)[1])

    def _parts(self, values: Array) -> tuple[Array, Array, Array]:
        """Split values at all nodes: at merged nodes below, at kept nodes, and above."""
        end = self.n_below + self.n_kept
        return values[: self.n_below], values[self.n_below : end], values[end:]

    def of_power(self, theta: float, factors: Array) -> Array:
        """Weights ``factors x^-theta`` of the states, the ends merged, shape ``(J,)``.

        Powers of the rates themselves: exponentials of their logarithms would lose a digit.
        """
        below, _, above = self._parts(self.logs)
        first, last = self.rates[0], self.rates[-1]
        return self._merged(
            np.exp((1 - theta) * below) / first,
            self.rates**-theta,
            np.exp(-(1 + theta) * above) * last,
            factors,
        )

    def of_density(self, log_density: Callable[[Array], Array]) -> Array:
        """Weights ``density / rate`` of the states, the ends merged, shape ``(J,)``.

        `log_density` is the logarithm of the density per logarithm, at logarithms of y.
        """
        below, kept, above = self._parts(self.logs)
        rates = np.log(self.rates)
        return self._merged(
            np.exp(log_density(below) - rates[0]),
            np.exp(log_density(kept) - rates),
            np.exp(log_density(above) - 2 * above + rates[-1]),
            np.ones_like(self.logs),
        )

    def _merged(self, below: Array, kept: Array, above: Array, factors: Array) -> Array:
        under, own, over = self._parts(factors * self.density)
        weights = own * kept
        weights[0] += (under * below).sum()
        weights[-1] += (over * above).sum()
        return np.asarray(weights)


def rate_rule(
    ends: Sequence[tuple[float, float]],
    *,
    first: float,
    last: float,
    accuracy: float,
    peaks: Sequence[tuple[float, float]] = (),
) -> RateRule:
    """The rule for densities that are like powers at both ends.

    `ends` are pairs of powers per logarithm, at small and at large rates; between the logarithms
    `first` and `last` the integrand is no such power. The accuracy is relative. `peaks` are
    logarithms at which densities bend, with the distance of their singularities from the real axis.
    """
    nearest, farthest = first - _ALIKE, last + _ALIKE
    below = max([0.0, *(first - place + _PEAK_MARGIN for place, _ in peaks)])
    above = max([0.0, *(place + _PEAK_MARGIN - last for place, _ in peaks)])
    first -= _ROOM * math.ceil(below / _ROOM)
    last += _ROOM * math.ceil(above / _ROOM)
    narrow = sorted({(place, size) for place, size in peaks if size < _WIDE})
    crowds = _PeakMap(tuple((_u_of(place, first, last), size) for place, size in narrow))
    width = _width([1 - low for low, _ in ends], accuracy)
    # an end has no effect left at exp(-cut), in the units of x and of the integrand
    cut = -math.log(accuracy) + 3.0
    tail = math.log(cut) + 0.5
    # the same for the powers of the density per logarithm, with two powers less above, merged
    under = max(tail, math.log(cut / min(low for low, _ in ends)) + 0.5)
    over = max(tail, math.log(cut / (2 - max(high for _, high in ends))) + 0.5)
    origin, end = crowds.stretched(np.array([first - tail, last + tail]))
    lowest, highest = crowds.stretched(np.array([first - under, last + over]))
    n_below = math.ceil((origin - lowest) / width)
    n_middle = math.ceil((end - origin) / width)
    n_above = math.ceil((highest - end) / width)
    u, density = crowds.places(origin + width * np.arange(-n_below, n_middle + n_above + 1))
    left, right = np.exp(first - u), np.exp(u - last)
    logs = u - left + right
    # peaks may lie at rates that overflow
    begin = max(n_below, int(np.searchsorted(logs, nearest)))
    end_kept = min(n_below + n_middle + 1, int(np.searchsorted(logs, farthest)))
    return RateRule(
        logs=logs,
        density=width * density * (1 + left + right),
        n_below=begin,
        n_kept=end_kept - begin,
    )


def _u_of(log_rate: float, first: float, last: float) -> float:
    """The u of a rate that lies well inside of the ends."""
    u = log_rate
    for _ in range(30):
        u = log_rate + math.exp(first - u) - math.exp(u - last)
    return u


class _PeakMap:
    r"""The map :math:`w = u + \sum \sinh^{-1}((u - c) / \delta)`: equal w crowd around c."""

    def __init__(self, peaks: tuple[tuple[float, float], ...]) -> None:
        self._peaks = peaks

    def stretched(self, u: Array) -> Array:
        """The variable w of u."""
        return u + sum(np.arcsinh((u - place) / size) for place, size in self._peaks)

    def places(self, w: Array) -> tuple[Array, Array]:
        """The u of w, and du / dw."""
        if not self._peaks:
            return w, np.ones_like(w)
        reach = sum(np.arcsinh((np.abs(w) + abs(place)) / size) for place, size in self._peaks)
        low, high = w - reach, w + reach
        for _ in range(60):
            middle = 0.5 * (low + high)
            is_low = self.stretched(middle) < w
            low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
        u = 0.5 * (low + high)
        slope = 1 + sum(1 / np.hypot(u - place, size) for place, size in self._peaks)
        return u, np.asarray(1 / slope)


def _width(exponents: Sequence[float], accuracy: float) -> float:
    r"""Width of the trapezoidal rule for :math:`\int e^{(1 - \theta) u - e^u} du`.

    Its relative error is :math:`2 |\Gamma(1 - \theta + i \omega)| / \Gamma(1 - \theta)` at
    :math:`\omega = 2 \pi / width`, with Stirling's formula; near theta = 1 that of the lower end
    is larger.
    """
    width = math.inf
    for theta in exponents:
        omega = 10.0
        for _ in range(20):
            size = 2 * math.sqrt(2 * math.pi) * omega ** (0.5 - theta) / math.gamma(1 - theta)
            size = max(size, _END_ERROR)
            omega = max(2 / math.pi * math.log(size / accuracy), 1.0)
        width = min(width, 2 * math.pi / omega)
    return width
