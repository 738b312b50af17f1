r"""Equal steps with finer ones where the motion begins like a fractional power of t.

A polynomial on [t, t + tau] approximates :math:`t^\sigma` with an error of
:math:`(\tau / t)^{2m} t^\sigma` in the end points of Gauss methods. With equal steps of size h that
is :math:`h^\sigma` on the first few of them, however finely the very first is divided. So steps are
halved on a window of the grid after every singular point, more often the nearer they are, such that
:math:`\tau \propto t^{1 - 1/r}` with :math:`r \sigma > 2 m`: the mesh
:math:`t_k \propto (k/n)^r` (Brunner, *Collocation Methods for Volterra Integral and Related
Functional Differential Equations*, Cambridge 2004, section 6.2) in powers of 2, whose points
contain the uniform grid.

The least power :math:`\sigma` follows from the equation of motion: where the acceleration is like
:math:`t^e`, the derivative of order gamma of the position is like :math:`t^{e + 2 - \gamma}` and
drives the position with :math:`t^{e + 4 - \gamma}`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from fvi_cli.effects.forcing import ForceComponent
from fvi_cli.effects.sampled import FunctionForce
from fvi_cli.effects.scene import Scene
from fvi_cli.errors import ArgumentError
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch
from fvi_cli.integrator.method import AnyMethod, Baseline, ForcingQuadrature
from fvi_cli.mathematics.arrays import Mask
from fvi_cli.mathematics.expressions import Expression

WINDOW_SHARE = 4
"""The window has one of this many steps of a part between break points."""
WINDOW_LEAST = 16
"""Fewest steps of a window, if the part and that share of the run have as many: after a window of W
steps, equal steps approximate a singular power with an error of (4 W)^(-2m)."""
WINDOW_MOST = 512
"""Most steps of a window: after it, equal steps lose less than round-off."""
EXCESS = 0.5
"""How far r sigma lies above 2 m; with equality the error would have a logarithm."""
ROUND_OFF = 1e-16  # steps are cut towards 0 until t^sigma is below this
SHORTEST = 1e-96
"""No step is shorter than this part of a step of the grid: cubes of rates have to stay in range."""
LEAST_ELLIPSE = 1.25
"""Least rho of `_towards_zero`: no step towards a singular point is longer than [t / 81, t]."""
LEAST_IN_ULPS = 256
"""Shortest step after a break point, in units in the last place of its time."""
UNKNOWN_FORCE = 0.5
"""Power of t that is assumed for a force by a function of Python."""
LEAST_POWER = -0.9
"""Least power of a force: a steeper one gives much of its momentum before a first step can end."""
_ROOTS: Mapping[str, float] = {"sqrt": 0.5, "cbrt": 1 / 3, "power": 0.5, "log": 0.5}
"""Powers of functions in formulas."""


def graded_start_mesh(
    equal: Mesh, *, stages: int, exponent: Callable[[bool], float | None]
) -> Mesh:
    """Equal steps, halved again and again towards t = 0 and towards break points.

    For Gauss methods of m stages; `exponent` gives the least fractional power of the time after
    the start (True) or after a break point (False) in the position, None where it is smooth.
    """
    stretches, reported = list[Stretch](), [np.ones(1, dtype=bool)]
    for part in equal.stretches:
        power, size = exponent(part.begin == 0.0) if part.is_fresh else None, part.step_size
        if power is None or size < 2 * least_step(part.begin):
            stretches.append(part)
            reported.append(np.ones(part.n_steps, dtype=bool))
            continue
        least = min(equal.n_steps // WINDOW_SHARE, WINDOW_LEAST)
        window = max(part.n_steps // WINDOW_SHARE, least)
        window = max(1, min(window, part.n_steps, WINDOW_MOST))
        graded, on_grid = _graded_window(part.begin, size, window, 2 * stages, power)
        stretches += graded
        reported += on_grid
        last, rest = stretches[-1], part.n_steps - window
        if rest:
            stretches.append(replace(part, begin=last.end, n_steps=rest, is_fresh=False))
            reported.append(np.ones(rest, dtype=bool))
        else:
            stretches[-1] = replace(last, end=part.end)
    points = np.concatenate(reported)
    return Mesh(stretches=tuple(stretches), reported=None if points.all() else points)


def least_step(begin: float) -> float:
    """Shortest step at this time that round-off permits; zero at the start."""
    return LEAST_IN_ULPS * math.ulp(begin) if begin > 0 else 0.0


def _graded_window(
    begin: float, size: float, window: int, order: int, power: float
) -> tuple[list[Stretch], list[Mask]]:
    """Stretches of `window` steps of the grid, finest first; which of their ends are on it."""
    grading = (order + EXCESS) / power
    # with tau ~ t^(1 - 1/r) that share of the steps of a level is halved once more
    share = 2.0 ** (-1.0 / (grading - 1.0)) if grading > 1.0 else 0.0
    levels, least = [window], max(least_step(begin), SHORTEST * size)
    while levels[-1] > 1 and size * 0.5 ** (len(levels) + 1) >= least:
        levels.append(max(1, math.ceil(window * share ** len(levels) - 1e-9)))
    finest = size * 0.5 ** len(levels)
    lengths = [one for one in _towards_zero(order, power) if one == 1 or finest * one >= least]
    stretches = [
        Stretch(
            begin=begin + finest * low,
            end=begin + finest * high,
            n_steps=1,
            step_size=finest * (high - low),
            is_fresh=low == 0.0,
        )
        for low, high in itertools.pairwise([0.0, *reversed(lengths)])
    ]
    # the finest level fills the remainder of the one above it; its first step is cut already
    passed, on_grid = 1, [np.zeros(len(stretches), dtype=bool)]
    for depth in range(len(levels), 0, -1):
        step, count = size * 0.5**depth, 2 * levels[depth - 1]
        if count > passed:
            stretches.append(
                Stretch(
                    begin=stretches[-1].end,
                    end=begin + count * step,
                    n_steps=count - passed,
                    step_size=step,
                )
            )
            on_grid.append(np.arange(passed + 1.0, count + 1.0) * 0.5**depth % 1.0 == 0.0)
        passed = levels[depth - 1]
    return stretches, on_grid


def _towards_zero(order: int, power: float) -> list[float]:
    r"""Ends of the steps that cut [0, 1] towards 0, from 1 on.

    On [t / r, t] the error for :math:`t^\sigma` is about :math:`\rho^{-2m} t^\sigma`, where
    :math:`\rho = (\sqrt r + 1) / (\sqrt r - 1)` belongs to the ellipse through 0 around the step.
    So ratios may grow towards 0; with r = 2 at t = 1 no step errs by more than that one.
    """
    ends, end = [1.0], 1.0
    least = ROUND_OFF ** (1.0 / power)
    first = (math.sqrt(2.0) + 1.0) / (math.sqrt(2.0) - 1.0)
    while end > least:
        rho = max(first * end ** (power / order), LEAST_ELLIPSE)
        ratio = ((rho + 1.0) / (rho - 1.0)) ** 2
        end /= ratio
        ends.append(end)
    return ends


def start_power(
    scene: Scene, *, at_start: bool, forcing_quadrature: ForcingQuadrature = "galerkin"
) -> float | None:
    r"""Least fractional power of t in the position or its errors; None where all is smooth.

    At t = 0 with Caputo :math:`3 - \gamma` for :math:`\gamma < 1` and an initial velocity, with
    Riemann-Liouville :math:`2 - \gamma` for an initial position and :math:`3 - \gamma` for an
    initial velocity; otherwise, and after a break point of the force, :math:`4 - \gamma`. A
    relaxation law whose kernel is like :math:`t^{-\gamma}`, or like a constant and :math:`t^a`
    (then :math:`\gamma = -a`), begins as a derivative of order gamma. On a force :math:`t^e` the
    rule of the action errs like :math:`t^{e + 1}` in the momentum, an exact one only through the
    motion, :math:`t^{e + 2}`.
    """
    orders = [term.order for term in scene.active_damping if not term.is_integer_order]
    begins = [law.kernel.start_order for law in scene.active_laws]
    orders += [order for order in begins if order is not None]
    powers = [4.0 - order for order in orders]
    if at_start:
        is_rl = scene.derivative == "riemann-liouville"
        if is_rl and scene.initial_position.any():
            powers = [2.0 - order for order in orders]
        elif scene.initial_velocity.any():
            powers = [(3.0 if is_rl or order < 1 else 4.0) - order for order in orders]
    force = force_power(scene, at_start=at_start)
    if force is not None:
        powers.append(force + (1.0 if forcing_quadrature == "galerkin" else 2.0))
    return min(powers, default=None)


def force_power(scene: Scene, *, at_start: bool) -> float | None:
    """Least fractional power with which the force begins at 0, or after break points.

    None where it begins smoothly.

    Raises
    ------
    ArgumentError
        If the power is below :data:`LEAST_POWER`.
    """
    if scene.forcing is None:
        return None
    pieces, ends = scene.forcing.pieces, (0.0, *scene.forcing.break_points)
    chosen = slice(0, 1) if at_start else slice(1, 1 + len(scene.break_points))
    found = [
        _power_of(component, at)
        for piece, at in zip(pieces[chosen], ends[chosen], strict=True)
        for component in piece.components
    ]
    power = min((one for one in found if one is not None), default=None)
    if power is not None and power < LEAST_POWER:
        words = f"begins like t**{power:g}; steps take powers from {LEAST_POWER} on"
        raise ArgumentError("forcing", words)
    return power


@lru_cache(maxsize=256)
def _power_of(component: ForceComponent, at: float) -> float | None:
    """Least fractional power by the roots in a formula, wherever their arguments vanish."""
    if not isinstance(component, Expression):
        return UNKNOWN_FORCE if isinstance(component, FunctionForce) else None
    instructions = (component.bound.instructions[place] for place in component.bound.needed)
    powers = [
        abs(float(rest[1])) if kind == "**" else _ROOTS.get(str(kind), 1.0)
        for kind, *rest in instructions
    ]
    powers = [one for one in powers if not one.is_integer()]
    with np.errstate(all="ignore"):
        is_bounded = not np.isinf(component.evaluate({"t": np.array([at])})).any()
    if is_bounded:
        return min(powers, default=None)
    return -max(powers, default=1.0)


def order_on(scene: Scene, method: AnyMethod, grading: float = 1.0) -> float:
    """The order of a method on smooth data; nan where a scene is not known to let it have that.

    Equal steps, also graded ones :math:`t_k = T (k / N)^r`, have at most the order of the least
    fractional power of the position (times r), backward differences above order 2 err on any power
    in their first steps, and samples limit the order to that of their interpolation.
    """
    order, samples = method.order, () if scene.forcing is None else scene.forcing.samples
    if any(one.order < order for one in samples):
        return math.nan
    if not isinstance(method, Baseline):
        if method.start == "graded":
            # forces are known only to the order of the stages
            is_rough = scene.acts_above_order_1 and scene.lagrangian is not None
            return math.nan if is_rough and method.degree > 2 else order
        is_reached = order <= 2 and method.start == "none"
        if not (method.is_runge_kutta or is_reached) and scene.active_damping:
            return math.nan
    powers = [start_power(scene, at_start=True)]
    powers += [start_power(scene, at_start=False)] if scene.break_points else []
    least = min((power for power in powers if power is not None), default=math.inf)
    return order if grading * least >= order else math.nan
