"""The order that theory and measurement let one expect of a method on a scene."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.known_part import KnownPart, plan_series
from fvi_cli.integrator.method import AnyMethod, Baseline, Method
from fvi_cli.integrator.start import Expansion, solution_expansion
from fvi_cli.mathematics.power_series import SeriesError

Norm = Literal["max", "final", "l2"]

LARGEST_CUTOFF = 8.0


def expected_order(scene: Scene, method: AnyMethod, norm: Norm, n_steps: int) -> float:
    r"""Order to expect on `scene` in `norm` with `n_steps` steps; nan where none is stated.

    Smooth starts, and starts carried by a series: the order on smooth data (for Radau IIA and
    Lobatto IIIC of degree s it is min(classical, s + 3 - gamma), as measured). Otherwise the first
    fractional power :math:`\sigma^*` of the solution limits it:

    - Gauss: min(2m, sigma*) in norms over the grid, min(2m, 2 sigma*) at the final time, measured
      for gamma = 0.3 to 1.9, not proved;
    - BDF: the force that the quadrature of the step sees behaves like :math:`t^e`, and its moments
      err by :math:`h^{e+1}`; e = sigma* - 2, or larger where the forcing is integrated exactly and
      carries the singularity alone.

    After a break point that is left without a series the same holds for the power there.
    """
    if isinstance(method, Baseline):
        return 1.0
    smooth = smooth_order(scene, method)
    if not scene.active_damping or all(t.is_integer_order for t in scene.active_damping):
        return min(smooth, _singular_order(scene, method, norm))
    if method.start == "series":
        plan = plan_series(scene, method, n_steps)
        if not plan.fell_back:
            return _after_breaks(scene, plan.known, smooth)
    if method.start == "weights":
        # what the weights leave is not covered by a rule that was measured widely enough
        return smooth if method.sampling == "points" else math.nan
    return min(smooth, _singular_order(scene, method, norm))


def smooth_order(scene: Scene, method: Method) -> float:
    """Order on smooth data."""
    orders = [t.order for t in scene.active_damping if not t.is_integer_order]
    if method.is_runge_kutta and method.cq != "gauss" and orders:
        return min(float(method.classical_order), method.degree + 3.0 - max(orders))
    if method.is_runge_kutta or scene.active_damping:
        return float(method.classical_order)
    return float(min(2 * method.degree, method.rule.build().order))


def _after_breaks(scene: Scene, known: KnownPart | None, order: float) -> float:
    """A nonlinear scene's response to a jump is known four powers far only."""
    if scene.is_linear or known is None or not known.jumps:
        return order
    return min(order, 4.0)


def _singular_order(scene: Scene, method: Method, norm: Norm) -> float:
    if scene.break_points and scene.active_damping:
        # a jump of the force: its response starts like t**2, the damping like t**(2 - gamma)
        highest = max(t.order for t in scene.active_damping)
        singular = 4.0 - highest
        if all(t.is_integer_order for t in scene.active_damping):
            return math.inf
    else:
        singular = math.inf
    try:
        expansion = solution_expansion(scene, LARGEST_CUTOFF)
    except SeriesError:
        return math.nan
    fractional = _fractional(expansion)
    singular = min(singular, fractional[0] if fractional.size else math.inf)
    if math.isinf(singular):
        return math.inf
    if method.is_runge_kutta:
        return 2 * singular if norm == "final" and method.cq == "gauss" else singular
    if method.forcing_quadrature == "exact" and method.sampling == "points":
        return _force_exponent(scene, singular) + 1.0
    return singular - 1.0


def _fractional(expansion: Expansion) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    exponents = expansion.exponents[np.any(expansion.coefficients != 0, axis=1)]
    return np.asarray(exponents[exponents != np.round(exponents)])


def _force_exponent(scene: Scene, singular: float) -> float:
    """First fractional power of what is left of M x'' when the forcing is taken out."""
    try:
        free = solution_expansion(scene, LARGEST_CUTOFF)
    except SeriesError:
        return math.nan
    exponents = free.exponents[np.any(free.coefficients != 0, axis=1)]
    powers = [exponents]
    for term in scene.active_damping:
        lowest = 2.0 if term.order > 1 else 1.0
        powers.append(exponents[exponents >= lowest - 1e-9] - term.order)
    forces = np.concatenate(powers)
    fractional = forces[np.abs(forces - np.round(forces)) > 1e-9]
    return float(fractional.min()) if fractional.size else math.inf
