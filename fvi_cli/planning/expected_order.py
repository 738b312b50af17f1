"""The order to expect of a method on a scene, by theory and measurement."""

from __future__ import annotations

import contextlib
import functools
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import interpolation_limit
from fvi_cli.integrator.meshes.singular_start import powers_behind, start_power
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.starts.expansion import forcing_powers, solution_expansion
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.series.power_series import SeriesError
from fvi_cli.planning.unsmooth_forces import has_kinks

Norm = Literal["max", "final", "l2"]

CUTOFFS = (8.0, 5.0, 4.0)
"""Powers of the solution are examined up to the first of these below which there are not too many.
"""

_BASELINE_ORDERS = {
    "explicit-euler": 1.0,
    "implicit-euler": 1.0,
    "gruenwald-letnikov": 1.0,
    "product-integration": 2.0,
}
"""Orders of baselines; none is stated for others, which choose their own steps."""


def expected_order(
    scene: Scene, method: AnyMethod, norm: Norm, n_steps: int, *, grading: float = 1.0
) -> float:
    r"""Order to expect on `scene` in `norm` with `n_steps` steps; nan where none is stated.

    For smooth starts it is the order on smooth data (for Radau IIA and Lobatto IIIC of degree s
    min(classical, s + 3 - gamma), as measured). Otherwise it is limited by

    - a forcing that starts like :math:`t^{e_f}`, e_f not an integer, under ``galerkin``: its
      moments err by :math:`h^{e_f + 1}`;
    - the quadrature of forces that start like :math:`t^e` because of the fractional derivative or
      of fractional powers of the solution: :math:`h^{e + 2}` in norms over the grid. For a free
      motion with first fractional power :math:`\sigma^*` this is :math:`h^{\sigma^*}`; Gauss
      methods reach :math:`h^{2 \sigma^*}` at the final time. Measured for gamma = 0.3 to 1.9 on
      Runge-Kutta methods and on BDF at the quadrature points, not proved.

    Riemann-Liouville derivatives of an initial position (order below 1) or velocity (above 1) are
    forces that start like :math:`t^{-\gamma}` and :math:`t^{1 - \gamma}`; on the nodes the first
    costs :math:`h^{1 - \gamma}`, since the impulse at 0 is left out, the second
    :math:`h^{3 - \gamma}`. A jump of the force counts with the power t**2 of its response. Samples
    of the force set a limit of their own (`interpolation_limit`). Forces that begin with a
    fractional power after a break point count as at the start. No order is stated where forces have
    kinks inside steps (`has_kinks`).

    Meshes with halved steps after singular points (``start: graded``) keep the order on smooth
    data. On graded meshes, :math:`t_k = T (k / N)^r`, the limit of a singular start in the maximum
    norm is r times that on equal steps; in other norms no order is stated where this is below the
    order on smooth data.
    """
    if has_kinks(scene):
        return math.nan
    try:
        if isinstance(method, Baseline):
            return _baseline_order(scene, method)
        return _order_of(scene, method, norm, n_steps, grading)
    except SeriesError:
        return math.nan


def _order_of(scene: Scene, method: Method, norm: Norm, n_steps: int, grading: float) -> float:
    limit = interpolation_limit(scene, n_steps, grading=grading)
    smooth = min(smooth_order(scene, method), limit)
    if method.start == "graded":
        return smooth
    if grading != 1.0:
        order = float(np.minimum(smooth, grading * _singular_order(scene, method, "max")))
        return order if norm == "max" or order == smooth else math.nan
    # `np.minimum` keeps nan (no order is stated), which `min` may drop
    return float(np.minimum(smooth, _singular_order(scene, method, norm)))


def _baseline_order(scene: Scene, method: Baseline) -> float:
    r"""Order of a baseline; a forcing like :math:`t^e` limits product integration to e + 1.

    With an initial velocity and a Riemann-Liouville derivative of order gamma above 1 the solution
    has the power :math:`t^{3 - \gamma}`, whose interpolant costs :math:`h^{5 - 2 \gamma}`, and for
    implicit Euler a force like :math:`t^{1 - \gamma}`, which costs :math:`h^{2 - \gamma}`.
    """
    if method.name == "gruenwald-letnikov" and not scene.active_damping:
        return 2.0
    order = _BASELINE_ORDERS.get(method.name, math.nan)
    abrupt = max(_abrupt_orders(scene), default=0.0)
    if method.name == "implicit-euler" and abrupt > 1:
        return 2.0 - abrupt
    if method.name != "product-integration":
        return order
    if abrupt > 1:
        order = min(order, 5.0 - 2.0 * abrupt)
    forcing = np.append(forcing_powers(scene), _powers_behind_breaks(scene))
    return min([order, *(float(e) + 1.0 for e in forcing[~_is_integer(forcing)])])


def smooth_order(scene: Scene, method: Method) -> float:
    """Order on smooth data.

    Gauss methods of degree m reach 2m; where the mass matrix is not constant and an order of
    differentiation exceeds 1, min(2m, m + 4 - gamma) with the largest gamma, since forces are known
    only to the order of the stages. Measured against adaptive runs with graded starts on the double
    pendulum, m = 1 to 4: single terms with gamma = 1.3, 1.5 and 1.9 give 2.0 for m = 1, 3.9 to 4.0
    for m = 2, then 5.4, 5.3 and 5.0 for m = 3 and 7, 6.2 and 5.9 for m = 4 (on few steps unevenly,
    5.1 to 8.5 for 1.3). With a second term of order 0.5 they give 5.6, 5.4 and 5.0 for m = 3 and
    6.5, 6.5 and 5.8 for m = 4. So a second term does not change the order.
    """
    orders = [t.order for t in scene.active_damping if not t.is_integer_order]
    begins = [law.kernel.start_order for law in scene.active_laws]
    orders += [order for order in begins if order is not None]
    if method.is_runge_kutta and method.cq != "gauss" and orders:
        return min(float(method.classical_order), method.degree + 3.0 - max(orders))
    highest = max(orders, default=0.0)
    if scene.lagrangian is not None and method.cq == "gauss" and highest > 1:
        return min(2.0 * method.degree, method.degree + 4.0 - highest)
    if method.is_runge_kutta or scene.active_damping:
        return float(method.classical_order)
    return float(min(2 * method.degree, method.rule.build().order))


def _singular_order(scene: Scene, method: Method, norm: Norm) -> float:
    """Limit by fractional powers at the start and at break points; infinite without such powers."""
    if scene.active_laws:
        # no expansion with laws: the order on the grid is the least power itself
        powers = [start_power(scene, at_start=at) for at in (True, not scene.break_points)]
        least = min((power for power in powers if power is not None), default=math.inf)
        return least if norm == "max" or math.isinf(least) else math.nan
    solution, behind = _solution_powers(scene), _powers_behind_breaks(scene)
    forcing, limit = np.append(forcing_powers(scene), behind), math.inf
    abrupt, corrected = _abrupt_orders(scene), _corrected_powers(scene, method)
    singular = forcing[~_is_integer(forcing)]
    if method.forcing_quadrature == "galerkin" and singular.size:
        limit = float(singular.min()) + 1.0
    if method.sampling == "nodes":
        # with starting weights the effect of the omitted impulse at 0 is not known
        costs = [(3.0 if order > 1 else 1.0) - order for order in abrupt]
        return math.nan if corrected else min([limit, *costs])
    if corrected:
        limit = min(limit, _corrected_order(scene, method, solution, corrected))
        solution = np.empty(0)
    if scene.break_points:
        solution = np.concatenate([solution, [2.0], behind + 2.0])
    exponents = _force_powers(scene, method, solution)
    if not exponents.size:
        return limit
    on_grid = float(exponents.min()) + 2.0
    free = forcing.size == 0 and not scene.break_points
    twice = norm == "final" and method.cq == "gauss" and free
    return min(limit, 2 * on_grid if twice else on_grid)


def _corrected_powers(scene: Scene, method: Method) -> tuple[float, ...]:
    """Powers of the starting weights of a run; empty if it has or uses none."""
    if method.start != "weights" or not scene.active_damping:
        return ()
    # a slow import (SciPy's special functions), which most methods do not need
    from fvi_cli.integrator.starts.starting_weights import corrected_powers

    return corrected_powers(scene, method)[0]


def _corrected_order(
    scene: Scene, method: Method, solution: Array, corrected: tuple[float, ...]
) -> float:
    r"""Limit with starting weights on powers :math:`\sigma` for samples at the quadrature points.

    The derivative of a corrected power is an exact force :math:`t^{\sigma - \gamma}`, but the
    quadrature of its moments errs by :math:`h^{\sigma - \gamma + 1}`. Where a sample errs like
    :math:`t^e`, because e is not corrected or no power of the method's polynomials, the weights err
    by :math:`h^{e - \gamma + 1}`, one order higher where every :math:`\sigma - \gamma` is an
    integer, since such weights sum to 0. Weights decay like :math:`k^{\sigma - \gamma - p}`; a sum
    over the steps k that does not converge costs :math:`\sigma - \gamma - p + 1` orders more.
    Measured, not proved.
    """
    is_corrected = _is_among(solution, corrected)
    forces = _force_powers(scene, method, solution[is_corrected])
    limits = [float(e) + 1.0 for e in forces[~_is_integer(forces)]]
    for term in scene.active_damping:
        growth = max(corrected) - term.order - method.bdf_order + 1.0
        # weights whose sum converges have no error from integer powers
        highest = method.degree + 0.5 if growth >= 0 else math.inf
        errs = ~(is_corrected & _is_integer(solution) & (solution <= highest))
        own = solution[errs & _is_damped(scene, term.order, solution)] - term.order
        sums_to_zero = growth < 0 and _is_integer(np.array(corrected) - term.order).all()
        limits += [float(e) + (2.0 if sums_to_zero else 1.0 - max(growth, 0.0)) for e in own]
    return min(limits, default=math.inf)


def _force_powers(scene: Scene, method: Method, solution: Array) -> Array:
    """Powers of the forces (by damping and energies) that result from those of the solution.

    Runge-Kutta methods are exact for derivatives of integer order of integer powers; backward
    differences err on every power in their first steps.
    """
    found: list[Array] = [np.empty(0)]
    for term in scene.active_damping:
        own = solution[_is_damped(scene, term.order, solution)]
        known = method.is_runge_kutta & _is_integer(own) & _is_integer(own - term.order)
        found.append((own - term.order)[~known])
    if scene.potential is not None or scene.lagrangian is not None:
        found.append(solution[~_is_integer(solution)])
    return np.concatenate(found)


def _is_damped(scene: Scene, order: float, powers: Array) -> NDArray[np.bool_]:
    """Whether a derivative of this order is computed from samples of powers of the solution.

    The Caputo derivative subtracts the other powers; the Riemann-Liouville derivative of the
    initial position is known up to round-off.
    """
    is_reduced = scene.derivative == "caputo" and order > 1
    return np.asarray(powers > (1.5 if is_reduced else 0.5))


def _powers_behind_breaks(scene: Scene) -> Array:
    """Fractional powers with which the force begins after its break points."""
    found = [powers_behind(scene, at) for at in scene.break_points]
    return np.concatenate([[], *found])


def _abrupt_orders(scene: Scene) -> tuple[float, ...]:
    """Orders of Riemann-Liouville derivatives that the initial data make unbounded at 0."""
    if scene.derivative == "caputo":
        return ()
    starts = {False: scene.initial_position.any(), True: scene.initial_velocity.any()}
    return tuple(t.order for t in scene.active_damping if t.order != 1 and starts[t.order > 1])


@functools.lru_cache(maxsize=8)
def _solution_powers(scene: Scene) -> Array:
    """Powers of the solution at the start, at least the lowest ones; independent of the method.

    Raises
    ------
    SeriesError
        If the solution has no expansion, or far too many powers.
    """
    for cutoff in CUTOFFS[:-1]:
        with contextlib.suppress(SeriesError):
            return solution_expansion(scene, cutoff).exponents
    return solution_expansion(scene, CUTOFFS[-1]).exponents


def _is_integer(exponents: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(exponents - np.round(exponents)) < 1e-9)


def _is_among(exponents: Array, others: tuple[float, ...]) -> NDArray[np.bool_]:
    return np.asarray(np.abs(np.subtract.outer(exponents, others)).min(axis=1) < 1e-9)
