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
from typing import Final

import numpy as np

from fvi_cli.integrator.observe.dampers import damper_values, deformation_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.studies.experiment import Experiment, FinishedRun

SAMPLES: Final = 4000
"""Points of the closed polygon whose area is the work of a loop; error (2 pi / n)^2 / 6."""
LEAST_AMPLITUDE: Final = 1e-3
"""Share of the whole range below which a loop belongs to the decay after the test."""
SWING: Final = 0.25
"""Share of the range of a loop from which on a maximum counts as one of another period."""
LEAST_POINTS: Final = 20
"""Least stored points of a loop."""


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


def last_loop(time: Array, deformation: Array, force: Array) -> DamperLoop | None:
    """The last loop; None where there is none.

    A loop is one period: it lies between two rises of the deformation through the middle of its
    range, with one maximum between them. Loops of less than a thousandth of the range, such as
    round-off at rest, do not count. With too few points the numbers are nan, and the loss factor
    is nan without a force.
    """
    # slow imports, which most commands do not need
    from scipy.signal import find_peaks

    finite = np.isfinite(time) & np.isfinite(deformation) & np.isfinite(force)
    t, y, f = time[finite], deformation[finite], force[finite]
    if not t.size:
        return None
    middle = 0.5 * (y.max() + y.min())
    rises = np.flatnonzero((y[:-1] <= middle) & (y[1:] > middle))
    for first, last in reversed(list(itertools.pairwise(rises.tolist()))):
        within = y[first : last + 2]
        width = np.ptp(within)
        is_one_period = find_peaks(within, prominence=SWING * width)[0].size == 1
        if is_one_period and width > LEAST_AMPLITUDE * np.ptp(y):
            return _loop(t, y, f, middle, first, last)
    return None


def _loop(t: Array, y: Array, f: Array, middle: float, first: int, last: int) -> DamperLoop:
    """The loop between the rises through the middle that follow the points `first` and `last`."""
    from scipy.interpolate import CubicSpline

    if last - first < LEAST_POINTS:
        return DamperLoop(begin=float(t[first]), end=float(t[last]))
    # some more points on both sides, for the slopes
    near = slice(max(first - 4, 0), last + 6)
    moved, forced = (CubicSpline(t[near], one[near]) for one in (y, f))
    rises = moved.solve(middle, extrapolate=False)
    begin, end = rises[rises >= t[first]][0], rises[rises <= t[last + 1]][-1]
    # the largest sample is not quite at the peak, where alone the force of a viscous damper is 0
    turns = moved.derivative().roots(extrapolate=False)
    turns = turns[(turns >= begin) & (turns <= end)]
    ends = turns[[moved(turns).argmax(), moved(turns).argmin()]]
    amplitude, pushed = -0.5 * np.diff(moved(ends))[0], -0.5 * np.diff(forced(ends))[0]
    stiffness = pushed / amplitude
    at = np.linspace(begin, end, SAMPLES, endpoint=False)
    around, force = moved(at), forced(at)
    work = 0.5 * force @ (np.roll(around, -1) - np.roll(around, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        loss_factor = work / (math.pi * stiffness * amplitude**2)
    return DamperLoop(
        begin=float(begin),
        end=float(end),
        amplitude=float(amplitude),
        stiffness=float(stiffness),
        loss_factor=float(loss_factor),
        work=float(work),
    )
