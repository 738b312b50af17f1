r"""The motion's expansion in fractional powers of time at the start.

Solutions of fractional equations behave at the start like :math:`\sum a_\sigma t^\sigma` with
powers that are not integers (Diethelm, *The Analysis of Fractional Differential Equations*, 2010,
section 6.4), on which every quadrature loses order.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.potential import (
    ExpressionPotential,
    SuppliedPotential,
)
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.series.power_series import (
    PowerSeries,
    SeriesError,
    expand,
)
from fvi_cli.mathematics.series.terms import (
    SAME_EXPONENT,
    initial_terms,
    merged_terms,
    power_rule,
)

Components = Sequence[PowerSeries | float]

MOST_EXPONENTS: Final = 128  # of an expansion
FORCING_CUTOFF: Final = 8.0  # power of t up to which a forcing is examined
SLIGHTLY: Final = 1e-6  # margin of a power of t


@dataclass(frozen=True, kw_only=True, eq=False)
class Expansion:
    r"""The vector series :math:`\sum_i a_i t^{\sigma_i}`."""

    exponents: Array  # the powers that occur, increasing, shape (n,)
    coefficients: Array  # the a_i, none of them 0 in all components, shape (n, d)

    def components(self, cutoff: float) -> list[PowerSeries]:
        """One scalar series for every component, known up to `cutoff`."""
        return [
            PowerSeries(exponents=self.exponents, coefficients=column, cutoff=cutoff)
            for column in self.coefficients.T
        ]


def forcing_powers(scene: Scene) -> Array:
    """Powers of t with which the forcing starts.

    Raises
    ------
    SeriesError
        If it has no expansion in powers.
    """
    return np.concatenate([[], *(series.exponents for series in _forcing(scene, FORCING_CUTOFF))])


def solution_expansion(scene: Scene, cutoff: float) -> Expansion:
    r"""The motion's expansion at t = 0 below t**cutoff.

    .. math:: M q'' = f - \sum_j \mu_j D^{\gamma_j} q + \partial_q L(q, q', t)
              - \frac{d}{dt} \bigl[\partial_v L(q, q', t) - M q'\bigr]

    with M the mass matrix at the start: for energies that separate, the last term vanishes and the
    one before is the force of the potential. Known and linear forces give a term from the terms
    below it; other forces are expanded again whenever the motion is known further.

    Raises
    ------
    SeriesError
        If forcing or energies have no expansion in powers of t that reaches the cutoff, or more
        than 128 exponents lie below it.
    """
    motion = _Motion(scene, cutoff)
    motion.add_force(_forcing(scene, max(cutoff - 2.0, 0.5)))
    force = _nonlinear_force(scene)
    # besides x0 and v0 t every power exceeds 1: forces are integrable at 0
    known, driven = cutoff if force is None else 1.0 + SLIGHTLY, -math.inf
    expansion = motion.completed(known)
    while force is not None and known < cutoff - SAME_EXPONENT:
        terms = force(expansion.components(known))
        motion.add_force(terms, since=driven)
        driven = min(series.cutoff for series in terms if isinstance(series, PowerSeries))
        if driven + 2.0 < known + SLIGHTLY / 2:
            raise SeriesError(f"the expansion cannot be continued beyond t^{known:.3g}")
        known = min(cutoff, driven + 2.0)
        expansion = motion.completed(known)
    return expansion


class _Motion:
    r"""The motion by known and linear forces, from the lowest power up.

    .. math:: M q'' + \sum_j \mu_j D^{\gamma_j} q + K q = f

    Every term of the motion causes terms of higher powers only, so that each is complete when
    its turn comes.
    """

    def __init__(self, scene: Scene, cutoff: float) -> None:
        self._cutoff, self._subtracts = cutoff, scene.derivative == "caputo"
        self._inverse_mass = np.linalg.inv(scene.inertia.mass)
        self._linear_terms = [(term.order, term.matrix) for term in scene.active_damping]
        self._linear_terms.append((0.0, scene.stiffness))
        self._stride = 2.0 - max(order for order, _ in self._linear_terms)
        self._exponents, self._coefficients = np.empty(0), np.empty((0, scene.dimension))
        self._waiting_exponents = np.array([0.0, 1.0])
        self._waiting = np.stack((scene.initial_position, scene.initial_velocity))

    def add_force(self, force: Components, since: float = -math.inf) -> None:
        """Add the terms of the motion that a force causes by its powers from `since` on."""
        if force:
            exponents, rows = _stacked(force)
            later = exponents >= since - SAME_EXPONENT
            self._push(exponents[later], rows[later])

    def completed(self, cutoff: float) -> Expansion:
        """The terms below `cutoff`, with all terms that they cause."""
        # coefficients of strong damping may exceed all numbers: a SeriesError, not a warning
        with np.errstate(over="ignore", invalid="ignore"):
            while (first := self._waiting_exponents.min(initial=math.inf)) < cutoff - SAME_EXPONENT:
                if self._stride <= SAME_EXPONENT:
                    raise SeriesError(f"the expansion cannot be continued beyond t^{first:.3g}")
                self._complete(min(cutoff, first + self._stride))
        return Expansion(exponents=self._exponents, coefficients=self._coefficients)

    def _complete(self, cutoff: float) -> None:
        """Complete the waiting terms below `cutoff`, which do not cause each other."""
        now = self._waiting_exponents < cutoff - SAME_EXPONENT
        exponents, rows = merged_terms(self._waiting_exponents[now], self._waiting[now], cutoff)
        self._waiting_exponents, self._waiting = self._waiting_exponents[~now], self._waiting[~now]
        self._exponents = np.append(self._exponents, exponents)
        self._coefficients = np.concatenate((self._coefficients, rows))
        if self._exponents.size > MOST_EXPONENTS:
            raise SeriesError(f"more than {MOST_EXPONENTS} exponents below t^{self._cutoff:g}")
        for order, matrix in self._linear_terms:
            acting = exponents - order + 2.0 < self._cutoff
            if self._subtracts:
                acting &= ~initial_terms(exponents, order)
            factors = power_rule(exponents[acting], order)
            self._push(exponents[acting] - order, -factors[:, None] * (rows[acting] @ matrix))

    def _push(self, exponents: Array, force: Array) -> None:
        acting = force.any(axis=1) & (exponents + 2.0 < self._cutoff - SAME_EXPONENT)
        moved, force = exponents[acting] + 2.0, force[acting]
        if (moved <= 1 + SAME_EXPONENT).any():
            raise SeriesError(f"a force t**{moved.min() - 2.0:g} is not integrable at 0")
        caused = force @ self._inverse_mass / (moved * (moved - 1.0))[:, None]
        self._waiting_exponents = np.append(self._waiting_exponents, moved)
        self._waiting = np.concatenate((self._waiting, caused))


def _forcing(scene: Scene, cutoff: float) -> list[PowerSeries]:
    if scene.forcing is None:
        return []
    return [expand(component, cutoff) for component in scene.forcing.pieces[0].components]


def _nonlinear_force(scene: Scene) -> Callable[[list[PowerSeries]], Components] | None:
    """From the motion so far, the forces that are not linear in it; None where there are none."""
    if scene.lagrangian is not None:
        lagrangian, mass = scene.lagrangian, scene.inertia.mass
        return lambda position: _force_of_lagrangian(lagrangian, mass, position)
    if isinstance(scene.potential, ExpressionPotential):
        potential = scene.potential
        return lambda position: [-value for value in potential.gradient_components(position)]
    if isinstance(scene.potential, SuppliedPotential):
        at = scene.initial_position
        force, curvature = -scene.potential.gradient(at), scene.potential.hessian(at)
        return lambda position: _linear_force(force, curvature, at, position)
    return None


def _linear_force(
    force: Array, curvature: Array, start: Array, position: list[PowerSeries]
) -> Components:
    """Force less curvature times displacement, cut off at the unknown square of displacement."""
    displacement = [series - float(at) for series, at in zip(position, start, strict=True)]
    known = 2.0 * min(series.leading_exponent for series in displacement)
    return [
        sum(
            (series * -float(entry) for entry, series in zip(row, displacement, strict=True)),
            start=PowerSeries.constant(float(own), known),
        )
        for own, row in zip(force, curvature, strict=True)
    ]


def _force_of_lagrangian(
    lagrangian: Lagrangian, mass: Array, position: list[PowerSeries]
) -> Components:
    r"""The force :math:`\partial_q L - \frac{d}{dt} [\partial_v L - M q']`.

    The term in brackets has no derivative by the velocity at the start: the unknown part of the
    velocity, from t**s on, is multiplied by a factor that begins like the velocity's first power,
    and enters later by this power.
    """
    velocity = [series.derivative() for series in position]
    unknown = velocity[0].cutoff
    first = min(
        [1.0, unknown, *(float(e) for series in velocity for e in series.exponents if e > 0)]
    )
    velocity = [replace(series, cutoff=unknown + first) for series in velocity]
    time = PowerSeries.variable(unknown + first)
    momenta, potential_forces = lagrangian.forces_on(position, velocity, time)
    forces = []
    for momentum, potential_force, row in zip(momenta, potential_forces, mass, strict=True):
        inertial = sum(
            (series * float(entry) for entry, series in zip(row, velocity, strict=True)),
            start=PowerSeries.constant(0.0, math.inf),
        )
        forces.append(potential_force - (momentum - inertial).derivative())
    return forces


def _stacked(components: Components) -> tuple[Array, Array]:
    """Exponents and coefficients, shape ``(n, d)``, known as far as the least known component."""
    units = np.eye(len(components))
    series = [PowerSeries.constant(0.0, math.inf) + one for one in components]
    return merged_terms(
        np.concatenate([one.exponents for one in series]),
        np.concatenate([one.coefficients[:, None] * units[i] for i, one in enumerate(series)]),
        min(one.cutoff for one in series),
    )
