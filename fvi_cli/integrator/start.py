r"""Singular starts: a window that carries the solution's expansion at 0 and at jumps.

The expansion, multiplied by a decaying exponential, gives a known function S such that x - S
starts as smoothly as the method can use.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.expansion import (
    Expansion,
    forcing_is_smooth,
    jump_expansion,
    solution_expansion,
)
from fvi_cli.integrator.series_reach import sizes_by_mass, time_of_validity
from fvi_cli.mathematics.graded_panels import tabulated
from fvi_cli.mathematics.power_series import SAME_EXPONENT, PowerSeries, SeriesError
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]
StepFunction = Callable[[Array, float, Array], Array]

LISTED_POWERS: Final = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class StartDecision:
    r"""Whether a start series is used, and why.

    Parameters
    ----------
    use
        Whether to solve for x - S.
    reason
        In words for the reader of a table.
    wanted
        Whether there is something that a series could take away.
    window
        S; None unless it is used.
    tau
        Time on which the expansion is good: the largest t at which its last terms (powers from
        Q - 2) add up to no more than the others (powers in (0, Q - 2)). 0 when there is none.
    expansion
        The expansion that S matches; None when there is none.
    """

    use: bool
    reason: str
    wanted: bool = True
    window: WindowedSeries | None = None
    tau: float = 0.0
    expansion: Expansion | None = None


@dataclass(frozen=True, kw_only=True)
class WindowRule:
    r"""How fast the window decays and how well it must be resolved, in units of tau.

    Parameters
    ----------
    decays
        :math:`\lambda\tau`.
    steps
        Least :math:`\tau / h` for which the window is used.
    powers
        Q less the order of the method: how many powers beyond that order the series carries.
    powers_lost
        l: without series the maximal error on :math:`t^\sigma` is of order :math:`\sigma - l`; 0
        for Runge-Kutta convolution quadrature, 1 for BDF.
    integer_powers
        Whether integer powers are a reason for a series as well: backward differences lose order
        on every power at the start.
    largest_cost
        Limit of the window's own error, relative to that of the singular terms it removes: with
        the order p, the limit of the quotient of

        .. math:: \Bigl(\frac{h}{\tau}\Bigr)^p \sum_\sigma |a_\sigma| \tau^\sigma
                  \quad\text{and}\quad \max_{\sigma \notin Z,\, \sigma - l < p}
                  |a_\sigma| \tau^\sigma \Bigl(\frac{h}{\tau}\Bigr)^{\sigma - l} .
    """

    decays: float = 4.0
    steps: float = 4.0
    powers: float = 2.0
    powers_lost: float = 0.0
    largest_cost: float = math.inf
    integer_powers: bool = False


def plan_start(
    scene: Scene,
    cutoff: float,
    step_size: float,
    rule: WindowRule = WindowRule(),
    expansion: Expansion | None = None,
) -> StartDecision:
    r"""Decide whether a start series is used, and build its window.

    The window is :math:`S(t) = e^{-\lambda t} c(t)`, c the expansion times :math:`e^{\lambda t}`,
    truncated. It is used if there is a power below the cutoff Q that the method loses order on, if
    at most 128 exponents lie there, and if `rule` finds the window well resolved and cheaper than
    the singular terms: an expansion that is good only for a few steps makes things worse.

    Parameters
    ----------
    scene
        The scene; it starts at t = 0.
    cutoff
        Q: S agrees with the solution below t**Q.
    step_size
        h.
    expansion
        Of the solution, below the cutoff, where it is known already.
    """
    on_every_power = rule.integer_powers and bool(scene.active_damping)
    memoryless = all(term.is_integer_order for term in scene.active_damping)
    if scene.forcing is None and memoryless and not on_every_power:
        reason = "no start series: the solution starts smoothly"
        return StartDecision(use=False, wanted=False, reason=reason)
    try:
        if expansion is None:
            expansion = solution_expansion(scene, cutoff)
        smooth = expansion.is_smooth and forcing_is_smooth(scene, cutoff)
    except SeriesError as error:
        return StartDecision(use=False, reason=f"no start series: {error}")
    order = cutoff - rule.powers
    wanted = not smooth or (on_every_power and _moves(expansion, scene))
    return _decide(expansion, scene, step_size, rule, order, wanted=wanted)


def plan_jump(
    scene: Scene,
    break_point: float,
    cutoff: float,
    step_size: float,
    path: tuple[PowerSeries, ...] | None = None,
    rule: WindowRule = WindowRule(),
) -> StartDecision:
    """Decide as :func:`plan_start` does about the response to a jump; its time is t - t_b.

    The `path` is that of :func:`~fvi_cli.integrator.expansion.jump_expansion`.
    """
    if all(term.is_integer_order for term in scene.active_damping):
        reason = "no series: without memory a jump leaves no trace"
        return StartDecision(use=False, wanted=False, reason=reason)
    try:
        expansion = jump_expansion(scene, break_point, cutoff, path)
    except SeriesError as error:
        return StartDecision(use=False, reason=f"no series at t = {break_point:g}: {error}")
    order = cutoff - rule.powers
    fractional = expansion.exponents[expansion.exponents % 1 != 0]
    if expansion.cutoff < cutoff and fractional.size and fractional[0] >= 3.0:
        # orders of damping below 1: measured, it gains nothing
        reason = f"no series at t = {break_point:g}: none is known further than it is needed"
        return StartDecision(use=False, reason=reason, expansion=expansion)
    return _decide(expansion, scene, step_size, rule, order, wanted=not expansion.is_smooth)


def window_force(
    scene: Scene,
    window: WindowedSeries,
    *,
    start: float = 0.0,
    stiffness: Array | None = None,
) -> StepFunction:
    r"""What it takes to drive S: :math:`M S'' + \sum_j \mu_j D^{\gamma_j} S`, on steps.

    Solving for u = x - S means to add the negative of it to the forcing.

    Parameters
    ----------
    scene
        The scene.
    window
        S, as a function of the time since `start`.
    start
        0, or the break point; on earlier steps the force is 0.
    stiffness
        If given, K S is added.

    Returns
    -------
    StepFunction
        ``(left ends (n,), h, offsets (r,))`` to values ``(n, r, d)``. A step belongs to the side
        of `start` on which its middle lies. At t = 0 exactly, unbounded terms are infinite.
    """

    def force(left: Array, step_size: float, offsets: Array) -> Array:
        result = np.zeros((left.size, offsets.size, scene.dimension))
        present = left + 0.5 * step_size > start
        # A break point lies on a step up to round-off, which must not give a negative time.
        local = np.maximum(left[present] - start, 0.0)[:, None] + step_size * offsets

        def total(time: Array) -> Array:
            driving = window.acceleration(time) @ scene.inertia.mass
            for term in scene.active_damping:
                derivative = window.fractional_derivative(time, term.order, scene.derivative)
                driving += derivative @ term.coefficient
            if stiffness is not None:
                driving += window.position(time) @ stiffness
            return driving

        # At t = 0 unbounded terms of both signs may meet; that is for the caller to know.
        with np.errstate(divide="ignore", invalid="ignore"):
            driving = tabulated(total, local.ravel())
        result[present] = driving.reshape(*local.shape, scene.dimension)
        return result

    return force


def residual_force(scene: Scene, decision: StartDecision) -> StepFunction:
    r"""The forcing that remains for u = x - S: :math:`f - M S'' - \sum_j \mu_j D^{\gamma_j} S`.

    The potential stays where it is, as V(u + S). Close to 0, where the terms are unbounded and
    cancel, the force is :math:`\nabla V(S)` to round-off, and that is what is returned there.

    Raises
    ------
    ValueError
        If the decision holds no window.
    """
    if decision.window is None:
        raise ValueError(f"residual_force: {decision.reason}")
    driving = window_force(scene, decision.window)

    def force(left: Array, step_size: float, offsets: Array) -> Array:
        total = -driving(left, step_size, offsets)
        if scene.forcing is not None:
            total += scene.forcing.on_steps(left, step_size, offsets)
        near_start(scene, decision, left, step_size, offsets, total)
        return total

    return force


def near_start(
    scene: Scene,
    decision: StartDecision,
    left: Array,
    step_size: float,
    offsets: Array,
    force: Array,
) -> None:
    r"""Write :math:`\nabla V(S)` into `force` close to 0, as :func:`residual_force` says."""
    window, expansion = decision.window, decision.expansion
    if window is None or expansion is None:
        raise ValueError(f"residual_force: {decision.reason}")
    near = decision.tau * 1e-17 ** (1.0 / max(expansion.cutoff - 2.0, 1.0))
    first = np.flatnonzero(left < near)
    time = left[first, None] + step_size * offsets
    close = time < near
    if not close.any():
        return
    values = force[first]
    if scene.potential is None:
        values[close] = 0.0
    else:
        values[close] = scene.potential.gradient(window.position(time[close]))
    force[first] = values


def _moves(expansion: Expansion, scene: Scene) -> bool:
    """Whether there is a power besides those that the Caputo derivative subtracts."""
    subtracted = 0.0
    if scene.derivative == "caputo" and all(term.order > 1 for term in scene.active_damping):
        subtracted = 1.0
    present = np.any(expansion.coefficients != 0, axis=1)
    return bool(np.any(expansion.exponents[present] > subtracted))


def _decide(
    expansion: Expansion,
    scene: Scene,
    step_size: float,
    rule: WindowRule,
    order: float,
    *,
    wanted: bool,
) -> StartDecision:
    if not (wanted and np.any(expansion.coefficients)):
        return StartDecision(
            use=False,
            wanted=False,
            reason=f"no start series: no fractional power below t^{expansion.cutoff:g}",
            expansion=expansion,
        )
    # an expansion that ends before Q has few powers: only those in its last unit are the last
    complete = expansion.cutoff >= order + rule.powers - SAME_EXPONENT
    tau = time_of_validity(expansion, scene, last_powers=2.0 if complete else 1.0)
    if not tau >= rule.steps * step_size:
        return StartDecision(
            use=False,
            reason=(
                f"no start series: the expansion is good up to t = {tau:.3g}, "
                f"less than {rule.steps:g} steps of {step_size:.3g}"
            ),
            tau=tau,
            expansion=expansion,
        )
    if _cost(expansion, scene, step_size / tau, tau, rule, order) > rule.largest_cost:
        return StartDecision(
            use=False,
            reason=(
                f"no start series: with steps of {step_size:.3g} its window of length {tau:.3g} "
                "costs more than the singular terms"
            ),
            tau=tau,
            expansion=expansion,
        )
    window = WindowedSeries.matching(
        expansion.exponents,
        expansion.coefficients,
        cutoff=expansion.cutoff,
        decay=rule.decays / tau,
    )
    fractional = [f"{s:g}" for s in expansion.exponents if s != round(s)]
    powers = ", ".join(fractional[:LISTED_POWERS]) + (
        f", ... ({len(fractional)} in all)" if len(fractional) > LISTED_POWERS else ""
    )
    return StartDecision(
        use=True,
        reason=f"start series below t^{expansion.cutoff:g}"
        + (f" with the powers {powers}" if powers else ""),
        window=window,
        tau=tau,
        expansion=expansion,
    )


def _cost(
    expansion: Expansion,
    scene: Scene,
    steps: float,
    tau: float,
    rule: WindowRule,
    order: float,
) -> float:
    """The quotient that :class:`WindowRule` limits; infinite when no power limits the order."""
    exponents = expansion.exponents
    relative = sizes_by_mass(expansion, scene) * tau**exponents
    if expansion.is_smooth:
        # singular are the forces only: D^gamma of t^sigma, integrated twice
        highest = max((term.order for term in scene.active_damping), default=0.0)
        orders = exponents - highest + 2.0
        limiting = exponents > (1.0 if highest > 1 else 0.0)
    else:
        orders = exponents - rule.powers_lost
        limiting = exponents % 1 != 0
    limiting &= orders < order - SAME_EXPONENT
    saved = float(np.max(relative[limiting] * steps ** orders[limiting], initial=0.0))
    return float(relative.sum()) * steps**order / saved if saved > 0 else math.inf
