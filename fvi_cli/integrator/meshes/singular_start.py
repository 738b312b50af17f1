r"""With which fractional power of the time a motion begins.

Near a singular point the position is a smooth function plus powers :math:`t^\sigma`; meshes that
are graded towards it need the least :math:`\sigma`. It follows from the equation of motion:
where the acceleration is like :math:`t^e`, the derivative of order gamma of the position is like
:math:`t^{e + 2 - \gamma}` and drives the position with :math:`t^{e + 4 - \gamma}`.
"""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.scene import Scene

FORCED_POWER = 2.5
"""Power to take where a force may begin like the root of t."""


def start_power(scene: Scene, *, at_start: bool) -> float | None:
    r"""Least fractional power of t in the position; None where the motion is smooth.

    Parameters
    ----------
    scene
        What moves.
    at_start
        At t = 0, or behind a break point of the force, where the acceleration jumps:
        :math:`4 - \gamma`.

    Notes
    -----
    At t = 0, Caputo: :math:`3 - \gamma` for :math:`\gamma < 1` and an initial velocity, otherwise
    :math:`4 - \gamma`. Riemann-Liouville: :math:`2 - \gamma` for an initial position,
    :math:`3 - \gamma` for an initial velocity. A force may begin with a power of its own; then no
    more than 2.5 is taken. A relaxation law whose kernel is like :math:`t^{-\gamma}`, or like a
    constant and :math:`t^a` (then :math:`\gamma = -a`), begins as a derivative of order gamma.
    """
    orders = [term.order for term in scene.active_damping if not term.is_integer_order]
    begins = [law.kernel.start_order for law in scene.active_laws]
    orders += [order for order in begins if order is not None]
    forced = scene.forcing is not None
    if not orders:
        return FORCED_POWER if forced and at_start else None
    if not at_start:
        return min(4.0 - order for order in orders)
    moving = bool(np.any(scene.initial_velocity != 0))
    displaced = bool(np.any(scene.initial_position != 0))
    powers = [FORCED_POWER] if forced else []
    for order in orders:
        if scene.derivative == "riemann-liouville" and displaced:
            powers.append(2.0 - order)
        elif moving and (order < 1 or scene.derivative == "riemann-liouville"):
            powers.append(3.0 - order)
        else:
            powers.append(4.0 - order)
    return min(powers)
