r"""What a block of B equal steps of linear systems gives, as dense matrices.

The scene is linear with constant matrices M, K and D: its own, or those that stand for a nonlinear
one while Newton's iteration works on what is left. Into a block go load vectors
:math:`g_{k\nu}` of every step, positions and momenta at its beginning. The force of the past
enters by its load vectors :math:`-h \sum_i b_i l_\nu(c_i) F_i`; what the damping of the block's own
steps does is in the matrices, for states of exponentials as for weights of all lags.

All matrices follow from the response to inputs of the first step, for which the steps are done once
with unit inputs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fvi_cli.integrator.convolution.damping import Damping, DampingTables
from fvi_cli.integrator.step_tables import StepTables
from fvi_cli.integrator.steps.step import ForceSampling
from fvi_cli.mathematics.arrays import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearSystems:
    """A batch of q independent linear systems of e coupled components each.

    Parameters
    ----------
    mass, stiffness
        M and K, shape ``(q, e, e)``; K None where there is none.
    directions
        D of every direction of the damping, each of shape ``(q, e, e)``.
    """

    mass: Array
    stiffness: Array | None
    directions: tuple[Array, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers q and e."""
        return int(self.mass.shape[0]), int(self.mass.shape[1])


class OwnPast(Protocol):
    """What the steps of a block so far do to the next one."""

    def force(self) -> tuple[Array, ...]:
        """For every direction its force but for the matrix, each ``(q, m, columns)``."""

    def push(self, samples: Array) -> None:
        """Append what drove the force in a step, shape ``(q, inputs, columns)``."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnDamping:
    """The damping of a block's steps by themselves.

    Parameters
    ----------
    sampling
        Where the force acts, and what drives it.
    local
        For every direction what drives it in a step does in it, shape ``(m, inputs)``.
    past
        From B and a shape ``(q, inputs, columns)`` to a past without any step yet.
    """

    sampling: ForceSampling
    local: tuple[Array, ...]
    past: Callable[[int, tuple[int, int, int]], OwnPast]


def own_damping(damping: Damping | None, at: DampingTables, sampling: ForceSampling) -> OwnDamping:
    """The damping of a scene, if any, in the steps of a block."""
    if damping is None or at.step is None or at.decay.size:
        return OwnDamping(
            sampling=sampling, local=at.local, past=lambda _, shape: _States(at, shape)
        )
    step = at.step

    def past(block: int, shape: tuple[int, int, int]) -> OwnPast:
        lags = step.over(block).lags
        return _Lags([damping.combined(one, lags) for one in damping.directions], shape)

    return OwnDamping(sampling=sampling, local=at.local, past=past)


class _States:
    def __init__(self, at: DampingTables, shape: tuple[int, int, int]) -> None:
        self._at, self._states = at, np.zeros((shape[0], at.decay.size, shape[2]))

    def force(self) -> tuple[Array, ...]:
        return tuple(response @ self._states for response in self._at.response)

    def push(self, samples: Array) -> None:
        if self._at.decay.size:
            self._states = self._at.decay[:, None] * self._states + self._at.intake @ samples


class _Lags:
    """Where every lag has a matrix of its own, ``(B - 1, m, inputs)`` for every direction."""

    def __init__(self, lags: list[Array], shape: tuple[int, int, int]) -> None:
        # from the largest lag to the smallest: the last columns are the nearest
        self._lags = [np.concatenate(list(one[::-1]), axis=1) for one in lags]
        q, inputs, columns = shape
        self._samples = np.empty((q, (len(lags[0]) + 1) * inputs, columns))
        self._done = 0

    def force(self) -> tuple[Array, ...]:
        done = self._done
        before = self._samples[:, :done]
        return tuple(lags[:, lags.shape[1] - done :] @ before for lags in self._lags)

    def push(self, samples: Array) -> None:
        first, self._done = self._done, self._done + samples.shape[1]
        self._samples[:, first : self._done] = samples


@dataclass(frozen=True, kw_only=True, eq=False)
class BlockResponse:
    """Matrices of a block of B steps, for each of q systems.

    Columns are the load vectors, ``(B, s + 1, e)``, then position and momentum at the beginning,
    ``(2, e)``.

    Parameters
    ----------
    samples
        Rows: what drives the damping force in every step, ``(B, inputs, e)``: velocities at the
        stages, or the unknowns.
    way
        Rows: positions at the quadrature points relative to the beginning, ``(B, r, e)``.
    ends
        Rows: changes of position and of momentum since the beginning, after every step,
        ``(B, 2, e)``.
    """

    samples: Array
    way: Array
    ends: Array


def step_matrix(
    systems: LinearSystems, damping: OwnDamping, tables: StepTables, step_size: float
) -> Array:
    """Derivative of the equations of a step by its unknowns, shape ``(q, s e, s e)``."""
    h, test, basis = step_size, tables.test_weights[:-1], tables.basis[1:].T
    acting, driving = damping.sampling.test, damping.sampling.driving
    q, e = systems.shape
    s = tables.degree
    total = np.einsum("nm,qab->qnamb", tables.mass_matrix, systems.mass)
    if systems.stiffness is not None:
        total -= h**2 * np.einsum("nm,qab->qnamb", test @ basis, systems.stiffness)
    for local, direction in zip(damping.local, systems.directions, strict=True):
        # forces are rows times directions: F = (W V) D
        total -= h * np.einsum("nm,qba->qnamb", acting @ local @ driving, direction)
    return np.asarray(total.reshape(q, s * e, s * e))


def block_response(
    systems: LinearSystems,
    damping: OwnDamping,
    tables: StepTables,
    step_size: float,
    block: int,
) -> BlockResponse:
    """Matrices of a block of `block` steps of size `step_size`.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of a step have no unique solution.
    """
    impulses = _impulses(systems, damping, tables, step_size, block)
    dense = [_dense(one, tables, block) for one in impulses]
    return BlockResponse(samples=dense[0], way=dense[1], ends=dense[2])


def _impulses(
    systems: LinearSystems,
    damping: OwnDamping,
    tables: StepTables,
    step_size: float,
    block: int,
) -> tuple[Array, ...]:
    """Outputs of every step for unit inputs in the first, each ``(q, B, rows, e, columns)``."""
    h, (q, e) = step_size, systems.shape
    s, r = tables.degree, tables.points.size
    width = (s + 3) * e
    inverse = np.linalg.inv(step_matrix(systems, damping, tables, h))
    test, weights, basis = h * tables.test_weights[:-1], h * tables.weights, h * tables.basis[1:].T
    acting, kicks = h * damping.sampling.test, h * damping.sampling.weights
    driving, m = damping.sampling.driving, acting.shape[1]
    inputs = driving.shape[0]
    units = np.eye(width).reshape(s + 3, e * width)
    start_position, start_momentum = units[s + 1], units[s + 2]
    pulled = np.zeros((q, e * width))
    stiffness = None
    if systems.stiffness is not None:
        # what the stiffness of a step's own way adds to its change of momentum
        stiffness = systems.stiffness
        pulled = _along(stiffness, np.broadcast_to(start_position, (q, 1, e * width)), e)[:, 0]
    own_pull = weights @ basis
    # changes are summed up on their own: beside a start of 1 their last digits would be lost, the
    # same ones in every block of a run
    moved, gained = np.zeros((q, e * width)), np.zeros((q, e * width))
    past = damping.past(block, (q, inputs, e * width))
    samples = np.empty((q, block, inputs, e * width))
    ways = np.empty((q, block, r, e * width))
    ends = np.empty((q, block, 2, e * width))
    test_sum = test.sum(axis=1)[:, None]
    for index in range(block):
        force = np.zeros((q, m, e * width))
        for own, direction in zip(past.force(), systems.directions, strict=True):
            force += _along(direction, own, e)
        right = acting @ force
        right[:, 0] -= start_momentum + gained
        if index == 0:
            right -= units[:s]
        if stiffness is not None:
            pull = pulled + _along(stiffness, moved[:, None], e)[:, 0]
            right += test_sum * pull[:, None]
        unknowns = np.matmul(inverse, right.reshape(q, s * e, width)).reshape(q, s, e * width)
        sample = driving @ unknowns
        for local, direction in zip(damping.local, systems.directions, strict=True):
            force += _along(direction, local @ sample, e)
        change = -(kicks @ force)
        if stiffness is not None:
            change -= h * pull + _along(stiffness, (own_pull @ unknowns)[:, None], e)[:, 0]
        if index == 0:
            change += units[: s + 1].sum(axis=0)
        samples[:, index] = sample
        # no `out=`: NumPy 2.4 may write wrong numbers where it has gaps in memory
        ways[:, index] = moved[:, None] + basis @ unknowns
        moved = moved + h * unknowns[:, -1]
        gained = gained + change
        ends[:, index, 0], ends[:, index, 1] = moved, gained
        past.push(sample)
    outputs = (samples, ways, ends)
    return tuple(one.reshape(q, block, one.shape[2], e, width) for one in outputs)


def _along(matrices: Array, values: Array, coupled: int) -> Array:
    """Symmetric matrices ``(q, e, e)`` on the components of values ``(q, rows, e width)``."""
    if coupled == 1:
        return np.asarray(matrices * values)
    q, rows, size = values.shape
    parts = values.reshape(q, rows, coupled, size // coupled)
    return np.asarray(np.matmul(matrices[:, None], parts).reshape(values.shape))


def _dense(impulses: Array, tables: StepTables, block: int) -> Array:
    """From the response to the first step's inputs that to all, ``(q, rows, columns)``."""
    q, _, rows, e, width = impulses.shape
    loads = (tables.degree + 1) * e
    total = np.zeros((q, block, rows * e, block * loads + 2 * e))
    own = impulses.reshape(q, block, rows * e, width)
    for first in range(block):
        total[:, first:, :, first * loads : (first + 1) * loads] = own[
            :, : block - first, :, :loads
        ]
    total[..., block * loads :] = own[..., loads:]
    return total.reshape(q, block * rows * e, total.shape[-1])
