"""The expansion at t = 0 of the motion of a general Lagrangian."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansions.values import MOST_EXPONENTS, Expansion
from fvi_cli.mathematics.series.power_series import (
    SERIES_FUNCTIONS,
    PowerSeries,
    SeriesError,
    expand,
)
from fvi_cli.mathematics.series.terms import SAME_EXPONENT, merged_terms

Array = NDArray[np.float64]

MOST_SWEEPS: Final = 300
SETTLED: Final = 1e-12


def lagrangian_expansion(scene: Scene, lagrangian: Lagrangian, cutoff: float) -> Expansion:
    r"""The solution's expansion below t**cutoff, by iteration on the momentum.

    .. math:: v \leftarrow v + W^{-1} \Bigl[p_0 + J\Bigl(f - \sum_j \mu_j D^{\gamma_j} q
              + \partial_q L(q, v, t)\Bigr) - \partial_v L(q, v, t)\Bigr], \qquad q = q_0 + J v

    with W the mass matrix at the start and J the integral from 0. Every sweep determines more
    powers; it ends when no coefficient below the cutoff changes any more.

    Raises
    ------
    SeriesError
        If forcing or Lagrangian have no expansion in powers of t that reaches the cutoff, or more
        than 128 exponents lie below it.
    """
    d, known = scene.dimension, cutoff - 1.0
    inverse = np.linalg.inv(scene.inertia.mass)
    momentum = lagrangian.momentum(scene.initial_position, scene.initial_velocity, 0.0)
    time = PowerSeries.variable(known)
    force = [PowerSeries.constant(0.0, known) for _ in range(d)]
    if scene.forcing is not None:
        reach = max(cutoff - 2.0, 0.5)
        force = [expand(c, reach) for c in scene.forcing.pieces[0].components]
    velocity = [PowerSeries.constant(float(v), known) for v in scene.initial_velocity]
    for _ in range(MOST_SWEEPS):
        position = _positions(scene, velocity, cutoff)
        _check(position)
        moments, pulls = lagrangian.first_on(position, velocity, time, SERIES_FUNCTIONS)
        drag = _damping(scene, position)
        excess = []
        for a in range(d):
            total = force[a] + drag[a] + pulls[a]
            if total.exponents.size and total.exponents[0] <= -1 + SAME_EXPONENT:
                raise SeriesError(f"a force t**{total.exponents[0]:g} is not integrable at 0")
            excess.append(total.antiderivative() + float(momentum[a]) - moments[a])
        following = []
        for a in range(d):
            update = velocity[a]
            for b in range(d):
                update = update + excess[b] * float(inverse[a, b])
            if update.cutoff < known - SAME_EXPONENT:
                raise SeriesError(
                    f"the expansion cannot be continued beyond t^{update.cutoff + 1:.3g}"
                )
            following.append(update.truncated(known))
        if _same(velocity, following):
            return _stacked(_positions(scene, following, cutoff), cutoff)
        velocity = following
    raise SeriesError(f"more than {MOST_SWEEPS} sweeps are needed to reach t^{cutoff:g}")


def _positions(scene: Scene, velocity: list[PowerSeries], cutoff: float) -> list[PowerSeries]:
    return [
        (v.antiderivative() + float(q)).truncated(cutoff)
        for q, v in zip(scene.initial_position, velocity, strict=True)
    ]


def _damping(scene: Scene, position: list[PowerSeries]) -> list[PowerSeries]:
    """- mu D**order of the position, Caputo or Riemann-Liouville as the scene says."""
    total = [PowerSeries.constant(0.0, series.cutoff) for series in position]
    for term in scene.active_damping:
        moving = position
        if scene.derivative == "caputo":
            moving = [series.without_initial_terms(term.order) for series in position]
        rates = [series.fractional_derivative(term.order) for series in moving]
        for a, row in enumerate(term.coefficient):
            for b in np.flatnonzero(row):
                total[a] = total[a] - rates[int(b)] * float(row[b])
    return total


def _same(before: list[PowerSeries], after: list[PowerSeries]) -> bool:
    """Whether the coefficients agree, relative to the largest of the same power."""
    old, new = _stacked(before, np.inf), _stacked(after, np.inf)
    change = _stacked([b - a for a, b in zip(before, after, strict=True)], np.inf)
    scale = max(float(np.abs(new.coefficients).max(initial=0.0)), 1e-300)
    for exponent, row in zip(change.exponents, change.coefficients, strict=True):
        sizes = [
            np.abs(series.coefficients[np.abs(series.exponents - exponent) <= SAME_EXPONENT])
            for series in (old, new)
        ]
        own = max(float(entries.max(initial=0.0)) for entries in sizes)
        if np.abs(row).max() > SETTLED * max(own, 1e-4 * scale):
            return False
    return True


def _check(position: list[PowerSeries]) -> None:
    exponents = np.unique(np.concatenate([np.round(s.exponents, 9) for s in position]))
    if exponents.size > MOST_EXPONENTS:
        raise SeriesError(f"more than {MOST_EXPONENTS} exponents below t^{position[0].cutoff:g}")


def _stacked(values: list[PowerSeries], cutoff: float) -> Expansion:
    d = len(values)
    units = np.eye(d)
    exponents, coefficients = merged_terms(
        np.concatenate([series.exponents for series in values]),
        np.concatenate([s.coefficients[:, None] * units[i] for i, s in enumerate(values)]),
        cutoff,
    )
    return Expansion(exponents=exponents, coefficients=coefficients, cutoff=cutoff)
