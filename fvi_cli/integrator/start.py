r"""Singular starts: the solution's expansion at 0 and at jumps, and a window that carries it.

Solutions of fractional equations behave at the start like :math:`\sum a_\sigma t^\sigma` with
powers that are not integers (Diethelm, *The Analysis of Fractional Differential Equations*, 2010,
section 6.4), on which every quadrature loses order. The expansion is found by Picard iteration on
truncated series; multiplied by a decaying exponential it gives a known function S such that
x - S starts as smoothly as the method can use.
"""

from __future__ import annotations

import math
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
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]
StepFunction = Callable[[Array, float, Array], Array]

MOST_EXPONENTS: Final = 128
LISTED_POWERS: Final = 4
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
        If one of the pieces has no expansion there.
    ValueError
        If no piece of the forcing ends at `break_point`.
    """
    breaks = () if scene.forcing is None else scene.forcing.break_points
    if scene.forcing is None or break_point not in breaks:
        raise ValueError(f"break_point: {break_point!r} is not one of {list(breaks)}")
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
    scene: Scene, cutoff: float, step_size: float, rule: WindowRule = WindowRule()
) -> StartDecision:
    r"""Decide whether a start series is used, and build its window.

    The window is :math:`S(t) = e^{-\lambda t} c(t)` with :math:`\lambda = 4/\tau`, c the expansion
    times :math:`e^{\lambda t}`, truncated. It is used if the expansion holds a fractional power
    below the cutoff Q, has at most 128 exponents there, and :math:`\tau \ge 4h`: an expansion that
    is good only for a few steps makes things worse.

    Parameters
    ----------
    scene
        The scene; it starts at t = 0.
    cutoff
        Q: S agrees with the solution below t**Q.
    step_size
        h.
    """
    on_every_power = rule.integer_powers and bool(scene.active_damping)
    memoryless = all(term.is_integer_order for term in scene.active_damping)
    if scene.forcing is None and memoryless and not on_every_power:
        reason = "no start series: the solution starts smoothly"
        return StartDecision(use=False, wanted=False, reason=reason)
    try:
        expansion = solution_expansion(scene, cutoff)
        smooth = expansion.is_smooth and _forcing_is_smooth(scene, cutoff)
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
    stiffness: Array | None = None,
    rule: WindowRule = WindowRule(),
) -> StartDecision:
    """Decide as :func:`plan_start` does about the response to a jump; its time is t - t_b."""
    if all(term.is_integer_order for term in scene.active_damping):
        reason = "no series: without memory a jump leaves no trace"
        return StartDecision(use=False, wanted=False, reason=reason)
    try:
        expansion = jump_expansion(scene, break_point, cutoff, stiffness)
    except SeriesError as error:
        return StartDecision(use=False, reason=f"no series at t = {break_point:g}: {error}")
    order = cutoff - rule.powers
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
        # At t = 0 unbounded terms of both signs may meet; that is for the caller to know.
        with np.errstate(invalid="ignore"):
            total = window.acceleration(local) @ scene.inertia.mass
            for term in scene.active_damping:
                derivative = window.fractional_derivative(local, term.order, scene.derivative)
                total += derivative @ term.coefficient
        if stiffness is not None:
            total += window.position(local) @ stiffness
        result[present] = total
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
    window, expansion = decision.window, decision.expansion
    if window is None or expansion is None:
        raise ValueError(f"residual_force: {decision.reason}")
    driving = window_force(scene, window)
    near = decision.tau * 1e-17 ** (1.0 / max(expansion.cutoff - 2.0, 1.0))

    def force(left: Array, step_size: float, offsets: Array) -> Array:
        total = -driving(left, step_size, offsets)
        if scene.forcing is not None:
            total += scene.forcing.on_steps(left, step_size, offsets)
        time = left[:, None] + step_size * offsets
        close = time < near
        if close.any():
            if scene.potential is None:
                total[close] = 0.0
            else:
                total[close] = scene.potential.gradient(window.position(time[close]))
        return total

    return force


def _forcing_is_smooth(scene: Scene, cutoff: float) -> bool:
    """Whether the forcing starts with integer powers only."""
    if scene.forcing is None:
        return True
    return _forcing_expansion(scene.forcing.pieces[0], _needed(cutoff), 0.0).is_smooth


def _moves(expansion: Expansion, scene: Scene) -> bool:
    """Whether there is a power besides those that the Caputo derivative subtracts."""
    subtracted = 0.0
    if scene.derivative == "caputo" and all(term.order > 1 for term in scene.active_damping):
        subtracted = 1.0
    present = np.any(expansion.coefficients != 0, axis=1)
    return bool(np.any(expansion.exponents[present] > subtracted))


def _needed(cutoff: float) -> float:
    """How far a force must be known: two integrations add two powers."""
    return max(cutoff - 2.0, 0.5)


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
    tau = _time_of_validity(expansion, scene)
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
    relative = _sizes(expansion, scene) * tau**exponents
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


def _sizes(expansion: Expansion, scene: Scene) -> Array:
    """Norms of the coefficients by the mass matrix, the same in all coordinates."""
    a = expansion.coefficients
    return np.asarray(np.sqrt(np.einsum("ni,ij,nj->n", a, scene.inertia.mass, a)))


def _time_of_validity(expansion: Expansion, scene: Scene) -> float:
    r"""Largest t at which the last terms do not outweigh the others.

    .. math:: \sum_{\sigma \ge Q-2} |a_\sigma| t^\sigma \le \sum_{0<\sigma<Q-2} |a_\sigma| t^\sigma

    The size of a coefficient is its norm by the mass matrix, which does not depend on the choice
    of coordinates. The quotient of the two sums increases with t, so that bisection in log t finds
    the time. A sum that ends before Q - 2 is good for ever; it gets the length of the run.
    """
    sizes = _sizes(expansion, scene)
    used = (expansion.exponents > 0) & (sizes > 0)
    exponents, logs = expansion.exponents[used], np.log(sizes[used])
    last = exponents >= expansion.cutoff - 2.0 - SAME_EXPONENT
    if not last.any():
        return scene.final_time
    if last.all():
        return 0.0

    def excess(log_time: float) -> float:
        terms = logs + exponents * log_time
        return float(np.logaddexp.reduce(terms[last]) - np.logaddexp.reduce(terms[~last]))

    low = high = math.log(scene.final_time)
    width = 1.0
    while excess(low) > 0 and width < 1e4:
        low -= width
        width *= 2.0
    width = 1.0
    while excess(high) <= 0 and width < 1e4:
        high += width
        width *= 2.0
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if excess(middle) > 0 else (middle, high)
    return math.exp(min(max(low, -700.0), 700.0))


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
        following = _truncated(
            np.concatenate((np.arange(2.0), moved)),
            np.concatenate((start, response)),
            min(cutoff, force.cutoff + 2.0),
        )
        if following.exponents.size > MOST_EXPONENTS:
            raise SeriesError(f"more than {MOST_EXPONENTS} exponents below t^{cutoff:g}")
        if following.cutoff >= cutoff - SAME_EXPONENT:
            return following
        if following.cutoff < current.cutoff + 1e-6:
            raise SeriesError(f"the expansion cannot be continued beyond t^{current.cutoff:.3g}")
        current = following
    raise SeriesError(f"more than {MOST_SWEEPS} sweeps are needed to reach t^{cutoff:g}")


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
