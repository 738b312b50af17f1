"""The equation of one step of an implicit baseline, by Newton's iteration."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.mathematics.arrays import Array

MOST_ITERATIONS = 50


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
    r"""Solve :math:`A u + w \nabla V(b + c u) = r` with the exact Jacobian.

    Parameters
    ----------
    linear, constant
        A, shape ``(d, d)``, and r, shape ``(d,)``.
    potential
        V; None: no such term.
    guess
        Where the iteration starts.
    base, factor, weight
        b, c and w.

    Returns
    -------
    Array, int
        u, and the number of iterations: one where the equation is linear.
    """
    unknown = guess.copy()
    previous = math.inf
    is_linear = potential is None or isinstance(potential, QuadraticPotential)
    iteration = 0
    while iteration < MOST_ITERATIONS:
        iteration += 1
        residual = linear @ unknown - constant
        jacobian = linear
        if potential is not None:
            at = base + factor * unknown
            residual = residual + weight * potential.gradient(at)
            jacobian = jacobian + weight * factor * potential.hessian(at)
        update = np.linalg.solve(jacobian, residual)
        unknown = unknown - update
        size = float(np.abs(update).max())
        scale = float(np.abs(unknown).max())
        # beyond the accuracy that can be reached updates cease to shrink
        if is_linear or size <= 1e-13 * scale or size >= 0.5 * previous or size == 0:
            break
        previous = size
    return unknown, iteration
