r"""The discrete equations of a run, linearised along it, and solved in both directions.

A disturbance of the scene changes the load vectors of the steps: with the motion held fixed it
changes P by :math:`\partial P` and Q - F by :math:`\partial Q`, and so
:math:`g_\nu = \sum_i b_i (l_\nu' \partial P_i + h l_\nu \partial Q_i)`.

A block maps position x and momentum p at its beginning, the forces F of the past at its stages
(term by term, without their matrices) and load vectors g to x and p after it, to the velocities V
at its stages and to the positions X at the ends of its other steps,

.. math:: (x', p', V, X) = T\,(x, p, F) + G g, \qquad z' = A z + Q V, \qquad F = R z,

where z are the states of the memory. For equal steps of a linear scene the maps come from the
engine's operator; otherwise every step has maps of its own, with the second derivatives at its
stages.

Solved forwards, this gives the effect of disturbances on the trajectory, one column for each.
Solved backwards, all matrices transposed, it gives the effect of *all* disturbances on one number:
the mirror equation of the restricted Hamilton's principle (Hariz Belgacem, Jimenez, Ober-Bloebaum,
arXiv 2403.18362), on the same mesh.

Shapes: n steps, p columns, d components; k blocks of B steps, m stages of a step, f damping terms,
J states.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances import PIECE, DampingAlong, pieces_of_equal_steps
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.engine.block import Block
from fvi_cli.integrator.engine.law import Linear, StepLaw, law_of
from fvi_cli.integrator.engine.step import Frame, dense_step, unit_tables
from fvi_cli.integrator.memory.damping import Damping
from fvi_cli.integrator.memory.exponentials import ExponentialKernels, Exponentials
from fvi_cli.integrator.memory.interface import Combination
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Slope, Term
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array

LARGEST_STEP = 1500
"""Most unknowns (degree times components) of a step: matrices of that size are inverted."""
LARGEST_BLOCK = 256
"""Most unknowns of a block of a linear scene."""
AT_ONCE = 2**21
"""Most entries of the matrices P of steps that are computed together."""
EQUAL_STEPS = 8
"""Steps are solved in blocks if at least this many, on average, have the same length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """Effect of p changes of a scene on the equations of a run of n steps, at fixed motion."""

    loads: Array  # load vectors, (p, n, s + 1, d)
    position: Array  # at the start, (p, d)
    momentum: Array
    damping: Array  # force at the stages, (p, n, m, d), already included in the loads


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """Effect of p disturbances on a trajectory."""

    run: LinearisedRun
    position: Array  # at the points of the mesh, (p, n + 1, d)
    velocity: Array  # at the stages, (p, n, m, d)

    @cached_property
    def plain_forces(self) -> Array:
        """Changes of the forces of terms without their matrices, ``(f, p, n, m, d)``."""
        return self.run.plain_changes(self.velocity)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cotangent(Disturbance):
    """Changes of one number by unit disturbances of each kind, without the axis of p."""

    def along(self, change: Disturbance) -> Array:
        """The derivatives of that number, shape ``(p,)``."""
        parts = [(getattr(change, name), own) for name, own in vars(self).items()]
        return np.asarray(sum(a.reshape(len(a), -1) @ b.ravel() for a, b in parts))


class LinearisedRun:
    """A run of a Runge-Kutta method, ready for tangents and adjoints.

    For a linear scene only the mesh of the steps counts. `step_solves` counts systems of one step
    that were solved; several right-hand sides of one matrix count once.

    Raises
    ------
    ValueError
        For steps with too many unknowns, or whose linearised equations have no unique solution.
    """

    def __init__(self, scene: Scene, method: Method, steps: RunSteps) -> None:
        self.scene, self.method, self.steps, self.step_solves = scene, method, steps, 0
        self.tables, self.d = steps.tables, scene.dimension
        if self._size > LARGEST_STEP:
            raise ValueError(
                f"derivatives: {self._size} unknowns in a step; steps of at most {LARGEST_STEP} "
                "are linearised"
            )
        # matrices of all damping terms and laws, those of laws times their size, (f, d, d); a scene
        # without damping has a damper of order 1 and coefficient 0
        found = [one.matrix for one in scene.damping]
        found += [one.size * one.matrix for one in scene.laws]
        self.coefficients = np.array(found or [np.zeros((self.d, self.d))])
        self._exponents = [min(1.0 - one.order, LARGEST_EXPONENT) for one in scene.damping]
        terms: list[Term] = [*self._exponents, *(one.kernel for one in scene.laws)]
        self._terms = terms or [0.0]
        self._damping = self._damping_of(self._terms, self.coefficients, np.zeros((1, self.d)))
        whole = [Decoupling(mass=scene.inertia.mass, modes=None)] if scene.is_linear else None
        self._law = law_of([scene], whole)

    @property
    def _size(self) -> int:
        """Unknowns of a step."""
        return self.tables.degree * self.d

    @property
    def points(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and times of all stages."""
        return self.steps.stage_position, self.steps.velocity, self.steps.stage_time

    def loads_by(self, momentum: Array, force: Array) -> Array:
        """Load vectors ``(n, s + 1, d)`` of changes of P and of Q - F at the stages."""
        t, found = self.tables, np.zeros((self.steps.n_steps, self.tables.degree + 1, self.d))
        h = self.steps.step_size[:, None, None]
        if momentum.any():
            found += np.tensordot(t.weights * t.slopes, momentum, axes=(1, 1)).swapaxes(0, 1)
        if force.any():
            found += h * np.tensordot(t.test_weights, force, axes=(1, 1)).swapaxes(0, 1)
        return found

    # --- the damping of the scene, term by term ---

    def _damping_of(self, terms: Sequence[Term], matrices: Array, start: Array) -> Damping:
        """Damping by terms with a matrix each, for motions with the start velocities `start`."""
        sizes = self.steps.step_size
        shortest = float(sizes.min())
        memory = Exponentials(
            self.method,
            tuple(dict.fromkeys(terms)),
            shortest_step=shortest,
            final_time=self.scene.final_time,
            steps=float((shortest / sizes).sum()),
        )
        combinations = [
            Combination.made(
                memory,
                [[term]],
                np.ones((1, 1)),
                matrix[None],
                is_relative=_exponent(term) < 0,
            )
            for term, matrix in zip(terms, matrices, strict=True)
        ]
        return Damping(combinations, memory, start)

    def _plain(self, terms: Sequence[Term], velocity: Array, start: Array) -> Array:
        """Forces without matrices, ``(f, p, n, m, d)``, from velocities ``(p, n, m, d)``."""
        unit = np.broadcast_to(np.eye(self.d), (len(terms), self.d, self.d))
        damping = self._damping_of(terms, unit, start)
        sizes = self.steps.step_size
        return DampingAlong(
            damping=damping,
            step_sizes=sizes,
            inputs=velocity,
            longest=_block_of(4 * sizes.size, PIECE),
        ).forces()

    def forces_of(self, terms: Sequence[Term]) -> Array:
        """Forces of terms on this motion, without matrices, ``(f, n, m, d)``."""
        start = self.scene.initial_velocity[None]
        return self._plain(terms, self.steps.velocity[None], start)[:, 0]

    @cached_property
    def plain_forces(self) -> Array:
        """Forces of all terms without their matrices, then minus their derivatives by orders.

        Terms with a coefficient of zero are included; laws have no orders.
        """
        return self.forces_of([*self._terms, *map(Slope, self._exponents)])

    def plain_changes(self, velocity: Array) -> Array:
        """Changes of these, ``(f, p, n, m, d)``, by changes of velocities ``(p, n, m, d)``."""
        return self._plain(self._terms, velocity, np.zeros((len(velocity), self.d)))

    def plain_by_start(self, velocity: Array) -> Array:
        """Changes of these by a start velocity ``(d,)`` that is subtracted, ``(f, n, m, d)``."""
        rest = np.zeros_like(self.steps.velocity)
        if not (velocity.any() and self._damping.is_relative):
            return np.zeros((len(self._terms), *rest.shape))
        return self._plain(self._terms, rest[None], velocity[None])[:, 0]

    # --- from block to block ---

    @cached_property
    def _is_regular(self) -> bool:
        """Whether so many steps have equal lengths that blocks of them are worth their tables."""
        sizes = self.steps.step_size
        stretches = 1 + np.count_nonzero(np.diff(sizes))
        return self.scene.is_linear and bool(EQUAL_STEPS * stretches <= sizes.size)

    @cached_property
    def _sequences(self) -> list[BlockSequence]:
        sizes = self.steps.step_size
        if self._is_regular:
            return list(_equal_steps(sizes, LARGEST_BLOCK // self._size))
        together = max(1, AT_ONCE // self._size**2)
        firsts = range(0, sizes.size, together)
        return [BlockSequence(first, min(together, sizes.size - first), 1) for first in firsts]

    def _maps(self, blocks: BlockSequence) -> Maps:
        sizes, law, common = self.steps.step_size, self._law, (self.method, self._damping)
        try:
            if isinstance(law, Linear) and self._is_regular:
                h = float(sizes[blocks.first])
                return maps_of_equal_steps(law, *common, h, blocks.count, blocks.number)
            position, velocity, time = (one[blocks.steps] for one in self.points)
            return maps_of_steps(law, *common, sizes[blocks.steps], (position, velocity, time))
        except np.linalg.LinAlgError:
            raise ValueError(
                "derivatives: the linearised equations of a step have no unique solution"
            ) from None

    def _sweep(
        self, maps: Maps, given: Array, found: Array, end: Array, states: Array, *, back: bool
    ) -> tuple[Array, Array]:
        """Go through a sequence of blocks by T, or back by its transpose.

        Takes position and momentum ``(2 d, p)`` and states ``(J, d p)``, and returns both after the
        last block. They are added to `given`, ``(k, .., p)``, on which T acts; the values of T are
        added to `found`.
        """
        whole, give, take = maps.by_state, maps.response, maps.intake
        if back:
            whole, give, take = whole.swapaxes(1, 2), take.swapaxes(1, 2), give.swapaxes(1, 2)
        k, _, p = found.shape
        d, every = self.d, list(whole) if len(whole) > 1 else [whole[0]] * k
        first, behind = 2 * d, (2 + give.shape[1]) * d
        last = (2 + take.shape[2]) * d
        # np.dot is the quickest product of small matrices
        for index in reversed(range(k)) if back else range(k):
            which, on, values = maps.which[index], given[index], found[index]
            on[:first] += end
            on[first:behind] += np.dot(give[which], states).reshape(-1, p)
            values += np.dot(every[index], on)
            end = values[:first]
            states = maps.decay[which] * states
            states += np.dot(take[which], values[first:last].reshape(-1, d * p))
        return end, states

    def tangent(self, change: Disturbance) -> Tangent:
        """Effect of disturbances on the trajectory."""
        d, (p, n, m, _) = self.d, change.damping.shape
        positions, velocities = np.empty((p, n + 1, d)), np.empty((p, n, m, d))
        positions[:, 0] = change.position
        end = np.concatenate([change.position.T, change.momentum.T])
        states = np.zeros((self._damping.n_states, d * p))
        for one in self._sequences if p else ():
            maps, k, count = self._maps(one), one.number, one.count
            loads = change.loads[:, one.steps].reshape(p, k, -1).transpose(1, 2, 0)
            found, given = _times(maps.by_load, loads), np.zeros((k, maps.by_state.shape[2], p))
            end, states = self._sweep(maps, given, found, end, states, back=False)
            by_column = found.transpose(2, 0, 1)
            last, _, velocity, inner = np.split(by_column, np.cumsum([d, d, count * m * d]), axis=2)
            velocities[:, one.steps] = velocity.reshape(p, -1, m, d)
            position = np.concatenate([inner, last], axis=2)
            positions[:, one.first + 1 : one.steps.stop + 1] = position.reshape(p, -1, d)
        self.step_solves += n
        return Tangent(run=self, position=positions, velocity=velocities)

    def adjoint(
        self,
        position: Array,
        velocity: Array,
        force: Array | None = None,
        terms: Array | None = None,
    ) -> Cotangent:
        """Effect of disturbances of all kinds on one number.

        The arguments are derivatives of the number: by positions at the points of the mesh,
        ``(n + 1, d)``; at the stages by velocities and by the force F of all damping, ``(n, m, d)``
        each; and by the force of each term without its matrix, ``(f, n, m, d)``.
        """
        d, f = self.d, len(self.coefficients)
        drawn = np.zeros((f, *velocity.shape)) if terms is None else terms
        if force is not None:
            drawn = drawn + np.matmul(force, self.coefficients[:, None])
        loads = np.empty((len(velocity), self.tables.degree + 1, d))
        end = np.concatenate([position[-1], np.zeros(d)])[:, None]
        states = np.zeros((self._damping.n_states, d))
        for one in reversed(self._sequences):
            maps, k, count = self._maps(one), one.number, one.count
            own = position[one.steps].reshape(k, count * d)
            direct = velocity[one.steps].reshape(k, -1, d)
            found = np.zeros((k, maps.by_state.shape[2], 1))
            # the position where a block begins is that after the block before
            found[:, :d, 0] = own[:, :d]
            if drawn.any():
                pulled = drawn[:, one.steps].reshape(f, k, -1, d)
                by_stages = np.matmul(maps.local[:, maps.which].swapaxes(2, 3), pulled)
                direct = direct + by_stages.sum(axis=0)
                found[:, 2 * d :, 0] = pulled.swapaxes(0, 1).reshape(k, -1)
            edge = np.zeros((k, 2 * d))
            given = np.concatenate([edge, direct.reshape(k, -1), own[:, d:]], axis=1)[..., None]
            end, states = self._sweep(maps, given, found, end, states, back=True)
            by_load = _times(maps.by_load.swapaxes(1, 2), given)
            loads[one.steps] = by_load.reshape(k * count, -1, d)
        self.step_solves += self.steps.n_steps
        return Cotangent(
            loads=loads,
            position=end[:d, 0],
            momentum=end[d:, 0],
            damping=np.zeros_like(velocity) if force is None else force,
        )


@dataclass(frozen=True)
class BlockSequence:
    """Successive blocks of steps."""

    first: int  # number of the first step
    number: int  # number k of blocks
    count: int  # number B of steps in a block

    @property
    def steps(self) -> slice:
        """Its steps."""
        return slice(self.first, self.first + self.number * self.count)


def damped(plain: Array, matrices: Array | Sequence[Array]) -> Array:
    """The force of all damping, from the matrices of terms and their forces without these."""
    total = np.zeros(plain.shape[1:])
    for force, matrix in zip(plain, matrices, strict=False):
        if matrix.any():
            total += np.matmul(force, matrix)
    return total


def _exponent(term: Term) -> float:
    """Exponent of the integral of a damping term, or of its derivative by order; 0 for laws."""
    if isinstance(term, Slope):
        return term.exponent
    return term if isinstance(term, float) else 0.0


def _times(matrices: Array, values: Array) -> Array:
    """Matrices ``(k or 1, a, b)`` on ``(k, b, p)``; one product if all share a matrix."""
    if len(matrices) > 1:
        return np.asarray(np.matmul(matrices, values))
    k, b, p = values.shape
    found = np.dot(matrices[0], values.swapaxes(0, 1).reshape(b, k * p))
    return np.ascontiguousarray(found.reshape(-1, k, p).swapaxes(0, 1))


def _block_of(n_steps: int, longest: int) -> int:
    """B of N equal steps, a power of 2 with 16 B^2 <= N: tables are made step by step."""
    count = 1
    while 2 * count <= longest and 16 * count * count <= n_steps:
        count *= 2
    return count


def _equal_steps(sizes: Array, longest: int) -> Iterator[BlockSequence]:
    """Blocks of equal steps, in sequences."""
    for begin, end in pieces_of_equal_steps(sizes, sizes.size):
        done, count = begin, _block_of(end - begin, longest)
        while done < end:
            count = min(count, end - done)
            blocks = (end - done) // count
            yield BlockSequence(done, blocks, count)
            done += blocks * count


# --- maps of blocks ---

Points = tuple[Array, Array, Array]
"""Positions ``(n, m, d)``, velocities and times ``(n, m)`` at the stages of n steps."""


class Maps(NamedTuple):
    """Tables of k blocks of B steps; the first axis has one table for all blocks, or one for each.

    Tables of the memory are for u different lengths of steps, f terms and J states.
    """

    by_state: Array  # T, (1 or k, (1 + B + B m) d, (2 + f B m) d)
    by_load: Array  # G, (1 or k, (1 + B + B m) d, B (s + 1) d)
    which: list[int]  # index of the step length of every block, (k,)
    local: Array  # from velocities of a block to its forces, (f, u, B m, B m)
    response: Array  # from states at its beginning to its forces, (u, f B m, J)
    intake: Array  # from velocities of a block to states after it, (u, J, B m)
    decay: Array  # factors of the states over a block, (u, J, 1)


def maps_of_equal_steps(
    law: Linear, method: Method, damping: Damping, h: float, count: int, blocks: int
) -> Maps:
    """Tables of blocks of equal steps of a linear scene.

    Raises
    ------
    numpy.linalg.LinAlgError
        If their equations have no unique solution.
    """
    d = damping.start_velocity.shape[-1]
    frame = Frame(unit_tables(method, d, False), damping, h, count)
    matrices = [dense(one.matrix) for one in damping.combinations]
    step = dense_step(frame.unit, law.at, h, [one[:, 0] for one in frame.damp], matrices)
    if step.singular.any():
        raise np.linalg.LinAlgError
    block = Block(frame, step, matrices, has_position=True)
    rows = np.concatenate([block.start, block.by_load], axis=2)
    by_step = rows.reshape(1, count, -1, d, rows.shape[2])
    assert frame.memory is not None
    kernels = frame.memory.kernels
    assert isinstance(kernels, ExponentialKernels)
    return Maps(
        *_arranged(damping, frame.unit.tables.to_inputs, by_step, frame.to_loads[None]),
        which=[0] * blocks,
        local=np.array(frame.memory.local),
        response=_by_term(damping, kernels.response[None]),
        intake=kernels.intake[None],
        decay=1.0 + kernels.change[None, :, None],
    )


def maps_of_steps(
    law: StepLaw | Linear, method: Method, damping: Damping, sizes: Array, points: Points
) -> Maps:
    """Tables of n steps of any lengths, linearised at the points of each.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the equations of one have no unique solution.
    """
    assert isinstance(damping.memory, Exponentials)
    t = step_tables(method)
    lengths, which = np.unique(sizes, return_inverse=True)
    by_term, response, intake, change = damping.memory.of_steps(lengths)
    local = np.array([one.combine(by_term.swapaxes(0, 1))[0] for one in damping.combinations])
    position, velocity, time = points
    n, _, d = position.shape
    s, h = t.degree, sizes[:, None, None]
    unit = unit_tables(method, d, law.has_rates)
    at_stages = np.concatenate([position, velocity], axis=2) if law.has_rates else position
    at = law.at if isinstance(law, Linear) else law.expand(np.zeros((1, d)), at_stages, time)[0]
    to_loads = -h * t.to_loads
    damp = [to_loads @ one[which] @ t.to_inputs for one in local]
    step = dense_step(unit, at, h, damp, [dense(one.matrix) for one in damping.combinations])
    if step.singular.any():
        raise np.linalg.LinAlgError
    cases = np.broadcast_to(np.eye((s + 3) * d), (n, (s + 3) * d, (s + 3) * d))
    loads = cases[..., 2 * d :].reshape(n, -1, s + 1, d)
    u, dx, dp = step.solve(cases[..., :d], cases[..., d : 2 * d], loads)
    rows = np.concatenate([u, dx[:, :, None], dp[:, :, None]], axis=2)
    return Maps(
        *_arranged(damping, t.to_inputs, rows.transpose(0, 2, 3, 1)[:, None], to_loads),
        which=which.tolist(),
        local=local,
        response=_by_term(damping, response),
        intake=intake,
        decay=1.0 + change[..., None],
    )


def _arranged(
    damping: Damping, to_inputs: Array, rows: Array, to_loads: Array
) -> tuple[Array, Array]:
    """T and G from the rows of blocks, ``(k, B, s + 2, d, 2 d + B (s + 1) d)``.

    `to_loads` are from damping forces to load vectors of a step, ``(k, s + 1, m)``.
    """
    k, count, _, d, width = rows.shape
    velocity = np.matmul(to_inputs, rows[:, :, :-2].reshape(k, count, -1, d * width))
    ends, momentum = rows[:, :, -2].copy(), rows[:, -1, -1].copy()
    ends[..., :d] += np.eye(d)
    momentum[..., d : 2 * d] += np.eye(d)
    inner = ends[:, :-1].reshape(k, -1, width)
    whole = np.concatenate([ends[:, -1], momentum, velocity.reshape(k, -1, width), inner], axis=1)
    by_load = whole[..., 2 * d :]
    by_step = by_load.reshape(k, -1, to_loads.shape[1], d)
    by_force = np.matmul(to_loads.swapaxes(1, 2)[:, None], by_step)
    terms = [
        np.matmul(by_force, dense(one.matrix)[:, None]).reshape(*whole.shape[:2], -1)
        for one in damping.combinations
    ]
    return np.concatenate([whole[..., : 2 * d], *terms], axis=2), by_load


def _by_term(damping: Damping, response: Array) -> Array:
    """Responses ``(u, B m, J)`` with the weights of every term, ``(u, f B m, J)``."""
    weights = np.array([one.weights[0] for one in damping.combinations])
    u, samples, states = response.shape
    found = weights[:, None] * response[:, None]
    return np.asarray(found.reshape(u, len(weights) * samples, states))
