r"""Linear scenes of very many coupled components, step by step with sparse matrices.

The matrix of a step is factorised once. What a direction D does to the newest increments is all
that the memory keeps, and only for the components that D does not leave alone:

.. math:: F_k = \sum_D \sum_{n=0}^{k} w^{(D)}_n (U_{k-n} D),

so that a single damper in a long chain remembers a single component.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.advance import STRIDE, advanced
from fvi_cli.integrator.block_history import BatchedChannel, GroupHistory, shared_strip
from fvi_cli.integrator.block_linear import has_moments, known_moments
from fvi_cli.integrator.compensated import CompensatedSum
from fvi_cli.integrator.memory import Channel
from fvi_cli.integrator.stepping import Stepped, StepProblem
from fvi_cli.integrator.trajectory import NewtonRecord

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Array = NDArray[np.float64]
Form: TypeAlias = "Array | csr_array"

SPARSE_DENSITY = 0.1
"""A matrix with fewer entries, relative to all places, is taken as sparse."""
BLOCK, GROUP = 16, 256
"""Steps whose sums over each other are direct, and steps that are summed without transforms."""


def run_large_steps(problem: StepProblem) -> Stepped:
    """All steps of a linear scene, one after the other.

    Returns
    -------
    Stepped
        As `run_steps` gives it, without the samples; with the damping force at the nodes only
        where the samples lie on them.
    """
    return _LargeSteps(problem).run()


class _LargeSteps:
    """Factorised matrix and state of one run."""

    def __init__(self, problem: StepProblem) -> None:
        self._problem = problem
        scene, memory, tables = problem.scene, problem.memory, problem.tables
        h, s = problem.step_size, tables.degree
        potential = scene.potential
        self._stiffness: Array | csr_array | None = None
        small = [(tables.mass_matrix / h, scene.inertia.mass)]
        if isinstance(potential, QuadraticPotential):
            self._stiffness = _form(potential.stiffness)
            pulls = np.einsum("ni,mi->nm", tables.test_weights[:-1], tables.basis[1:])
            small.append((-h * pulls, potential.stiffness))
        self._directions = tuple(_form(channel.direction) for channel in memory.channels)
        for channel in memory.channels:
            newest = channel.newest(memory.sample_matrix.T)
            small.append((-h * memory.force_weights[:-1] @ newest, channel.direction))
        self._solve = _solver(small, s)
        self._histories = tuple(
            ComponentHistory(channel, memory.sample_matrix.shape[1], problem.n_steps + 1)
            for channel in memory.channels
        )
        self._mean = tables.weights @ tables.basis[1:].T
        self._row_weights = h * tables.test_weights[:-1].sum(axis=1)
        self._on_nodes = problem.skip_first_kick and bool(memory.channels)
        self._is_driven = has_moments(problem)
        self._moments = np.zeros((0, s + 1, scene.dimension))

    def run(self) -> Stepped:
        problem, memory = self._problem, self._problem.memory
        n_steps, d = problem.n_steps, problem.scene.dimension
        positions, momenta = np.empty((n_steps + 1, d)), np.empty((n_steps + 1, d))
        m = memory.sample_matrix.shape[1]
        forces = np.zeros((n_steps + 1 if self._on_nodes else 0, m, d))
        position, momentum = CompensatedSum(problem.position), CompensatedSum(problem.momentum)
        positions[0], momenta[0] = position.value, momentum.value
        offsets = [_times(form, memory.first_offset) for form in self._directions]
        constants = [_times(form, memory.offset) for form in self._directions]
        done, failure = 0, ""
        with np.errstate(over="ignore", invalid="ignore"):
            for index in range(n_steps):
                if index % STRIDE == 0:
                    advanced(index, n_steps)
                increments, change, force, offsets = self._step(
                    index, position.value, momentum.value, offsets, constants
                )
                if self._on_nodes:
                    forces[index] = force
                position.add(increments[-1])
                momentum.add(change)
                positions[index + 1], momenta[index + 1] = position.value, momentum.value
                done = index + 1
                farthest = float(np.abs(position.value).max())
                if not (np.isfinite(farthest) and np.isfinite(momentum.value).all()):
                    failure = f"not finite after step {index}, t = {done * problem.step_size:.6g}"
                    break
                if farthest > problem.stop_beyond:
                    break
            if self._on_nodes and done == n_steps:
                forces[done] = self._known(offsets)
        if self._on_nodes:
            forces = forces[: done + 1]
            for known in (memory.known_force, problem.extra_force):
                if known is not None:
                    forces = forces + known[: done + 1]
            # the first kick is left out; after a failure there is none at the end
            forces[0] = 0.0
            if done < n_steps:
                forces[done] = 0.0
        return Stepped(
            position=positions[: done + 1],
            momentum=momenta[: done + 1],
            samples=np.zeros((0, m, d)),
            end_force=forces,
            operations=sum(history.operations for history in self._histories),
            newton=NewtonRecord(),
            failure=failure,
        )

    def _known(self, offsets: list[Array]) -> Array:
        """Force of the finished samples and of the known part of the newest."""
        memory = self._problem.memory
        force = np.zeros((memory.sample_matrix.shape[1], self._problem.scene.dimension))
        for channel, history, offset in zip(memory.channels, self._histories, offsets, strict=True):
            force[:, history.support] += history.known()
            force += channel.newest(offset)
        return force

    def _step(
        self,
        index: int,
        position: Array,
        momentum: Array,
        offsets: list[Array],
        constants: list[Array],
    ) -> tuple[Array, Array, Array, list[Array]]:
        """Increments, change of momentum, damping force, and offsets of the next samples."""
        problem, memory = self._problem, self._problem.memory
        h = problem.step_size
        force = self._known(offsets)
        right = h * memory.force_weights[:-1] @ force
        right[0] -= momentum
        moments = self._known_moments(index)
        if moments is not None:
            right -= moments[:-1]
        if self._stiffness is not None:
            right += np.outer(self._row_weights, _times(self._stiffness, position))
        increments = self._solve(right)
        following = []
        for place, (channel, history) in enumerate(
            zip(memory.channels, self._histories, strict=True)
        ):
            moved = _times(self._directions[place], increments)
            newest = memory.sample_matrix.T @ moved
            force = force + channel.newest(newest)
            history.push((newest + offsets[place])[:, history.support])
            following.append(constants[place] + memory.carry_matrix.T @ moved)
        change = -h * memory.momentum_weights @ force
        if self._stiffness is not None:
            change = change - h * _times(self._stiffness, position + self._mean @ increments)
        if moments is not None:
            change = change + moments.sum(axis=0)
        return increments, change, force, following

    def _known_moments(self, index: int) -> Array | None:
        """Moments of all that is known in advance for one step."""
        if not self._is_driven:
            return None
        place = index % GROUP
        if place == 0:
            last = min(index + GROUP, self._problem.n_steps)
            self._moments = known_moments(self._problem, index, last)
        return np.asarray(self._moments[place])


class ComponentHistory:
    """One channel's history of samples that its direction has been applied to, step by step.

    Parameters
    ----------
    channel
        Weights and direction.
    samples
        Number m of samples per step.
    n_steps
        Number of steps whose force is wanted.
    """

    def __init__(self, channel: Channel, samples: int, n_steps: int) -> None:
        self.support: NDArray[np.intp] = np.flatnonzero(np.any(channel.direction != 0, axis=0))
        q = self.support.size
        unit = BatchedChannel(
            channel=replace(channel, direction=np.eye(1)), directions=np.ones((q, 1, 1))
        )
        self._channel, self._m = channel, samples
        self._damped = channel.memory > 1
        self._groups = GroupHistory((unit,) if self._damped else (), samples, GROUP, n_steps)
        self._reach = min(GROUP - BLOCK, channel.memory - 1)
        self._strip = shared_strip(unit, BLOCK, self._reach, samples) if self._damped else None
        weights = channel.weights[1:BLOCK]
        if channel.is_scalar:
            weights = weights[:, None, None] * np.eye(samples)
        # the latest sample last
        self._near = np.ascontiguousarray(weights[::-1].transpose(1, 0, 2).reshape(samples, -1))
        self._group = np.zeros((q, GROUP * samples))
        self._force = np.zeros((GROUP, samples, q))
        self._ahead = np.zeros((BLOCK, samples, q))
        self._count, self._direct = 0, 0

    @property
    def operations(self) -> int:
        """Multiply-adds, weight times sample, done so far."""
        return self._direct + self._groups.operations

    def known(self) -> Array:
        """Force of all finished samples on the step to come, shape ``(m, q)``."""
        m, place = self._m, self._count % GROUP
        if not self._damped:
            return np.zeros((m, self.support.size))
        inside = place % BLOCK
        force = self._ahead[inside]
        reach = min(inside, self._channel.memory - 1)
        if reach:
            past = self._group[:, (place - reach) * m : place * m]
            force = force + self._near[:, self._near.shape[1] - reach * m :] @ past.T
        return np.asarray(force)

    def push(self, samples: Array) -> None:
        """Append the samples of a finished step, shape ``(m, q)``."""
        if not self._damped:
            return
        m, place = self._m, self._count % GROUP
        inside = place % BLOCK
        self._direct += min(inside, self._channel.memory - 1) * m * m * self.support.size
        self._group[:, place * m : (place + 1) * m] = samples.T
        self._count += 1
        place += 1
        if place == GROUP:
            index = self._count // GROUP
            finished = self._group.reshape(-1, GROUP, m)[..., None]
            self._groups.finish(index - 1, finished)
            if index * GROUP < self._groups.samples.shape[-1]:
                self._force = self._groups.force_on(index)[..., 0].transpose(1, 2, 0)
            place = 0
        if place % BLOCK == 0:
            self._look_ahead(place)

    def _look_ahead(self, place: int) -> None:
        """Force of earlier blocks on the next one."""
        q, m = self.support.size, self._m
        self._ahead = self._force[place : place + BLOCK]
        reach = min(place, self._reach)
        if reach and self._strip is not None:
            past = self._group[:, None, (place - reach) * m : place * m]
            force = self._strip.force(past).reshape(q, BLOCK, m)
            self._ahead = self._ahead + force.transpose(1, 2, 0)
            self._direct += self._strip.operations(reach)


def _form(matrix: Array) -> Form:
    """The matrix itself, or a sparse one where it has few entries."""
    if np.count_nonzero(matrix) > SPARSE_DENSITY * matrix.size:
        return matrix
    from scipy.sparse import csr_array

    return csr_array(matrix)


def _times(form: Form, values: Array) -> Array:
    """Rows times a symmetric matrix, shape ``(d,)`` or ``(n, d)`` to the same."""
    return np.asarray((form @ values.T).T)


def _solver(terms: list[tuple[Array, Array]], s: int) -> Callable[[Array], Array]:
    """Solve sum_j A_j x M_j = right for x, shape ``(s, d)``, A_j acting on the rows."""
    d = terms[0][1].shape[0]
    forms = [_form(form) for _, form in terms]
    if any(isinstance(form, np.ndarray) for form in forms):
        dense = sum((np.kron(a, form) for a, form in terms), start=np.zeros((s * d, s * d)))
        inverse = np.linalg.inv(dense)
        return lambda right: np.asarray((inverse @ right.ravel()).reshape(s, d))
    from scipy.sparse import csc_array, kron
    from scipy.sparse.linalg import splu

    # the unknowns of a component side by side: the band of the forms, s times as wide
    total = csc_array((s * d, s * d))
    for (a, _), form in zip(terms, forms, strict=True):
        total = total + kron(form, a, format="csc")
    factors = splu(csc_array(total))
    return lambda right: np.asarray(factors.solve(right.T.ravel()).reshape(d, s).T)
