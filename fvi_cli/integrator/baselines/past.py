"""Shared by the baselines: sums over the whole past, and the equation of an implicit step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fvi_cli.effects.damping import FractionalDamping
from fvi_cli.effects.potential import Potential, QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.failure import StepFailedError
from fvi_cli.mathematics.arrays import Array
from fvi_cli.mathematics.convergence import find_roots

LOCAL = 2
"""Number of weights of order 1 before all further ones are equal."""


@dataclass(kw_only=True, eq=False)
class _Term:
    """One damping term: weights in reverse, samples without their offsets, and a running sum."""

    matrix: Array
    backwards: Array
    offset: Array
    samples: Array
    tail: float
    total: Array


class Past:
    r"""The forces :math:`\sum_j D_j \sum_n w_n^{(j)} (y_{k-n} - s_{k-n}^{(j)})` of kept samples.

    Computed by NumPy dot products, for order 1 by a running sum.

    ``weights(order, count)`` gives the first weights w of an order of damping; ``offset(term)``
    gives s, ``(N + 1, d)``, which the derivative of a term subtracts from the samples.
    """

    def __init__(
        self,
        scene: Scene,
        n_steps: int,
        weights: Callable[[float, int], Array],
        offset: Callable[[FractionalDamping], Array],
    ) -> None:
        shape = (n_steps + 1, scene.dimension)
        self._terms: list[_Term] = []
        # D w_0, and its product with s at all times: for equations of the newest sample
        self.newest, self.newest_offset = np.zeros((scene.dimension,) * 2), np.zeros(shape)
        for one in scene.active_damping:
            own = weights(one.order, LOCAL + 1 if one.is_integer_order else n_steps + 1)
            tail = float(own[LOCAL]) if one.is_integer_order else 0.0
            head = own[:LOCAL] - tail if one.is_integer_order else own
            term = _Term(
                matrix=one.matrix,
                backwards=np.ascontiguousarray(head[::-1]),
                offset=offset(one),
                samples=np.empty(shape),
                tail=tail,
                total=np.zeros(scene.dimension),
            )
            self._terms.append(term)
            self.newest = self.newest + own[0] * one.matrix
            self.newest_offset = self.newest_offset + own[0] * term.offset @ one.matrix

    def keep(self, k: int, sample: Array) -> None:
        """Keep the sample y of time k."""
        for term in self._terms:
            left = term.samples[k] = sample - term.offset[k]
            if term.tail:
                term.total = term.total + left

    def force(self, k: int, newest: int) -> Array | float:
        """The force at time k from the samples of the times 0 to `newest`."""
        force: Array | float = 0.0
        for term in self._terms:
            end = term.backwards.size - k
            first = max(0, 1 - end)
            weights = term.backwards[end - 1 + first : end + newest]
            old = weights @ term.samples[first : newest + 1]
            if term.tail:
                old = old + term.tail * term.total
            force = force + old @ term.matrix
        return force


def caputo_offset(scene: Scene, times: Array) -> Callable[[FractionalDamping], Array]:
    """What derivatives subtract from positions: q0, or q0 + v0 t for Caputo above order 1.

    The derivative of order 1 does not depend on q0, which is subtracted so that the first
    difference is 0.
    """

    def offset(term: FractionalDamping) -> Array:
        if scene.derivative == "caputo" and term.order > 1:
            return np.asarray(scene.initial_position + times[:, None] * scene.initial_velocity)
        return np.broadcast_to(scene.initial_position, (times.size, scene.dimension))

    return offset


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
    r"""Solve :math:`A u + w \nabla V(b + c u) = r`, by Newton's iteration with the exact Jacobian.

    Returns u ``(d,)`` and the number of iterations, which is 1 if the equation is linear.

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
        # round-off of positions, which enters through the second derivatives
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
