r"""The solution's expansion in fractional powers at the start.

Solutions of fractional equations behave at the start like :math:`\sum a_\sigma t^\sigma` with
powers that are not integers (Diethelm, *The Analysis of Fractional Differential Equations*, 2010,
section 6.4), on which every quadrature loses order. The expansion is found by Picard iteration on
truncated series.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansions.values import MOST_EXPONENTS, Expansion
from fvi_cli.mathematics.series.power_series import (
    SERIES_FUNCTIONS,
    PowerSeries,
    SeriesError,
    expand,
)
from fvi_cli.mathematics.series.terms import CANCELLED, SAME_EXPONENT, gamma_ratio, merged_terms

Array = NDArray[np.float64]

FORCING_CUTOFF: Final = 8.0


def forcing_powers(scene: Scene) -> Array:
    """Powers of t with which the forcing starts.

    Raises
    ------
    SeriesError
        If it has no expansion in powers.
    """
    if scene.forcing is None:
        return np.empty(0)
    series = [expand(c, FORCING_CUTOFF) for c in scene.forcing.pieces[0].components]
    return np.concatenate([s.exponents[s.coefficients != 0] for s in series])


def separable_expansion(scene: Scene, cutoff: float) -> Expansion:
    """The expansion of a motion with a constant mass matrix, as :func:`solution_expansion`."""
    forcing = None
    if scene.forcing is not None:
        forcing = _forcing_expansion(scene.forcing.pieces[0], _needed(cutoff), 0.0)
    start = np.stack((scene.initial_position, scene.initial_velocity))
    gradient = _gradient_of(scene)
    if gradient is None:
        return _linear_motion(scene, start, forcing, _stiffness_of(scene), cutoff)
    return _nonlinear_motion(scene, start, forcing, gradient, cutoff)


def _needed(cutoff: float) -> float:
    """How far a force must be known: two integrations add two powers."""
    return max(cutoff - 2.0, 0.5)


def _linear_motion(
    scene: Scene, start: Array, force: Expansion | None, stiffness: Array | None, cutoff: float
) -> Expansion:
    """The motion that known and linear forces make, in one sweep."""
    motion = _Motion(scene, start, stiffness, cutoff)
    if force is not None:
        cutoff = min(cutoff, force.cutoff + 2.0)
        motion.drive(force)
    motion.complete(cutoff)
    return motion.below(cutoff)


def _nonlinear_motion(
    scene: Scene,
    start: Array,
    force: Expansion | None,
    gradient: Callable[[Expansion], Expansion],
    cutoff: float,
) -> Expansion:
    """The same where a potential is not quadratic, in a sweep for every two powers."""
    motion = _Motion(scene, start, None, cutoff)
    if force is not None:
        cutoff = min(cutoff, force.cutoff + 2.0)
        motion.drive(force)
    # besides x0 and v0 t every power exceeds 1: forces are integrable at 0
    known, driven = 1.0 + 1e-6, -math.inf
    while known < cutoff - SAME_EXPONENT:
        motion.complete(known)
        pull = gradient(motion.below(known))
        motion.drive(pull, factor=-1.0, since=driven)
        following = min(cutoff, pull.cutoff + 2.0)
        if following < known + 1e-6:
            raise SeriesError(f"the expansion cannot be continued beyond t^{known:.3g}")
        known, driven = following, pull.cutoff
    motion.complete(cutoff)
    return motion.below(cutoff)


class _Motion:
    r"""The motion under known and linear forces, from the lowest power up.

    .. math:: M x'' + \sum_j \mu_j D^{\gamma_j} x + K x = f

    Every term of the motion drives terms of higher powers only, so that each is complete when
    its turn comes.

    Parameters
    ----------
    scene
        Inertia, damping, and kind of derivative.
    start
        Initial position and velocity, shape ``(2, d)``.
    stiffness
        K, shape ``(d, d)``; None: zero.
    cutoff
        Terms from here on are not wanted.
    """

    def __init__(self, scene: Scene, start: Array, stiffness: Array | None, cutoff: float) -> None:
        self._cutoff, self._dimension = cutoff, scene.dimension
        self._subtracts = scene.derivative == "caputo"
        self._accelerate = _acceleration(scene.inertia.mass)
        self._drags = [(term.order, term.coefficient) for term in scene.active_damping]
        if stiffness is not None:
            self._drags.append((0.0, stiffness))
        self._exponents: list[float] = []
        self._totals: list[Array] = []
        self._sizes: list[Array] = []
        self._finished = 0
        for power, coefficient in enumerate(start):
            self._add(float(power), coefficient)

    def drive(self, force: Expansion, factor: float = 1.0, since: float = -math.inf) -> None:
        """Add what `factor` times the terms of a force from the power `since` on cause.

        Raises
        ------
        SeriesError
            If one of them is not integrable at 0.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            for exponent, row in zip(force.exponents.tolist(), force.coefficients, strict=True):
                if exponent >= since - SAME_EXPONENT:
                    self._push(exponent, factor * row)

    def complete(self, cutoff: float) -> None:
        """Let every term below `cutoff` drive others.

        Raises
        ------
        SeriesError
            If there are more than 128, if they come too close to each other, or if a force is not
            integrable at 0.
        """
        # coefficients of strong damping may exceed all numbers: a SeriesError, not a warning
        with np.errstate(over="ignore", invalid="ignore"):
            while self._finished < len(self._exponents):
                exponent = self._exponents[self._finished]
                if exponent >= cutoff - SAME_EXPONENT:
                    return
                self._drag(exponent, self._settled(self._finished))
                self._finished += 1

    def below(self, cutoff: float) -> Expansion:
        """The terms below `cutoff`, which are complete."""
        count = self._finished
        totals = np.array(self._totals[:count]).reshape(-1, self._dimension)
        return _truncated(np.array(self._exponents[:count]), totals, cutoff)

    def _settled(self, place: int) -> Array:
        """The sum of a term, 0 where it is smaller than its own round-off."""
        if place >= MOST_EXPONENTS:
            if not np.isfinite(self._totals).all():
                raise SeriesError("coefficients exceed all numbers: one is not finite")
            raise SeriesError(f"more than {MOST_EXPONENTS} exponents below t^{self._cutoff:g}")
        total = self._totals[place]
        # what is infinite has not cancelled
        cancelled = np.abs(total) < CANCELLED * self._sizes[place]
        if cancelled.any():
            self._totals[place] = total = np.where(cancelled, 0.0, total)
        return total

    def _drag(self, exponent: float, coefficient: Array) -> None:
        for order, matrix in self._drags:
            if self._subtracts and exponent < order and exponent in (0.0, 1.0):
                continue
            if not exponent - order + 2.0 > exponent + SAME_EXPONENT:
                raise SeriesError(f"the expansion cannot be continued beyond t^{exponent:.3g}")
            factor = gamma_ratio(exponent + 1.0, order)
            if factor != 0 and exponent - order + 2.0 < self._cutoff:
                self._push(exponent - order, -factor * (coefficient @ matrix))

    def _push(self, exponent: float, force: Array) -> None:
        if exponent <= -1 + SAME_EXPONENT and force.any():
            raise SeriesError(f"a force t**{exponent:g} is not integrable at 0")
        moved = exponent + 2.0
        self._add(moved, self._accelerate(force) / (moved * (moved - 1.0)))

    def _add(self, exponent: float, coefficient: Array) -> None:
        if exponent >= self._cutoff - SAME_EXPONENT or not coefficient.any():
            return
        place = bisect_left(self._exponents, exponent - SAME_EXPONENT)
        if place < len(self._exponents) and self._exponents[place] <= exponent + SAME_EXPONENT:
            self._totals[place] = self._totals[place] + coefficient
            self._sizes[place] = self._sizes[place] + np.abs(coefficient)
            return
        whole = round(exponent)
        near = abs(exponent - whole) <= SAME_EXPONENT
        self._exponents.insert(place, float(whole) if near else exponent)
        self._totals.insert(place, coefficient)
        self._sizes.insert(place, np.abs(coefficient))


def _acceleration(mass: Array) -> Callable[[Array], Array]:
    """From a force to the acceleration that it makes."""
    diagonal = np.diagonal(mass)
    if np.count_nonzero(mass) == np.count_nonzero(diagonal):
        return lambda force: np.asarray(force / diagonal)
    inverse = np.linalg.inv(mass)
    return lambda force: np.asarray(inverse @ force)


def _stiffness_of(scene: Scene) -> Array | None:
    potential = scene.potential
    return potential.stiffness if isinstance(potential, QuadraticPotential) else None


def _gradient_of(scene: Scene) -> Callable[[Expansion], Expansion] | None:
    """The force of a potential that is not quadratic; None where there is none."""
    potential = scene.potential
    if potential is None or isinstance(potential, QuadraticPotential):
        return None

    def gradient(series: Expansion) -> Expansion:
        values = potential.gradient_components(series.components, SERIES_FUNCTIONS)
        return _stacked(values, series.cutoff)

    return gradient


def _forcing_expansion(piece: ForcingPiece, cutoff: float, at: float) -> Expansion:
    return _stacked([expand(component, cutoff, at) for component in piece.components], cutoff)


def _stacked(values: list[PowerSeries | float] | list[PowerSeries], cutoff: float) -> Expansion:
    """Components side by side, known as far as the least known of them."""
    d = len(values)
    exponents, rows = [], []
    for index, value in enumerate(values):
        unit = np.eye(d)[index]
        if isinstance(value, PowerSeries):
            cutoff = min(cutoff, value.cutoff)
            exponents.append(value.exponents)
            rows.append(value.coefficients[:, None] * unit)
        else:
            exponents.append(np.zeros(1))
            rows.append(float(value) * unit[None])
    return _truncated(np.concatenate(exponents), np.concatenate(rows), cutoff)


def _truncated(exponents: Array, coefficients: Array, cutoff: float) -> Expansion:
    exponents, coefficients = merged_terms(exponents, coefficients, cutoff)
    return Expansion(exponents=exponents, coefficients=coefficients, cutoff=cutoff)
