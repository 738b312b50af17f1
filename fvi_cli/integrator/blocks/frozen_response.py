r"""A block of nonlinear steps as a fixed point, from the response of a frozen linear scene.

With a constant matrix K in place of the Hessian of the potential the steps of a block are linear,
and the equations of the block become a fixed point for what is left of the force at the quadrature
points, :math:`N_i = K (X_i - q) - \nabla V(X_i)`, q the position at its beginning:

.. math:: X = X_\text{known} + P N(X),

P being the response of the linear scene with K. This is Newton's iteration for the whole block
with the Jacobian of the linear scene; it contracts like :math:`|V'' - K| (B h)^2 / 2`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.blocks.history import BatchedChannel
from fvi_cli.integrator.blocks.response import BlockResponse, LinearSystem, block_response
from fvi_cli.integrator.equal_steps.problem import StepProblem
from fvi_cli.integrator.steps.newton_blocks import FrozenLaw, fixed_point

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockInputs:
    """What goes into a block of n steps.

    Parameters
    ----------
    known
        Force of older samples on each step, shape ``(n, m d)``.
    origin
        Position at the beginning, shape ``(d,)``.
    state
        Way (zero at the beginning), momentum, carry and the number 1.
    moments
        Moments of known forces, shape ``(n, s + 1, d)``.
    remainder
        Guess of what is left of the force, the same at all points, shape ``(1, d)``.
    """

    known: Array
    origin: Array
    state: Array
    moments: Array
    remainder: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockSteps:
    """What came of a block of n steps.

    Parameters
    ----------
    path, momentum_path
        Position and momentum after every step, relative to the start, shape ``(n, d)``.
    samples
        Shape ``(n, m d)``.
    force
        Damping force of every step, shape ``(n, m, d)``, where it was wanted.
    carry
        Carry after the last step, shape ``(m d,)``.
    remainder
        What was left of the force at the last point of all, shape ``(1, d)``.
    changes
        How the points changed, one number per iteration.
    """

    path: Array
    momentum_path: Array
    samples: Array
    force: Array | None
    carry: Array
    remainder: Array
    changes: tuple[float, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sized:
    """The matrices for blocks of a number of steps.

    Parameters
    ----------
    known_points
        From all that goes into a block to the positions at its quadrature points.
    remainder_points
        From what is left of the force there to those positions.
    outputs
        From all that goes into a block to its samples, increments, force and carry.
    remainder_moments
        From what is left of the forces in a step to moments.
    """

    known_points: Array
    remainder_points: Array
    outputs: Array
    remainder_moments: Array


class FrozenResponse:
    """Response of the linear scene that stands for a nonlinear one.

    Parameters
    ----------
    problem, law
        The steps; K, and what the force is beyond it.
    channels
        Weights for the lags inside of a block.
    largest
        Number of steps of the largest block.
    with_force
        Whether the damping force is wanted.
    """

    def __init__(
        self,
        problem: StepProblem,
        law: FrozenLaw,
        channels: tuple[BatchedChannel, ...],
        largest: int,
        *,
        with_force: bool,
    ) -> None:
        self._problem, self._law = problem, law
        self._largest, self._with_force = largest, with_force
        memory = problem.memory
        system = LinearSystem(
            mass=problem.scene.inertia.mass[None],
            stiffness=law.stiffness[None],
            channels=channels,
            tables=problem.tables,
            sample_matrix=memory.sample_matrix,
            carry_matrix=memory.carry_matrix,
            force_weights=memory.force_weights,
            offset=memory.offset[None],
            step_size=problem.step_size,
        )
        self._size, self._n_state = system.sample_size, system.state_size
        self._response: BlockResponse = block_response(system, largest)
        self._made: dict[int, _Sized] = {}

    def _sized(self, count: int) -> _Sized:
        """The part of the matrices that `count` steps need."""
        if count in self._made:
            return self._made[count]
        response, tables = self._response, self._problem.tables
        d, size, n_state = self._problem.scene.dimension, self._size, self._n_state
        largest, r = self._largest, tables.points.size
        width = (tables.degree + 1) * d
        columns = np.concatenate(
            [
                np.arange(count * size),
                largest * size + np.arange(n_state),
                largest * size + n_state + np.arange(count * width),
            ]
        )

        def part(matrix: Array, rows: int) -> Array:
            return np.asarray(matrix[0][: count * rows][:, columns])

        points = part(response.points, r * d)
        position, momentum = part(response.position, d), part(response.momentum, d)
        outputs = [part(response.samples, size), position, momentum]
        if self._with_force:
            outputs.append(part(response.force, size))
        outputs.append(part(response.carry, size)[-size:])
        by_value = np.kron(tables.test_weights, np.eye(d))
        to_moments = np.asarray(self._problem.step_size * by_value, dtype=float)
        driven = points[:, count * size + n_state :].reshape(-1, count, width)
        self._made[count] = _Sized(
            known_points=points,
            remainder_points=np.ascontiguousarray(
                (driven @ to_moments).reshape(points.shape[0], points.shape[0])
            ),
            outputs=np.concatenate(outputs),
            remainder_moments=to_moments,
        )
        return self._made[count]

    def attempt(self, inputs: BlockInputs) -> BlockSteps | None:
        """Solve the equations of a block; None where the iteration does not contract."""
        count, size, d = inputs.known.shape[0], self._size, self._problem.scene.dimension
        sized, r = self._sized(count), self._problem.tables.points.size
        at = count * size
        joined = np.concatenate([inputs.known.ravel(), inputs.state, inputs.moments.ravel()])
        fixed = (sized.known_points @ joined).reshape(count, r, -1)
        guess = np.broadcast_to(inputs.remainder, fixed.shape)
        times = np.zeros((count, r))
        found = fixed_point(self._law, sized.remainder_points, fixed, inputs.origin, times, guess)
        if found is None:
            return None
        remainder, changes = found
        joined[at + self._n_state :] += (
            remainder.reshape(count, -1) @ sized.remainder_moments.T
        ).ravel()
        result = sized.outputs @ joined
        path = np.cumsum(result[at : at + count * d].reshape(count, d), axis=0)
        kicks = result[at + count * d : at + 2 * count * d].reshape(count, d)
        momentum_path = np.cumsum(kicks, axis=0)
        if not (np.isfinite(path).all() and np.isfinite(momentum_path).all()):
            return None
        force: Array | None = None
        if self._with_force:
            force = result[at + 2 * count * d : -size].reshape(count, -1, d)
        return BlockSteps(
            path=path,
            momentum_path=momentum_path,
            samples=result[:at].reshape(count, size),
            force=force,
            carry=result[-size:],
            remainder=remainder[-1, -1:],
            changes=tuple(changes),
        )
