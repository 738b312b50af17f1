"""Where a motion leaves the domain in which its potential energy is finite."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import (
    ExpressionPotential,
    Potential,
    QuadraticPotential,
)
from fvi_cli.integrator.failure import Failure
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.intervals.functions import Interval
from fvi_cli.mathematics.intervals.singularities import find_open_places
from fvi_cli.mathematics.intervals.singularities import is_unbounded as has_no_bound

WALL_DISTANCES: Final = np.array([1e-2, 1e-4, 1e-6])
"""Distances from a place, in lengths of a chord, at which V is checked for growth."""
LEAST_GROWTH: Final = 0.01
"""Least growth of V towards a place, relative to V, that is more than round-off (a guess)."""


def first_undefined(potential: Potential | None, position: Array) -> int | None:
    """Index of the first of successive positions ``(n, d)`` that no motion reaches, or None.

    V is not finite there, or it is infinite somewhere on the chord from the position before: a long
    step may jump over a pole such as that of ``1/(a - x)``.
    """
    if potential is None or isinstance(potential, QuadraticPotential) or len(position) < 2:
        return None
    with np.errstate(all="ignore"):
        energy, first = potential.energy(position), position.shape[0]
        if not np.isfinite(energy).all():
            # an energy that overflows while its forces are finite is only large
            lost = np.isinf(energy) & ~np.isfinite(potential.gradient(position)).all(axis=1)
            wrong = np.flatnonzero(np.isnan(energy) | lost)
            # the start counts as reached, even if V is not finite there
            first = max(int(wrong[0]), 1) if wrong.size else first
        # poles of a user's functions are not searched for
        if (
            not isinstance(potential, ExpressionPotential)
            or potential.energy_expression.system.is_entire
        ):
            return first if first < position.shape[0] else None
        low, high = position[:first].min(axis=0), position[:first].max(axis=0)
        if may_be_unbounded(potential, low, high).any():
            jumped = _first_pole(potential, position[: first - 1], position[1:first])
            first = first if jumped is None else jumped + 1
    return first if first < position.shape[0] else None


def check_domain(
    potential: Potential | None, position: Array, per_step: int, times: Array, done: int
) -> tuple[int, Failure] | None:
    """The first step that leaves the domain of V, with the failure; None if all stay inside.

    `times` are the ends of n steps, which follow `done` earlier ones; `position` has the start and
    `per_step` positions of every step, ``(n per_step + 1, d)``.
    """
    found = first_undefined(potential, position)
    if found is None:
        return None
    index = (found - 1) // per_step
    step, time = done + index, float(times[index])
    words = f"step {step}, t = {time:.6g}: {undefined_near(position[found])}"
    return index, Failure(words, "irregular", step, time)


def undefined_near(position: Array) -> str:
    """Message on a step to a place that the motion cannot reach."""
    near = ", ".join(f"{value:.4g}" for value in position)
    return (
        f"the potential energy is not finite between the last point and q = [{near}]; "
        "take a smaller step if the motion itself stays away from there"
    )


def may_be_unbounded(
    potential: ExpressionPotential,
    low: Array,
    high: Array,
    parameters: dict[str, Array] | None = None,
) -> NDArray[np.bool_]:
    """Whether no finite range of V is known on boxes, ``(..., d)`` to ``(...)``.

    `parameters` of many potentials have the shape of the boxes.
    """
    names: dict[str, Interval | float | Array] = {**potential.parameters}
    names.update({name: Interval(one, one) for name, one in (parameters or {}).items()})
    for index, name in enumerate(potential.coordinates):
        names[name] = Interval(low[..., index], high[..., index])
    try:
        found = potential.energy_expression.system.evaluate(names)[0]
    except ExpressionError:
        # some functions have no known range
        found = 0.0
    return has_no_bound(found, low[..., 0])


def _first_pole(potential: ExpressionPotential, begin: Array, end: Array) -> int | None:
    """The first chord, from `begin` to `end`, both ``(n, d)``, on which V is infinite somewhere."""

    def is_open(chords: Places, low: Array, high: Array) -> NDArray[np.bool_]:
        ends = [_on(begin, end, chords, at) for at in (low, high)]
        return may_be_unbounded(potential, np.minimum(*ends), np.maximum(*ends))

    chords, places = find_open_places(is_open, np.zeros(len(begin)), np.ones(len(begin)))
    growing = np.zeros(chords.size, dtype=bool)
    for side in (-1.0, 1.0):
        at = places + side * WALL_DISTANCES[:, None]
        near = np.stack([_on(begin, end, chords, one) for one in at])
        sizes = np.abs(potential.energy(near))
        first, second = np.diff(sizes, axis=0)
        grows = (second > 0.5 * np.abs(first)) & (second > LEAST_GROWTH * sizes[0])
        # a finite limit, such as that of sin(x)/x at 0, is no pole
        ends = np.isnan(sizes[-1]) | (np.isinf(sizes[-1]) & np.isfinite(sizes[0]))
        growing |= (grows | ends) & ((at >= 0) & (at <= 1)).all(axis=0)
    return int(chords[growing].min()) if growing.any() else None


def _on(begin: Array, end: Array, chords: Places, at: Array) -> Array:
    """Points of chords, shape ``(m, d)``."""
    return np.asarray(begin[chords] + at[:, None] * (end[chords] - begin[chords]))
