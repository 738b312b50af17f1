"""The equation of one step of an implicit baseline, by Newton's iteration."""

from __future__ import annotations

import numpy as np

from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.integrator.failure import StepFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import find_roots


def solve_implicit(
    linear: Array,
    constant: Array,
    potential: Potential | None,
    guess: Array,
    *,
    base: Array,
    factor: float,
    weight: float,
) -> tuple[Array, int]:
    r"""Solve :math:`A u + w \nabla V(b + c u) = r`, Newton's iteration with the exact Jacobian.

    From a guess to u ``(d,)`` and the number of iterations: one where the equation is linear.

    Raises
    ------
    StepFailedError
        If no solution was found.
    """
    if potential is None or isinstance(potential, QuadraticPotential):
        residual, jacobian = linear @ guess - constant, linear
        if potential is not None:
            residual = residual + weight * potential.gradient(base + factor * guess)
            jacobian = jacobian + weight * factor * potential.stiffness
        return guess - np.linalg.solve(jacobian, residual), 1

    def equation(unknown: Array) -> tuple[Array, Array, Array]:
        at = base + factor * unknown
        own, force = unknown @ linear.T, weight * potential.gradient(at)
        curvature = weight * potential.hessian(at)
        # rounded positions, through the second derivatives
        terms = np.abs(unknown) @ np.abs(linear.T) + np.abs(force) + np.abs(constant)
        shifted = np.abs(base) + np.abs(factor * unknown)
        terms = terms + np.einsum("nab,nb->na", np.abs(curvature), shifted)
        return own + force - constant, linear + factor * curvature, terms

    roots, found, iterations = find_roots(equation, guess[None])
    if not found.all():
        raise StepFailedError(
            f"Newton's iteration did not converge in {iterations} iterations; take a smaller step"
        )
    return np.asarray(roots[0]), iterations
