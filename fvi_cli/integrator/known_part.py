"""The part of the solution that is known in advance: the start series and those after breaks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.continuation import UNKNOWN, Paths, asks_for_paths, uniform_paths
from fvi_cli.integrator.expansion import Expansion
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.moments import StepFunction
from fvi_cli.integrator.start import (
    StartDecision,
    WindowRule,
    plan_jump,
    plan_start,
    residual_force,
    window_force,
)
from fvi_cli.mathematics.power_series import SeriesError, expand
from fvi_cli.mathematics.windowed_series import WindowedSeries

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownPart:
    r"""S(t), a sum of windowed expansions: one from t = 0, and one from each break point.

    Solving for u = x - S leaves an unknown that starts, and goes on after each break, as smoothly
    as the method can use.

    Parameters
    ----------
    scene
        The scene.
    start
        The decision at t = 0, with a window or without.
    jumps
        Break points with their windows.
    """

    scene: Scene
    start: StartDecision
    jumps: tuple[tuple[float, WindowedSeries], ...] = ()

    @property
    def carries_start(self) -> bool:
        """Whether S has the initial data, so that u starts from rest at 0."""
        return self.start.window is not None

    def position(self, start: Array, step_size: float, offsets: Array) -> Array:
        """S at points of steps, shape ``(n,)`` and ``(r,)`` to ``(n, r, d)``."""
        return self._on_steps(lambda window, at: window.position(at), start, step_size, offsets)

    def velocity(self, start: Array, step_size: float, offsets: Array) -> Array:
        """S' at points of steps, shape ``(n,)`` and ``(r,)`` to ``(n, r, d)``."""
        return self._on_steps(lambda window, at: window.velocity(at), start, step_size, offsets)

    def damping_force(self, start: Array, step_size: float, offsets: Array) -> Array:
        r""":math:`\sum_j \mu_j D^{\gamma_j} S` at points of steps, as :meth:`position`."""

        def force(window: WindowedSeries, time: Array) -> Array:
            total = np.zeros((*time.shape, self.scene.dimension))
            for term in self.scene.active_damping:
                derivative = window.fractional_derivative(time, term.order, self.scene.derivative)
                total += derivative @ term.coefficient
            return total

        return self._on_steps(force, start, step_size, offsets)

    def _on_steps(
        self,
        of_window: Callable[[WindowedSeries, Array], Array],
        start: Array,
        step_size: float,
        offsets: Array,
    ) -> Array:
        time = start[:, None] + step_size * offsets
        total = np.zeros((*time.shape, self.scene.dimension))
        if self.start.window is not None:
            total += of_window(self.start.window, time)
        for break_point, window in self.jumps:
            present = start + 0.5 * step_size > break_point
            local = np.maximum(start[present] - break_point, 0.0)[:, None] + step_size * offsets
            total[present] += of_window(window, local)
        return total

    def on_grid(self, time: Array) -> tuple[Array, Array]:
        """S and S' at the times of a grid, each of shape ``(n, d)``."""
        position = np.zeros((time.size, self.scene.dimension))
        velocity = np.zeros_like(position)
        parts = [(0.0, self.start.window)] if self.start.window is not None else []
        for origin, window in (*parts, *self.jumps):
            # a jump of the force leaves position and velocity continuous
            present = time >= origin
            position[present] += window.position(time[present] - origin)
            velocity[present] += window.velocity(time[present] - origin)
        return position, velocity

    def residual(self) -> StepFunction:
        """The forcing that remains for u."""
        if self.scene.lagrangian is not None:
            from fvi_cli.integrator.known_lagrangian import lagrangian_residual

            return lagrangian_residual(self.scene, self.scene.lagrangian, self.start)
        base = None if self.start.window is None else residual_force(self.scene, self.start)
        if base is None and self.scene.forcing is not None:
            base = self.scene.forcing.on_steps
        driving = [
            window_force(self.scene, window, start=break_point)
            for break_point, window in self.jumps
        ]

        def force(start: Array, step_size: float, offsets: Array) -> Array:
            if base is None:
                total = np.zeros((start.size, offsets.size, self.scene.dimension))
            else:
                total = base(start, step_size, offsets)
            for drive in driving:
                total = total - drive(start, step_size, offsets)
            return total

        return force


@dataclass(frozen=True, kw_only=True, eq=False)
class SeriesPlan:
    """What becomes of ``start: series`` on one scene and step.

    Parameters
    ----------
    known
        The known part; None where no series is used.
    fell_back
        Whether a singular start or break is left without its series.
    remarks
        In words, for the reader of a table; empty when nothing is singular.
    """

    known: KnownPart | None
    fell_back: bool
    remarks: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownTable:
    """Values of a known part, where they were made for many scenes at a time.

    Parameters
    ----------
    moments
        Of the forcing that remains, shape ``(N, s + 1, d)``.
    position
        S at the quadrature points, shape ``(N, r, d)``.
    on_grid
        S and S' at the grid, each of shape ``(N + 1, d)``.
    """

    moments: Array
    position: Array
    on_grid: tuple[Array, Array]


FORCING_CUTOFF = 8.0
NO_SERIES = SeriesPlan(known=None, fell_back=False, remarks=())


# Measured on x'' + mu D^gamma x + 2 x = 0 on [0, 8] with (x0, v0) = (1, 0), (0, 1), (1, 1/2), over
# mu = 0.01 .. 100, gamma = 0.1 .. 1.9 and N = 16 .. 256: with these the series is not worse than
# no series. The lower the order, the more the window's own error weighs.
RUNGE_KUTTA_RULES = {
    3: WindowRule(decays=3.0, steps=6.0, largest_cost=1.0),
    5: WindowRule(decays=6.0, steps=4.0, largest_cost=0.07),
    7: WindowRule(decays=8.0, steps=6.0, largest_cost=0.1),
}
BDF_RULES = {
    3: WindowRule(
        decays=4.0, steps=4.0, powers=3.0, powers_lost=1.0, largest_cost=0.1, integer_powers=True
    ),
    4: WindowRule(decays=4.0, steps=4.0, powers_lost=1.0, largest_cost=0.03, integer_powers=True),
    5: WindowRule(decays=4.0, steps=8.0, powers_lost=1.0, largest_cost=1.0, integer_powers=True),
}


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


def settled_method(scene: Scene, method: Method, plan: SeriesPlan) -> Method:
    """`method` with the forcing quadrature that a singular forcing needs where no series is used.

    ``start: series`` promises a cure for singular starts. Where the order is too low for a series
    to pay, or the series fell back, moments to round-off are the cure for a forcing that starts
    with a fractional power (for Runge-Kutta with an order above 1 those of the L2 projection).
    """
    if method.start != "series" or plan.known is not None or scene.forcing is None:
        return method
    try:
        powers = forcing_powers(scene)
    except SeriesError:
        return method
    if method.forcing_quadrature != "galerkin" or np.all(powers == np.round(powers)):
        return method
    above_one = any(term.order > 1 for term in scene.active_damping)
    return replace(
        method,
        forcing_quadrature="projected" if method.is_runge_kutta and above_one else "exact",
    )


def window_rule(method: Method) -> WindowRule | None:
    """The rule for `method`'s order; None where no series is needed to reach that order.

    The first fractional power is above 2: Runge-Kutta methods of order 2, BDF1 and BDF2 lose
    nothing on it.
    """
    rules = RUNGE_KUTTA_RULES if method.is_runge_kutta else BDF_RULES
    if method.sampling == "nodes":
        return None
    order = method_order(method)
    return next((rules[least] for least in sorted(rules, reverse=True) if least <= order), None)


def method_order(method: Method) -> int:
    """Order of the Runge-Kutta rule, or of the backward difference formula."""
    return method.rule.build().order if method.is_runge_kutta else method.bdf_order


@lru_cache(maxsize=2)
def plan_series(
    scene: Scene,
    method: Method,
    n_steps: int,
    expansion: Expansion | None = None,
    paths: Paths | None = None,
) -> SeriesPlan:
    """Decide about the series at 0 and at every break point, and say what was decided.

    The `expansion` of the solution at 0 is made here where it is not given. The `paths` of a
    nonlinear motion at break points are known after a run only; a plan without them takes what
    uniform motion gives. The last plans are kept: a run, and the order to expect of it, ask for
    the same one.
    """
    h = scene.final_time / n_steps
    rule = window_rule(method)
    if rule is None:
        return NO_SERIES
    cutoff = method_order(method) + rule.powers
    start = plan_start(scene, cutoff, h, rule, expansion)
    remarks = (start.reason,) if start.wanted else ()
    fell_back = start.wanted and not start.use
    jumps = []
    if paths is None:
        paths = uniform_paths(scene, cutoff) if asks_for_paths(scene) else UNKNOWN
    for break_point in scene.break_points:
        decision = plan_jump(scene, break_point, cutoff, h, paths.at(break_point), rule)
        if decision.window is not None:
            jumps.append((break_point, decision.window))
        elif decision.wanted:
            fell_back = True
            remarks = (*remarks, f"at t = {break_point:g}: {decision.reason}")
    known = None
    if start.use or jumps:
        known = KnownPart(scene=scene, start=start, jumps=tuple(jumps))
    return SeriesPlan(known=known, fell_back=fell_back, remarks=remarks)
