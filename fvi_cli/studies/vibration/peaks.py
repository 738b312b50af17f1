r"""Peaks of a harmonic response and their half-power widths.

As a function of the frequency a response has poles at the modes; it changes over lengths of the
distance to the next pole. So it is evaluated around every mode at multiples of the width of the
mode, independently of the frequencies of the table, and no peak falls between two points.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.vibration.dynamic_stiffness import LARGEST_DENSE
from fvi_cli.studies.vibration.modes import Mode, find_modes

HALF_POWER: Final = math.sqrt(0.5)
UNDAMPED: Final = 1e-13
"""A damping ratio below this is round-off."""
_COUNTS = (4, 12, 36)
"""Numbers of modes of a large structure, tried one after the other until they cover the range."""
_RATIO = 1.06
"""Largest ratio of two frequencies at which small structures are evaluated."""
_MULTIPLES = np.array([0.25, 0.5, 0.75, 1.0, 1.4])
"""Distances from a mode in units of its width; further ones grow by the last as a factor."""
_CLOSEST = 0.02
"""Smallest distance of two points, in distances from the next mode."""


@dataclass(frozen=True, kw_only=True)
class Peak:
    r"""A maximum of the magnitude."""

    at: str
    hertz: float
    magnitude: float
    """Frequency in oscillations per unit of time, and size; infinite at a mode without damping."""
    low: float
    high: float
    r"""Frequencies on both sides where the magnitude is :math:`1/\sqrt 2` of the peak; nan where it
    does not fall so far in the range, or rises again before."""
    modes: int | None = None
    """Number of modes that belong to the peak: they lie between `low` and `high`, and no other peak
    is nearer. None: modes are not known."""

    @property
    def loss_factor(self) -> float:
        """Half-power bandwidth relative to the frequency of the peak."""
        return (self.high - self.low) / self.hertz


@dataclass(frozen=True, kw_only=True, eq=False)
class ModesInRange:
    """Modes in a range of frequencies."""

    modes: tuple[Mode, ...]  # the known modes in the range or next to it
    are_all: bool  # whether no mode with a damping ratio up to 0.995 is missing

    @property
    def growing(self) -> tuple[Mode, ...]:
        """The modes that grow: with them motions do not settle into a harmonic response."""
        return tuple(mode for mode in self.modes if mode.frequency.real > 0)


NO_MODES = ModesInRange(modes=(), are_all=False)


def modes_in_range(scene: Scene, low: float, high: float) -> ModesInRange:
    """The modes that shape a response between two frequencies, oscillations per unit of time."""
    d = scene.dimension
    counts = (4 * d,) if d <= LARGEST_DENSE else tuple(min(count, d) for count in _COUNTS)
    near = None if d <= LARGEST_DENSE else 0.5 * (low + high)
    for count in counts:
        try:
            table = find_modes(scene, count, near=near)
        except ValueError:
            # no mode oscillates; for a large structure that is not certain
            return ModesInRange(modes=(), are_all=d <= LARGEST_DENSE)
        sizes = [abs(mode.frequency) / (2 * math.pi) for mode in table.modes]
        if near is None or max(abs(size - near) for size in sizes) > high - near:
            return ModesInRange(modes=table.modes, are_all=table.is_complete)
    return ModesInRange(modes=table.modes, are_all=False)


def resolving_frequencies(hertz: Array, known: ModesInRange, *, is_small: bool) -> Array:
    """Frequencies that resolve a response between the first and the last of `hertz`, ascending."""
    low, high = float(hertz[0]), float(hertz[-1])
    points = [hertz]
    if is_small:
        number = 2 + math.ceil(math.log(high / low) / math.log(_RATIO))
        points.append(np.geomspace(low, high, number))
    for mode in known.modes:
        width = _width(mode)
        steps = 1 + max(0, math.ceil(math.log((high - low) / width) / math.log(1.4)))
        away = width * np.concatenate([_MULTIPLES, 1.4 ** np.arange(2, 2 + steps)])
        points.append(np.concatenate([[mode.hertz], mode.hertz + away, mode.hertz - away]))
    every = np.unique(np.concatenate(points))
    every = every[(every > low) & (every < high)]
    scale = every.copy()
    for mode in known.modes:
        scale = np.minimum(scale, np.hypot(every - mode.hertz, _width(mode)))
    kept = [low]
    for point, own in zip(every.tolist(), scale.tolist(), strict=True):
        if point - kept[-1] > _CLOSEST * own and high - point > _CLOSEST * own:
            kept.append(point)
    return np.array([*kept, high])


def find_peaks(
    name: str, hertz: Array, size: Array, at: Callable[[float], float], known: ModesInRange
) -> list[Peak]:
    """The maxima between the first and the last frequency."""
    rising = np.diff(size) > 0
    tops = np.flatnonzero(rising[:-1] & ~rising[1:]) + 1
    found: list[Peak] = []
    for top in tops.tolist():
        endless = _endless(known, float(hertz[top]))
        if endless is not None:
            if not any(peak.hertz == endless for peak in found):
                found.append(
                    Peak(at=name, hertz=endless, magnitude=math.inf, low=endless, high=endless)
                )
            continue
        best, largest = _maximum(at, float(hertz[top - 1]), float(hertz[top + 1]))
        limit = HALF_POWER * largest
        points = list(zip(hertz.tolist(), size.tolist(), strict=True))
        before = [one for one in points[:top][::-1] if one[0] < best]
        after = [one for one in points[top:] if one[0] > best]
        found.append(
            Peak(
                at=name,
                hertz=best,
                magnitude=largest,
                low=_crossing(at, before, best, limit),
                high=_crossing(at, after, best, limit),
            )
        )
    return _with_modes(found, known)


def _width(mode: Mode) -> float:
    """Half of the half-power width, oscillations per unit of time."""
    return max(abs(mode.frequency.real), UNDAMPED * abs(mode.frequency)) / (2.0 * math.pi)


def _endless(known: ModesInRange, hertz: float) -> float | None:
    """Frequency of an undamped mode at `hertz`; None: there is none."""
    for mode in known.modes:
        is_here = abs(mode.hertz - hertz) <= 100 * UNDAMPED * hertz
        if is_here and abs(mode.damping_ratio) <= UNDAMPED:
            return mode.hertz
    return None


def _maximum(at: Callable[[float], float], left: float, right: float) -> tuple[float, float]:
    """Place and size of the maximum between two frequencies."""
    from scipy.optimize import minimize_scalar

    # as a share of the interval: a tolerance relative to the frequency may exceed a narrow peak
    found = minimize_scalar(
        lambda part: -at(left + part * (right - left)),
        bounds=(0.0, 1.0),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return left + float(found.x) * (right - left), -float(found.fun)


def _crossing(
    at: Callable[[float], float], points: Sequence[tuple[float, float]], peak: float, limit: float
) -> float:
    """Where the magnitude falls to a limit on one side of a peak; nan where it rises before."""
    earlier, inside, before = peak, peak, math.inf
    for place, here in points:
        if here <= limit:
            return _bisected(at, limit, inside, place)
        if here > before:
            # a valley between the points may reach down to the limit
            low, high = sorted((earlier, place))
            valley, depth = _maximum(lambda frequency: -at(frequency), low, high)
            return _bisected(at, limit, earlier, valley) if -depth <= limit else math.nan
        earlier, inside, before = inside, place, here
    return math.nan


def _bisected(at: Callable[[float], float], limit: float, inside: float, outside: float) -> float:
    """Frequency between two others at which the magnitude equals a limit."""
    from scipy.optimize import brentq

    length = outside - inside
    if at(inside) <= limit:
        return inside
    part = brentq(lambda part: at(inside + part * length) - limit, 0.0, 1.0, xtol=1e-12)
    return inside + float(part) * length


def _with_modes(peaks: Sequence[Peak], known: ModesInRange) -> list[Peak]:
    """Peaks with the number of modes that belong to each."""
    if not known.are_all:
        return list(peaks)
    numbers = [0] * len(peaks)
    for mode in known.modes:
        distances = [abs(peak.hertz - mode.hertz) for peak in peaks]
        if not distances:
            break
        nearest = int(np.argmin(distances))
        peak = peaks[nearest]
        low = peak.hertz - _width(mode) if math.isnan(peak.low) else peak.low
        high = peak.hertz + _width(mode) if math.isnan(peak.high) else peak.high
        slack = 0.5 * _width(mode)
        numbers[nearest] += low - slack <= mode.hertz <= high + slack
    return [replace(peak, modes=number) for peak, number in zip(peaks, numbers, strict=True)]
