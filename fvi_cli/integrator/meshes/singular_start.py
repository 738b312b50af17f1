r"""With which fractional power of the time a motion begins.

Near a singular point the position is a smooth function plus powers :math:`t^\sigma`; meshes that
are graded towards it need the least :math:`\sigma`. It follows from the equation of motion:
where the acceleration is like :math:`t^e`, the derivative of order gamma of the position is like
:math:`t^{e + 2 - \gamma}` and drives the position with :math:`t^{e + 4 - \gamma}`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from fvi_cli.effects.forcing import ForceComponent, ForcingPiece, formula_of
from fvi_cli.effects.sampled import FunctionForce
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.method import AnyMethod, Baseline, ForcingQuadrature
from fvi_cli.mathematics.algebra.formulas import FormulaSystem

UNKNOWN_FORCE = 0.5
"""Power of t that is assumed for a force by a function of Python."""
_ROOTS: Mapping[str, float] = {"sqrt": 0.5, "cbrt": 1 / 3, "power": 0.5, "log": 0.5}
"""Powers of functions in formulas."""
TOUCHED = 1e-9
"""Arguments of roots below this share of those shortly behind count as zero."""


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


def order_on(scene: Scene, method: AnyMethod, grading: float = 1.0) -> float:
    """The order of a method on smooth data; nan where a scene is not known to let it have that.

    Equal steps, also graded ones :math:`t_k = T (k / N)^r`, have at most the order of the least
    fractional power of the position (times r), backward differences above order 2 err on any power
    in their first steps, and samples limit the order to that of their interpolation.
    """
    order, samples = method.order, () if scene.forcing is None else scene.forcing.samples
    if any(one.order < order for one in samples):
        return math.nan
    if isinstance(method, Baseline):
        is_reached = True
    elif method.start == "graded":
        # forces are known only to the order of the stages
        rough = any(term.order > 1 for term in scene.active_damping)
        return math.nan if rough and scene.lagrangian is not None and method.degree > 2 else order
    else:
        is_reached = method.is_runge_kutta or not scene.active_damping
        is_reached = is_reached or (order <= 2 and method.start == "none")
    powers = [start_power(scene, at_start=True)]
    powers += [start_power(scene, at_start=False)] if scene.break_points else []
    least = min((power for power in powers if power is not None), default=math.inf)
    return order if is_reached and grading * least >= order else math.nan


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
    """Powers by the roots of a formula whose argument vanishes at a time.

    They are no larger than those of the formula: t**0.5*t counts as t**0.5.
    """
    formula = formula_of(component)
    if formula is None:
        return (UNKNOWN_FORCE,) if isinstance(component, FunctionForce) else ()
    system, roots = formula.bound, []
    for place in system.needed:
        kind, *rest = system.instructions[place]
        power = float(rest[1]) if kind == "**" else _ROOTS.get(str(kind), 1.0)
        if not power.is_integer():
            roots.append((int(rest[0]), abs(power)))
    # values there, and shortly behind, to which those are compared
    times = np.array([at, 1.001 * at or 1.0])
    known = {**dict(formula.constants), "t": times}
    found = FormulaSystem(system.instructions, tuple(place for place, _ in roots)).evaluate(known)
    powers = []
    for value, (_, power) in zip(found, roots, strict=True):
        first, behind = np.abs(np.broadcast_to(np.asarray(value, dtype=float), 2))
        if not TOUCHED * behind < first < math.inf:
            powers.append(power)
    values = np.asarray(formula.evaluate({"t": times}))
    is_bounded = not np.isinf(values.flat[0])
    return tuple(powers if is_bounded else (-power for power in powers))
