r"""Force of a damper against its deformation, and what the last loop says of it.

With the work W of the loop, its amplitude a, half the range of the deformation, and the forces at
the largest and the least deformation,

.. math:: k = \frac{f(y_{\max}) - f(y_{\min})}{2 a}, \qquad
          \eta = \frac{W}{2 \pi \cdot \tfrac12 k a^2}, \qquad W = \oint f\, dy,

the equivalent stiffness and the loss factor, the energy of the loop over 2 pi times that of a
spring k at its peak (R.W. Clough, J. Penzien, *Dynamics of Structures*, 2003, section 3-7). Of a
linear law in steady harmonic motion these are :math:`\mathrm{Re}\,g` and
:math:`\mathrm{Im}\,g / \mathrm{Re}\,g` at its frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.observations.dampers import TOGETHER, damper_values, deformation_of
from fvi_cli.mathematics.arrays import Array
from fvi_cli.scenes.problem import Problem
from fvi_cli.studies.experiment import Experiment, FinishedRun

SAMPLES = 4000
"""Points of the closed polygon whose area is the work of a loop: it errs by (2 pi / n)^2 / 6."""
LEAST_AMPLITUDE = 1e-3
"""Part of the largest range below which a loop is of the decay behind a test, not of the test."""


@dataclass(frozen=True, kw_only=True)
class DamperLoop:
    """What the last loop of a damper says; numbers in the units of force and deformation."""

    amplitude: float
    stiffness: float
    loss_factor: float
    work: float
    begin: float
    end: float


def forces_of(experiment: Experiment) -> tuple[str, ...]:
    """Quantities that are the force of a damper, or a component of it."""
    problem, quantities = experiment.problem, experiment.observations.quantities or {}
    if not isinstance(problem, Problem):
        return ()
    known = damper_values(problem.scene)
    texts = {name: one.text.strip() for name, one in quantities.items()}
    return tuple(
        name for name, text in texts.items() if text in known and known[text].kind == "force"
    )


def deformation_against(item: FinishedRun, name: str) -> tuple[Array, Array]:
    """Deformation and force of the damper of a quantity, at the stored times, ``(n,)`` each."""
    experiment, trajectory = item.run.experiment, item.trajectory
    problem, observed = experiment.problem, trajectory.observed
    quantities = experiment.observations.quantities or {}
    if not isinstance(problem, Problem) or observed is None:
        raise ValueError(f"{name}: the run has no forces of dampers")
    value = damper_values(problem.scene)[quantities[name].text.strip()]
    place = max(value.place, 0) if value.place == TOGETHER else value.place
    deformation = deformation_of(problem.scene, place, trajectory.position)
    return deformation[:, value.component], observed.quantities[name]


def last_loop(time: Array, deformation: Array, force: Array) -> DamperLoop | None:
    """The loop between the last two rises of the deformation through the middle of its range.

    Between the points both are cubic polynomials. Loops of less than a thousandth of the range,
    such as those that round-off makes of rest, do not count; None where there is no other.
    """
    finite = np.isfinite(time) & np.isfinite(deformation) & np.isfinite(force)
    t, y, f = time[finite], deformation[finite], force[finite]
    if t.size < 4:
        return None
    least = LEAST_AMPLITUDE * np.ptp(y)
    above = y - 0.5 * (y.max() + y.min()) > 0
    rises = np.flatnonzero(~above[:-1] & above[1:])
    for first, last in zip(rises[-2::-1], rises[:0:-1], strict=False):
        if np.ptp(y[first : last + 1]) <= least:
            continue
        middle = 0.5 * (y.max() + y.min())
        begin, end = (_crossing(t, y, int(one), middle) for one in (first, last))
        at = np.linspace(begin, end, SAMPLES, endpoint=False)
        around, force = _cubic(t, y, at), _cubic(t, f, at)
        work = 0.5 * float(force @ (np.roll(around, -1) - np.roll(around, 1)))
        high, low = int(around.argmax()), int(around.argmin())
        amplitude = 0.5 * float(around[high] - around[low])
        stiffness = 0.5 * float(force[high] - force[low]) / amplitude
        peak = 0.5 * stiffness * amplitude**2
        return DamperLoop(
            amplitude=amplitude,
            stiffness=stiffness,
            loss_factor=work / (2.0 * math.pi * peak) if peak > 0 else math.inf,
            work=work,
            begin=begin,
            end=end,
        )
    return None


def _crossing(t: Array, y: Array, index: int, level: float) -> float:
    """Where a rise between two points meets a level, by bisection of the cubic."""
    low, high = float(t[index]), float(t[index + 1])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if _cubic(t, y, np.array([middle]))[0] > level:
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def _cubic(t: Array, values: Array, at: Array) -> Array:
    """Piecewise cubics through points, with the slopes of parabolas through three of them."""
    slopes = np.gradient(values, t)
    index = np.clip(np.searchsorted(t, at, side="right") - 1, 0, t.size - 2)
    h = t[index + 1] - t[index]
    s = (at - t[index]) / h
    begin, end = values[index], values[index + 1]
    return np.asarray(
        (1 + 2 * s) * (1 - s) ** 2 * begin
        + s**2 * (3 - 2 * s) * end
        + h * s * (1 - s) * ((1 - s) * slopes[index] - s * slopes[index + 1])
    )
