r"""The solution's expansion in fractional powers, at the start and after jumps of the force.

Solutions of fractional equations behave at the start like :math:`\sum a_\sigma t^\sigma` with
powers that are not integers (Diethelm, *The Analysis of Fractional Differential Equations*, 2010,
section 6.4), on which every quadrature loses order. The expansion is found by Picard iteration on
truncated series.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.forcing import ForcingPiece
from fvi_cli.effects.potential import ExpressionPotential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.mathematics.power_series import (
    SAME_EXPONENT,
    SERIES_FUNCTIONS,
    PowerSeries,
    SeriesError,
    expand,
    initial_terms,
    merged_terms,
    power_rule,
)

Array = NDArray[np.float64]

MOST_EXPONENTS: Final = 128
MOST_SWEEPS: Final = 1000


@dataclass(frozen=True, kw_only=True, eq=False)
class Expansion:
    r"""The vector series :math:`\sum_i a_i t^{\sigma_i} + O(t^Q)`.

    Parameters
    ----------
    exponents
        Increasing powers, shape ``(n,)``.
    coefficients
        The :math:`a_i`, shape ``(n, d)``.
    cutoff
        Q.
    """

    exponents: Array
    coefficients: Array
    cutoff: float

    @property
    def components(self) -> tuple[PowerSeries, ...]:
        """One scalar series for every component."""
        return tuple(
            PowerSeries(exponents=self.exponents, coefficients=column, cutoff=self.cutoff)
            for column in self.coefficients.T
        )

    @property
    def is_smooth(self) -> bool:
        """Whether no power below the cutoff is fractional."""
        return bool(np.all(self.exponents == np.round(self.exponents)))


def solution_series(scene: Scene, cutoff: float) -> tuple[PowerSeries, ...]:
    """The solution's expansion at t = 0 below t**cutoff, one series per component.

    Raises
    ------
    SeriesError
        If forcing or potential have no expansion in powers of t, or more than 128 exponents lie
        below the cutoff.
    """
    return solution_expansion(scene, cutoff).components


def solution_expansion(scene: Scene, cutoff: float) -> Expansion:
    r"""The solution's expansion at t = 0, by Picard iteration.

    .. math:: x \leftarrow x_0 + v_0 t + J^2 M^{-1}\Bigl[f - \sum_j \mu_j D^{\gamma_j} x
              - \nabla V(x)\Bigr]

    Every sweep determines more powers; the series keep account of how many.

    Raises
    ------
    SeriesError
        As :func:`solution_series`.
    """
    if scene.lagrangian is not None:
        from fvi_cli.integrator.lagrangian_expansion import lagrangian_expansion

        return lagrangian_expansion(scene, scene.lagrangian, cutoff)
    forcing = None
    if scene.forcing is not None:
        forcing = _forcing_expansion(scene.forcing.pieces[0], _needed(cutoff), 0.0)
    return _picard(
        scene,
        start=np.stack((scene.initial_position, scene.initial_velocity)),
        forcing=forcing,
        gradient=_gradient_of(scene),
        cutoff=cutoff,
    )


def jump_expansion(
    scene: Scene, break_point: float, cutoff: float, stiffness: Array | None = None
) -> Expansion:
    r"""The response, from rest, to the jump of the forcing at a break point.

    The difference of what the forcing is after and before the break point is expanded in
    :math:`t - t_b`, kinks included, and drives the linear equation. The potential of a nonlinear
    scene enters by its Hessian at the break point, where that is known; the response is then
    determined only four powers (five with the Hessian) above that of the jump, and cut off there.

    Parameters
    ----------
    scene
        Scene with a forcing in pieces.
    break_point
        The time :math:`t_b` where one piece ends.
    cutoff
        Q.
    stiffness
        For a nonlinear potential, its Hessian at :math:`x(t_b)`, shape ``(d, d)``.

    Raises
    ------
    SeriesError
        If one of the pieces has no expansion there, and for a general Lagrangian.
    ValueError
        If no piece of the forcing ends at `break_point`.
    """
    breaks = () if scene.forcing is None else scene.forcing.break_points
    if scene.forcing is None or break_point not in breaks:
        raise ValueError(f"break_point: {break_point!r} is not one of {list(breaks)}")
    if scene.lagrangian is not None:
        raise SeriesError("the response of a general Lagrangian to a jump is not expanded")
    index = breaks.index(break_point)
    before, after = scene.forcing.pieces[index : index + 2]
    jump = _sum(
        [
            _forcing_expansion(after, _needed(cutoff), break_point),
            _scaled(_forcing_expansion(before, _needed(cutoff), break_point), -1.0),
        ]
    )
    gradient = _gradient_of(scene)
    if isinstance(scene.potential, ExpressionPotential):
        known = 4.0 if stiffness is None else 5.0
        if jump.exponents.size:
            cutoff = min(cutoff, float(jump.exponents[0]) + known)
        gradient = None if stiffness is None else _linear_gradient(stiffness)
    d = scene.dimension
    return _picard(scene, start=np.zeros((2, d)), forcing=jump, gradient=gradient, cutoff=cutoff)


def forcing_is_smooth(scene: Scene, cutoff: float) -> bool:
    """Whether the forcing starts with integer powers only."""
    if scene.forcing is None:
        return True
    return _forcing_expansion(scene.forcing.pieces[0], _needed(cutoff), 0.0).is_smooth


def _needed(cutoff: float) -> float:
    """How far a force must be known: two integrations add two powers."""
    return max(cutoff - 2.0, 0.5)


def _picard(
    scene: Scene,
    *,
    start: Array,
    forcing: Expansion | None,
    gradient: Callable[[Expansion], Expansion] | None,
    cutoff: float,
) -> Expansion:
    # Besides x0 and v0 t every power exceeds 1: forces are integrable at 0.
    current = _truncated(np.arange(2.0), start, 1.0 + 1e-6)
    for _ in range(MOST_SWEEPS):
        # coefficients of strong damping may exceed all numbers: a SeriesError, not a warning
        with np.errstate(over="ignore", invalid="ignore"):
            following = _picard_sweep(current, scene, start, forcing, gradient, cutoff)
        if following.exponents.size > MOST_EXPONENTS:
            raise SeriesError(f"more than {MOST_EXPONENTS} exponents below t^{cutoff:g}")
        if following.cutoff >= cutoff - SAME_EXPONENT:
            return following
        if following.cutoff < current.cutoff + 1e-6:
            raise SeriesError(f"the expansion cannot be continued beyond t^{current.cutoff:.3g}")
        current = following
    raise SeriesError(f"more than {MOST_SWEEPS} sweeps are needed to reach t^{cutoff:g}")


def _picard_sweep(
    current: Expansion,
    scene: Scene,
    start: Array,
    forcing: Expansion | None,
    gradient: Callable[[Expansion], Expansion] | None,
    cutoff: float,
) -> Expansion:
    """What the forces of `current` make of the motion, as far as they are known."""
    forces = [] if forcing is None else [forcing]
    forces += [
        _damping_force(current, term.order, term.coefficient, scene)
        for term in scene.active_damping
    ]
    if gradient is not None:
        forces.append(_scaled(gradient(current), -1.0))
    force = _sum(forces) if forces else _truncated(np.empty(0), start[:0], cutoff)
    if force.exponents.size and force.exponents[0] <= -1 + SAME_EXPONENT:
        raise SeriesError(f"a force t**{force.exponents[0]:g} is not integrable at 0")
    moved = force.exponents + 2.0
    response = np.linalg.solve(scene.inertia.mass, force.coefficients.T).T
    response = response / (moved * (moved - 1.0))[:, None]
    return _truncated(
        np.concatenate((np.arange(2.0), moved)),
        np.concatenate((start, response)),
        min(cutoff, force.cutoff + 2.0),
    )


def _damping_force(series: Expansion, order: float, coefficient: Array, scene: Scene) -> Expansion:
    """- mu D**order of the series, Caputo or Riemann-Liouville as the scene says."""
    kept = np.ones(series.exponents.shape, dtype=bool)
    if scene.derivative == "caputo":
        kept = ~initial_terms(series.exponents, order)
    exponents = series.exponents[kept]
    factors = -power_rule(exponents, order)
    return _truncated(
        exponents - order,
        factors[:, None] * (series.coefficients[kept] @ coefficient),
        series.cutoff - order,
    )


def _gradient_of(scene: Scene) -> Callable[[Expansion], Expansion] | None:
    potential = scene.potential
    if potential is None:
        return None
    if isinstance(potential, QuadraticPotential):
        return _linear_gradient(potential.stiffness)

    def gradient(series: Expansion) -> Expansion:
        values = potential.gradient_components(series.components, SERIES_FUNCTIONS)
        return _stacked(values, series.cutoff)

    return gradient


def _linear_gradient(stiffness: Array) -> Callable[[Expansion], Expansion]:
    def gradient(series: Expansion) -> Expansion:
        return _truncated(series.exponents, series.coefficients @ stiffness, series.cutoff)

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


def _scaled(series: Expansion, factor: float) -> Expansion:
    return _truncated(series.exponents, factor * series.coefficients, series.cutoff)


def _sum(series: list[Expansion]) -> Expansion:
    return _truncated(
        np.concatenate([one.exponents for one in series]),
        np.concatenate([one.coefficients for one in series]),
        min(one.cutoff for one in series),
    )
