"""One step of a method for quadratic Lagrangians and for oscillators."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.stability.patterns import DAMPING, MASS, STIFFNESS, step_patterns
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array, ComplexArray

PADE = 6
"""Degree of the Pade approximants of exponentials."""
DIFFERENCE = 1e-4
"""Damping in the difference quotients for slopes of step determinants."""


def increments(
    method: Method,
    h: Array,
    velocity: Array,
    momentum: Array,
    force: Array,
    mass: Array,
    mixed: Array,
    stiffness: Array,
) -> Array:
    """Increments of q and p in steps of quadratic Lagrangians, (n, b, 2 k).

    The steps have lengths `h` (n,) and begin at states with these first and second derivatives of
    L, (n, b, k) and (n, b, k, k).
    """
    tables = step_tables(method)
    s, basis, slopes = tables.degree, tables.basis, tables.slopes
    turned = mixed.swapaxes(-1, -2)
    n, b, k = velocity.shape
    long = h[:, None, None, None, None, None]

    def product(left: Array, right: Array, matrix: Array) -> Array:
        """Quadrature sums; rows for all nodes, columns for the unknown nodes."""
        table = np.einsum("i,ni,mi->nm", tables.weights, left, right[1:])
        return np.asarray(table[:, None, :, None] * matrix[:, :, None, :, None, :])

    left = product(slopes, slopes, mass) / long + long * product(basis, basis, stiffness)
    left += product(slopes, basis, mixed) + product(basis, slopes, turned)
    left = left.reshape(n, b, (s + 1) * k, s * k)
    # the parts of p and of dL/dq that do not depend on v
    rests = (
        momentum - (mass @ velocity[..., None])[..., 0],
        h[:, None, None] * (force - (turned @ velocity[..., None])[..., 0]),
    )
    known = (slopes @ tables.weights)[:, None] * rests[0][:, :, None, :]
    known = known + (basis @ tables.weights)[:, None] * rests[1][:, :, None, :]
    known[:, :, 0] += momentum
    known = known.reshape(n, b, (s + 1) * k, 1)
    inside = s * k
    unknowns = np.linalg.solve(left[..., :inside, :], -known[..., :inside, :])
    end = known[..., inside:, :] + left[..., inside:, :] @ unknowns
    return np.concatenate([unknowns[..., -k:, 0], end[..., 0] - momentum], axis=-1)


def rate_errors(method: AnyMethod, orders: tuple[float, ...], turned: Array) -> ComplexArray:
    r"""Errors of :math:`s h` of the mode :math:`s = i \omega` of an oscillator, ``(1 + j, n)``.

    The first row is the error without damping, the others are coefficients of
    :math:`c h^{2 - \gamma} / m` for each damping. The determinant of the step equations without
    damping is a polynomial of degree 2 in z.
    """
    square = (turned**2)[:, None, None]
    matrices = step_patterns(method, ())(np.array([0.0, 1.0, -1.0], dtype=np.complex128))
    ends = np.linalg.det(matrices[:, None, MASS] + square * matrices[:, None, STIFFNESS])
    linear, quadratic = 0.5 * (ends[1] - ends[2]), 0.5 * (ends[1] + ends[2]) - ends[0]
    root = np.sqrt(linear**2 - 4.0 * ends[0] * quadratic)
    with np.errstate(all="ignore"):
        both = np.stack([-linear + root, -linear - root]) / (2.0 * quadratic)
        # the quotient keeps the logarithm right beyond half a revolution per step, too
        errors = -np.log(both * np.exp(1j * turned))
        best = np.abs(errors).argmin(axis=0)[None]
        z, first = (np.take_along_axis(one, best, axis=0)[0] for one in (both, errors))
        found = [first]
        matrices = step_patterns(method, orders)(np.where(np.isfinite(z), z, 1.0))
        whole = matrices[:, MASS] + square * matrices[:, STIFFNESS]
        for index, order in enumerate(orders):
            change = DIFFERENCE * matrices[:, DAMPING + index]
            slope = (np.linalg.det(whole + change) - np.linalg.det(whole - change)) / (
                2.0 * DIFFERENCE
            )
            exact = -((1j * turned) ** (order - 1.0)) / 2.0
            found.append(slope / (z * (linear + 2.0 * quadratic * z)) - exact)
    return np.asarray(np.stack(found))


def exponentials(matrices: Array) -> Array:
    """Exponentials of matrices ``(..., m, m)``, by scaling and squaring."""
    size = float(np.abs(matrices).sum(axis=-1).max(initial=0.0))
    squares = max(math.ceil(math.log2(size)) + 1, 0) if 0.0 < size < math.inf else 0
    small = matrices / 2.0**squares
    power = above = below = np.broadcast_to(np.eye(small.shape[-1]), small.shape)
    factor = 1.0
    for j in range(1, PADE + 1):
        factor *= (PADE - j + 1) / ((2 * PADE - j + 1) * j)
        power = power @ small
        above, below = above + factor * power, below + (-1) ** j * factor * power
    found = np.linalg.solve(below, above)
    for _ in range(squares):
        found = found @ found
    return np.asarray(found)
