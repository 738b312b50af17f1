r"""With which fractional power of the time a motion begins.

Near a singular point the position is a smooth function plus powers :math:`t^\sigma`; meshes that
are graded towards it need the least :math:`\sigma`. It follows from the equation of motion:
where the acceleration is like :math:`t^e`, the derivative of order gamma of the position is like
:math:`t^{e + 2 - \gamma}` and drives the position with :math:`t^{e + 4 - \gamma}`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, ForcingPiece, formula_of
from fvi_cli.effects.matrices import times
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import ForcingQuadrature
from fvi_cli.mathematics.algebra.arithmetic import ExpressionError
from fvi_cli.mathematics.series.power_series import SeriesError, expand

UNKNOWN_FORCE = 0.5
"""Power of t that is assumed for a force without an expansion in powers of t."""
LARGEST_POWER = 12.0
"""Powers of a force from this one on do not matter, whatever the method."""


def start_power(
    scene: Scene, *, at_start: bool, forcing_quadrature: ForcingQuadrature = "galerkin"
) -> float | None:
    r"""Least fractional power of t in the position or its errors; None where all is smooth.

    After a break point of the force the acceleration jumps: :math:`4 - \gamma`, and the force may
    begin with a fractional power as at the start. The rule of the action errs on a force
    :math:`t^e` like :math:`t^{e + 1}` in the momentum, an exact one only through the motion,
    :math:`t^{e + 2}`.

    Notes
    -----
    At t = 0, Caputo: :math:`3 - \gamma` for :math:`\gamma < 1` and an initial velocity, otherwise
    :math:`4 - \gamma`. Riemann-Liouville: :math:`2 - \gamma` for an initial position,
    :math:`3 - \gamma` for an initial velocity. A relaxation law whose kernel is like
    :math:`t^{-\gamma}`, or like a constant and :math:`t^a` (then :math:`\gamma = -a`), begins as a
    derivative of order gamma.
    """
    orders = [term.order for term in scene.active_damping if not term.is_integer_order]
    begins = [law.kernel.start_order for law in scene.active_laws]
    orders += [order for order in begins if order is not None]
    more = 1.0 if forcing_quadrature == "galerkin" else 2.0
    if not at_start:
        powers = [4.0 - order for order in orders]
        powers += [e + more for at in scene.break_points for e in powers_behind(scene, at)]
        return min(powers, default=None)
    powers = []
    if scene.forcing is not None:
        own = fractional_power(scene.forcing.pieces[0])
        if own is not None:
            powers.append(own + more)
    moving = bool(np.any(scene.initial_velocity != 0))
    displaced = bool(np.any(scene.initial_position != 0))
    for order in orders:
        if scene.derivative == "riemann-liouville" and displaced:
            powers.append(2.0 - order)
        elif moving and (order < 1 or scene.derivative == "riemann-liouville"):
            powers.append(3.0 - order)
        else:
            powers.append(4.0 - order)
    return min(powers, default=None)


def rate_jumps(scene: Scene) -> bool:
    """Whether a damping force is like t**(1 - order) at t = 0 with an order above 1.

    Riemann-Liouville derivatives of a motion with an initial velocity are such forces.
    """
    return scene.derivative == "riemann-liouville" and any(
        term.order > 1 and np.any(times(scene.initial_velocity, term.form) != 0)
        for term in scene.active_damping
    )


LEAST_POWER = -0.9
"""Least power of a force: a steeper one gives much of its momentum before a first step can end."""


def fractional_power(piece: ForcingPiece) -> float | None:
    """Least fractional power of t with which a force begins; None where it begins smoothly."""
    found = [power for one, _ in piece.distinct for power in _fractional_powers(one, 0.0)]
    return min(found, default=None)


def powers_behind(scene: Scene, break_point: float) -> tuple[float, ...]:
    """Fractional powers of t - b with which the force begins after a break point b."""
    if scene.forcing is None:
        return ()
    ends = [piece.until for piece in scene.forcing.pieces]
    piece = scene.forcing.pieces[ends.index(break_point) + 1]
    formulas = filter(None, (formula_of(one) for one, _ in piece.distinct))
    return tuple(e for one in formulas for e in _fractional_powers(one, break_point))


@lru_cache(maxsize=256)
def _fractional_powers(component: ForceComponent, at: float) -> tuple[float, ...]:
    try:
        series = expand(component, LARGEST_POWER, at)
    except (SeriesError, ExpressionError):
        return (UNKNOWN_FORCE,)
    powers = series.exponents[series.coefficients != 0].tolist()
    return tuple(power for power in powers if abs(power - round(power)) > 1e-9)
