"""Moments of a known force against the basis of each step."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.mathematics.lagrange import LagrangeBasis, lobatto_basis
from fvi_cli.mathematics.quadrature import gauss_rule

Array = NDArray[np.float64]
StepFunction = Callable[[Array, float, Array], Array]
"""``(start (n,), h, offsets (r,)) -> values (n, r, d)``, one-sided inside each step."""

GRADING_RATIO = 0.15
GRADING_LEVELS = 200
LEAST_POWER = -0.9
FINE_POINTS = 24
NEAR_STEPS = 16
CHUNK = 4096


def galerkin_moments(force: StepFunction, tables: StepTables, h: float, n_steps: int) -> Array:
    r""":math:`h \sum_i b_i l_\nu(c_i) f(t_k + c_i h)`, shape ``(n_steps, s + 1, d)``."""
    values = force(h * np.arange(n_steps, dtype=float), h, tables.points)
    return np.asarray(h * np.einsum("ni,kid->knd", tables.test_weights, values))


def exact_moments(
    force: StepFunction,
    method: Method,
    h: float,
    n_steps: int,
    singular_steps: tuple[int, ...] = (0,),
    *,
    far_points: int = FINE_POINTS,
    least_power: float = LEAST_POWER,
) -> Array:
    r""":math:`h \int_0^1 l_\nu(\tau) f(t_k + \tau h) d\tau` to round-off, ``(n_steps, s + 1, d)``.

    Every step takes a 24-point Gauss rule; the first, and each step after a break point, a
    composite one graded geometrically towards its left end. On panels of ratio 0.15 the rule
    integrates every t**p to round-off, and its panels leave out less than 1e-16 of t**p for p from
    `least_power` on (200 panels for -0.9).

    `far_points` are enough, for a force that is smooth but for powers of t at the `singular_steps`,
    on steps that are further than `NEAR_STEPS` from the last one of them: there the Bernstein
    ellipse up to the singularity has a sum of semiaxes above 60.
    """
    basis = lobatto_basis(method.degree)
    moments = None
    for first, last, points in _stretches(n_steps, singular_steps, far_points):
        rule = gauss_rule(points)
        start = h * np.arange(first, last, dtype=float)
        values = force(start, h, rule.nodes)
        if moments is None:
            moments = np.empty((n_steps, method.degree + 1, values.shape[2]))
        weighted = basis.values(rule.nodes) * rule.weights
        moments[first:last] = h * np.einsum("ni,kid->knd", weighted, values)
    if moments is None:
        raise ValueError(f"n_steps: {n_steps} is not allowed; it must be positive")
    for step in singular_steps:
        moments[step] = _composite(force, method, h, step, graded_edges(least_power))
    return moments


def _stretches(
    n_steps: int, singular_steps: tuple[int, ...], far_points: int
) -> Iterator[tuple[int, int, int]]:
    """Steps in stretches of one rule, as first, last (without it) and number of points."""
    ends = [*sorted(singular_steps), n_steps] if singular_steps else [0, n_steps]
    for begin, end in itertools.pairwise([0, *ends] if ends[0] > 0 else ends):
        near = min(begin + NEAR_STEPS, end)
        for lower, upper, points in ((begin, near, FINE_POINTS), (near, end, far_points)):
            for first in range(lower, upper, CHUNK):
                yield first, min(first + CHUNK, upper), points


def graded_edges(least_power: float = LEAST_POWER) -> Array:
    """Edges of panels on [0, 1] that shrink geometrically towards 0.

    The first ends where t**(p + 1) is below 1e-16; for p below -0.9 where it is for -0.9.
    """
    power = max(least_power, LEAST_POWER) + 1.0
    levels = math.ceil(GRADING_LEVELS * (LEAST_POWER + 1.0) / power)
    return np.concatenate([[0.0], GRADING_RATIO ** np.arange(levels - 1, -1, -1.0)])


def fine_rule() -> tuple[Array, Array]:
    """Points and weights of the rule that takes smooth forces to round-off."""
    rule = gauss_rule(FINE_POINTS)
    return rule.nodes, rule.weights


def graded_rule(edges: Array) -> tuple[Array, Array]:
    """Points and weights of a Gauss rule on every panel, in the order of the panels."""
    fine = gauss_rule(FINE_POINTS)
    widths = np.diff(edges)
    points = (edges[:-1, None] + widths[:, None] * fine.nodes).ravel()
    return points, (widths[:, None] * fine.weights).ravel()


def _composite(force: StepFunction, method: Method, h: float, step: int, edges: Array) -> Array:
    points, weights = graded_rule(edges)
    values = lobatto_basis(method.degree).values(points) * weights
    return np.asarray(h * values @ force(np.array([h * step]), h, points)[0])


def projected_moments(exact: Array, method: Method, tables: StepTables) -> Array:
    r"""Moments of the pointwise values of an L2 projection.

    For each quadrature point i, :math:`F_i = \frac{1}{h b_i}\int \tilde l_i f` with the Lagrange
    polynomials :math:`\tilde l_i` on the quadrature points; they follow from the moments against
    the basis of the trajectory when there are at most s + 1 points.

    Raises
    ------
    ValueError
        If the rule has more points than the trajectory's basis has functions.
    """
    if tables.points.size > method.degree + 1:
        raise ValueError(
            f"forcing_quadrature: projected takes at most degree + 1 = {method.degree + 1} "
            f"quadrature points, not {tables.points.size}"
        )
    control = lobatto_basis(method.degree).control_points
    at_points = np.ones((1, control.size))
    if tables.points.size > 1:
        at_points = LagrangeBasis(control_points=tables.points).values(control)
    # l~_i = sum_nu l~_i(d_nu) l_nu, so its moments are combinations of those at hand
    pointwise = np.einsum("in,knd->kid", at_points, exact) / tables.weights[:, None]
    return np.asarray(np.einsum("ni,kid->knd", tables.test_weights, pointwise))
