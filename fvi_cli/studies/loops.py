r"""Force of a damper against its deformation: stiffness and loss factor of its last loop.

With the work W of the loop, its amplitude a, half the range of the deformation, and the forces at
the largest and the least deformation,

.. math:: k = \frac{f(y_{\max}) - f(y_{\min})}{2 a}, \qquad
          \eta = \frac{W}{2 \pi \cdot \tfrac12 k a^2}, \qquad W = \oint f\, dy,

the equivalent stiffness and the loss factor, the energy of the loop over 2 pi times that of a
spring k at its peak (R.W. Clough, J. Penzien, *Dynamics of Structures*, 2003, section 3-7). For a
linear law in steady harmonic motion these are :math:`\mathrm{Re}\,g` and
:math:`\mathrm{Im}\,g / \mathrm{Re}\,g` at its frequency.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.observe.dampers import damper_values, deformation_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.experiment import Experiment, FinishedRun

SAMPLES = 4000
"""Points of the closed polygon whose area is the work of a loop; error (2 pi / n)^2 / 6."""
LEAST_AMPLITUDE = 1e-3
"""Share of the whole range below which a loop belongs to the decay after the test."""
WIDER = 1.01
"""The largest loop has a row of its own if it is wider than the last one by this factor."""
SWING = 0.25
"""Share of the range of a loop from which on a maximum counts as one of another period."""
LAST, LARGEST = "last", "largest"
LEAST_POINTS = 20
"""Least stored points of a loop; with 20 the stiffness of a viscous damper errs by 0.2 %."""
MOST_DIFFERENCE = 0.05
"""Largest relative difference from the loop through every other point; 8 times the loop's error."""
LEAST_STIFFNESS = 1e-6
"""Stiffnesses below this share of force range over deformation range are error of the run."""


@dataclass(frozen=True, kw_only=True)
class DamperLoop:
    """Numbers of one loop of a damper, in the units of force and deformation.

    The defaults stand for a loop with too few points.
    """

    begin: float
    end: float
    amplitude: float = math.nan
    stiffness: float = math.nan
    loss_factor: float = math.nan
    work: float = math.nan


def forces_of(experiment: Experiment) -> tuple[str, ...]:
    """Names of the quantities that are the force of a damper, or a component of it."""
    scene, quantities = experiment.problem.scene, experiment.observations.quantities or {}
    if scene is None:
        return ()
    known = damper_values(scene)
    texts = {name: one.text.strip() for name, one in quantities.items()}
    return tuple(
        name for name, text in texts.items() if text in known and known[text].kind == "force"
    )


def deformation_against(item: FinishedRun, name: str) -> tuple[Array, Array]:
    """Deformation and force of the damper that a quantity names, at stored times, ``(n,)`` each."""
    # members may differ in the coordinate that a damper acts on
    scene, trajectory = item.run.scene, item.trajectory
    observed, quantities = trajectory.observed, item.run.experiment.observations.quantities or {}
    if observed is None:
        raise ValueError(f"{name}: the run has no forces of dampers")
    value = damper_values(scene)[quantities[name].text.strip()]
    # the force of all dampers together belongs to the first displacement
    deformation = deformation_of(scene, max(value.place, 0), trajectory.position)
    return deformation[:, value.component], observed.quantities[name]


def loops_of(time: Array, deformation: Array, force: Array) -> dict[str, DamperLoop]:
    """The last loop, and the widest one where that is wider; empty where there is no loop.

    A loop is one period: it lies between two rises of the deformation through the middle of its
    range, with one maximum between them; between the points both are cubic polynomials. Loops of
    less than a thousandth of the range, such as round-off at rest, do not count. With too few
    points the numbers are nan. A stiffness below the error of the run is 0, its loss factor
    infinite. Keys are :data:`LAST` and :data:`LARGEST`.
    """
    finite = np.isfinite(time) & np.isfinite(deformation) & np.isfinite(force)
    t, y, f = time[finite], deformation[finite], force[finite]
    if t.size < 4:
        return {}
    middle = 0.5 * (y.max() + y.min())
    above = y - middle > 0
    rises = np.flatnonzero(~above[:-1] & above[1:])
    pairs = list(itertools.pairwise(rises.tolist()))
    widths = np.array([np.ptp(y[first : last + 1]) for first, last in pairs])
    wide = np.flatnonzero(widths > LEAST_AMPLITUDE * np.ptp(y)).tolist()
    last = next((k for k in reversed(wide) if _is_one_period(y, *pairs[k])), None)
    if last is None:
        return {}
    by_width = sorted(wide, key=lambda k: -widths[k])
    largest = next(k for k in by_width if _is_one_period(y, *pairs[k]))
    chosen = {LAST: last} | ({LARGEST: largest} if widths[largest] > WIDER * widths[last] else {})
    return {word: _loop(t, y, f, middle, *pairs[index]) for word, index in chosen.items()}


def _is_one_period(y: Array, first: int, last: int) -> bool:
    """Whether the deformation has one maximum between two rises, but for small ripples."""
    from scipy.signal import find_peaks

    within = y[first : last + 2]
    return bool(find_peaks(within, prominence=SWING * np.ptp(within))[0].size == 1)


def _loop(t: Array, y: Array, f: Array, middle: float, first: int, last: int) -> DamperLoop:
    """The loop between the rises through the middle that follow the points `first` and `last`."""
    if last - first < LEAST_POINTS:
        return DamperLoop(begin=float(t[first]), end=float(t[last]))
    # some more points on both sides, for the slopes
    near = slice(max(first - 4, 0), last + 6)
    t, y, f = t[near], y[near], f[near]
    begin, end = (_rise(t, y, middle, place - near.start) for place in (first, last))
    amplitude, stiffness, work = _around(t, y, f, begin, end)
    size = float(np.ptp(f) / np.ptp(y))
    noise = LEAST_STIFFNESS * size
    # every other point gives the same loop with a larger error: the difference bounds the error
    for skipped in (0, 1):
        kept = np.ones(t.size, dtype=bool)
        kept[1 + skipped : -1 : 2] = False
        _, other, its_work = _around(t[kept], y[kept], f[kept], begin, end)
        noise = max(noise, abs(other - stiffness))
        if not abs(its_work - work) <= MOST_DIFFERENCE * np.ptp(f) * np.ptp(y):
            return DamperLoop(begin=begin, end=end)
    if not noise <= MOST_DIFFERENCE * size:
        return DamperLoop(begin=begin, end=end)
    if abs(stiffness) <= noise:
        stiffness = 0.0
    lost = work / (math.pi * amplitude**2)
    # a damper whose force is zero has no loss factor
    without = math.inf if f.any() else math.nan
    return DamperLoop(
        amplitude=amplitude,
        stiffness=stiffness,
        loss_factor=lost / stiffness if stiffness else without,
        work=work,
        begin=begin,
        end=end,
    )


def _rise(t: Array, y: Array, middle: float, place: int) -> float:
    """The time after a point at which the deformation rises through the middle, to round-off."""
    # slow imports, which most commands do not need
    from scipy.interpolate import CubicHermiteSpline
    from scipy.optimize import brentq

    moved = CubicHermiteSpline(t, y - middle, np.gradient(y, t))
    return float(brentq(lambda at: float(moved(at)), t[place], t[place + 1], xtol=1e-300))


def _around(t: Array, y: Array, f: Array, begin: float, end: float) -> tuple[float, float, float]:
    """Amplitude, stiffness and work of the loop between two times."""
    from scipy.interpolate import CubicHermiteSpline

    # with the slopes of parabolas through three points
    moved, forced = (CubicHermiteSpline(t, one, np.gradient(one, t)) for one in (y, f))
    # the largest sample is not quite at the peak, where alone the force of a viscous damper is 0
    turns = moved.derivative().roots(extrapolate=False)
    turns = turns[(turns >= begin) & (turns <= end)]
    if not turns.size:
        return math.nan, math.nan, math.nan
    reached = moved(turns)
    high, low = int(reached.argmax()), int(reached.argmin())
    amplitude = 0.5 * float(reached[high] - reached[low])
    at = np.linspace(begin, end, SAMPLES, endpoint=False)
    around, force = moved(at), forced(at)
    work = 0.5 * float(force @ (np.roll(around, -1) - np.roll(around, 1)))
    if not amplitude > 0:
        return math.nan, math.nan, math.nan
    return amplitude, 0.5 * float(forced(turns[high]) - forced(turns[low])) / amplitude, work
