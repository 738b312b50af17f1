r"""When an iteration for a root has converged: one rule for every Newton's iteration.

Every component has a scale of its own, and every point, step or member converges by itself. With
:math:`c_j` the change of component j, :math:`c_j'` the one before and :math:`s_j` its scale,
component j has converged where the remainder, :math:`c_j\, c_j / c_j'`, is below the unit round-off
of :math:`s_j`. Where the changes cease to fall, :math:`c_j` must be below a computed bound
:math:`f_j` of round-off; the bound of a component that is not coupled to others does not depend
on their size. Slow progress above that bound is a failure.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fvi_cli.mathematics.arrays import Array, Mask

UNIT = 2.0**-53
"""Unit round-off."""
NEGLIGIBLE = 0.1 * UNIT
"""Changes below this share of the scale have no effect."""
NOISE = 16.0
"""Changes up to this many unit round-offs of the terms of an equation are noise."""
SLOW = 0.25
"""An iteration is slow where a change is larger than this share of the change before it."""
ITERATIONS, HALVINGS = 60, 40  # at most, of Newton for a root, and of one of its steps
SMALLEST = np.finfo(float).tiny


Evaluate = Callable[[Array], tuple[Array, Array, Array]]
"""Residuals ``(n, d)`` at points ``(n, d)``, their Jacobians ``(n, d, d)``, and the sum of the
absolute values of the terms of a residual, ``(n, d)``."""


def find_roots(evaluate: Evaluate, start: Array) -> tuple[Array, Mask, int]:
    """Roots of n independent systems of d equations by Newton's iteration with shorter steps.

    A step is halved until the residual at its end is finite and calls for a smaller correction
    than the one before. A root is found when the correction that the residual *there* calls for
    is no more than round-off.

    Takes points ``(n, d)``; returns the roots, which of them were found, and the largest number
    of iterations.
    """
    with np.errstate(all="ignore"):
        return _find_roots(evaluate, np.array(start, dtype=float))


def _find_roots(evaluate: Evaluate, unknown: Array) -> tuple[Array, Mask, int]:
    n, d = unknown.shape
    found, iteration = np.zeros(n, dtype=bool), 0
    trial = unknown
    residual, jacobian, _ = evaluate(unknown)
    live = _regular(residual, jacobian)
    while live.any() and iteration < ITERATIONS:
        iteration += 1
        matrix = np.where(live[:, None, None], jacobian, np.eye(d))
        step = np.where(live[:, None], _solve(matrix, residual), 0.0)
        before = np.abs(step)
        length, searching, at_root = np.ones((n, 1)), live.copy(), np.zeros(n, dtype=bool)
        for _ in range(HALVINGS):
            trial = unknown - length * step
            residual, jacobian, terms = evaluate(trial)
            regular = _regular(residual, jacobian)
            # the correction at the end of the step, by the Jacobian of its beginning
            correction, size = np.abs(_solve(matrix, residual)), np.abs(trial)
            converged = correction <= UNIT * size
            is_slow = ~converged & (correction / before > SLOW)
            if is_slow.any():
                converged |= is_slow & (correction <= NOISE * _rounding(matrix, terms, size))
            at_root |= searching & converged.all(axis=1)
            scale = np.maximum(size + before, SMALLEST)
            falls = (correction / scale).max(axis=1) < (before / scale).max(axis=1)
            searching &= ~(regular & (at_root | falls))
            if not searching.any():
                break
            length[searching] *= 0.5
        live &= ~searching
        unknown = np.where(live[:, None], trial, unknown)
        found |= at_root & live
        live &= ~at_root
    return unknown, found, iteration


def _rounding(matrix: Array, terms: Array, size: Array) -> Array:
    """Bound on the round-off of a correction, by the terms of the residuals and by the unknowns."""
    return np.asarray(UNIT * (np.einsum("nab,nb->na", np.abs(np.linalg.inv(matrix)), terms) + size))


def _regular(residual: Array, jacobian: Array) -> Mask:
    """Where residual and Jacobian are finite and the Jacobian has an inverse."""
    both = np.isfinite(residual).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
    finite: Mask = np.asarray(both)
    safe = np.where(finite[:, None, None], jacobian, 0.0)
    signs: Array = np.asarray(np.linalg.slogdet(safe)[0])
    return np.asarray(finite & (signs != 0))


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
