"""The numbers of one step that depend on the method alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from fvi_cli.integrator.method import Method
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.chebyshev import to_coefficients
from fvi_cli.mathematics.lagrange import LagrangeBasis, lobatto_basis


@dataclass(frozen=True, kw_only=True, eq=False)
class StepTables:
    r"""Basis and rule of a Galerkin step on [0, 1] and where the fractional action is sampled.

    The trajectory on step k is
    :math:`x_d(\tau h; k) = x_k + \sum_{\nu=1}^{s} l_\nu(\tau) \delta_k^\nu`, with the
    increments :math:`\delta_k^\nu = x_k^\nu - x_k` as unknowns, so that nothing is lost to
    round-off when h is small.
    """

    degree: int  # polynomial degree s
    control_points: Array  # the points d_nu, shape (s + 1,)
    points: Array  # quadrature rule (c_i, b_i) of the action, shape (r,)
    weights: Array
    basis: Array  # l_nu(c_i) and l_nu'(c_i), shape (s + 1, r)
    slopes: Array
    sample_points: Array  # rule (chi_i, beta_i) of the fractional action, shape (m,)
    sample_basis: Array  # l_nu(chi_i), shape (s + 1, m)
    # beta_i l_nu(chi_i), from damping forces to the load vectors of a step of length 1, (s + 1, m)
    to_loads: Array
    to_inputs: Array  # from a step's unknowns to the inputs of the memory, (i, s)

    @cached_property
    def mass_matrix(self) -> Array:
        r""":math:`\sum_i b_i l_\nu' l_\mu'`, rows 0..s-1 and columns 1..s, shape ``(s, s)``."""
        full = np.einsum("i,ni,mi->nm", self.weights, self.slopes, self.slopes)
        return np.asarray(full[:-1, 1:])

    @cached_property
    def stage_basis(self) -> LagrangeBasis:
        """The polynomials through values at two quadrature points or more."""
        return LagrangeBasis(control_points=self.points)

    @cached_property
    def to_unknowns(self) -> Array:
        """From velocities at the quadrature points to a step's unknowns, shape ``(s, r)``."""
        return np.asarray(np.linalg.pinv(self.slopes[1:].T))

    @cached_property
    def to_legendre(self) -> Array:
        """From values at the quadrature points to Legendre coefficients, shape ``(r, r)``."""
        legendre = np.polynomial.legendre.legvander(2.0 * self.points - 1.0, self.points.size - 1)
        return np.asarray(np.linalg.inv(legendre))

    @cached_property
    def increments_to_series(self) -> Array:
        """From a step's unknowns to Chebyshev coefficients of the polynomial, ``(s + 1, s)``."""
        return to_coefficients(2.0 * self.control_points - 1.0)[:, 1:]

    @cached_property
    def stages_to_series(self) -> Array:
        """From values at the quadrature points to Chebyshev coefficients, shape ``(r, r)``."""
        return to_coefficients(2.0 * self.points - 1.0)

    @property
    def test_weights(self) -> Array:
        r""":math:`b_i l_\nu(c_i)`, shape ``(s + 1, r)``."""
        return self.weights * self.basis


@lru_cache(maxsize=32)
def step_tables(method: Method) -> StepTables:
    """Tables of `method`."""
    rule, basis = method.rule.build(), lobatto_basis(method.degree)
    slopes = basis.derivatives(rule.nodes)
    samples, weights = rule.nodes, rule.weights
    if method.sampling == "nodes":
        # a kick at every node, half of it at the end of a step and half at the beginning of the
        # next: positions are those of the paper, which takes it whole at the left end, and the
        # momentum is that between the halves
        samples, weights = np.array([0.0, 1.0]), np.array([0.5, 0.5])
    sampled = basis.values(samples)
    to_rates = np.ascontiguousarray(slopes[1:].T)
    return StepTables(
        degree=method.degree,
        control_points=basis.control_points,
        points=rule.nodes,
        weights=rule.weights,
        basis=basis.values(rule.nodes),
        slopes=slopes,
        sample_points=samples,
        sample_basis=sampled,
        to_loads=weights * sampled,
        to_inputs=to_rates if method.is_runge_kutta else np.eye(method.degree),
    )
