r"""The discrete equations of a run, linearised along it, and solved in both directions.

A disturbance of the scene changes the load vectors of the steps: with the motion held fixed it
changes P by :math:`\partial P` and Q - F by :math:`\partial Q`, and so
:math:`g_\nu = \sum_i b_i (l_\nu' \partial P_i + h l_\nu \partial Q_i)`. A block of B steps of the
engine is then one matrix T,

.. math:: (x', p', W) = T\,(x, p, F) + G g, \qquad F = R z, \quad z' = z + P z + Q W,

from position, momentum and the forces F of the past to position and momentum behind it and to the
velocities W at its stages, which drive the memory. It is made of the operator of the block, whose
second derivatives are those on the trajectory: of a linear scene there is one for all blocks of
equal steps, otherwise one for every step. Forwards this gives what a disturbance does to the
trajectory, one column for each. Backwards, all transposed, it gives what *all* disturbances do to
one number: the mirror equation of the restricted Hamilton's principle (Hariz Belgacem, Jimenez,
Ober-Bloebaum, arXiv 2403.18362), on the same mesh.

Shapes: n steps, p columns, d components; k blocks of B steps, s unknowns U and m stages of a step,
f damping terms, J states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.gradients.equations import Equations, Maps
from fvi_cli.integrator.gradients.past import LinearisedMemory, LinearisedStretch, are_regular
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Slope, Term
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

LARGEST_STEP = 1500
"""Stages times components up to which steps are linearised: matrices of that size are inverted."""
LARGEST_BLOCK = 256
"""Unknowns of a block of a linear scene."""
AT_ONCE = 2**21
"""Entries of the matrices T of steps that are made together."""
KEPT = 8
"""Stretches of a linear scene whose matrices are kept."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """What p changes of a scene do to the equations of a run of n steps, its motion held fixed."""

    loads: Array  # load vectors, (p, n, s + 1, d)
    position: Array  # initial data, (p, d)
    velocity: Array
    momentum: Array
    damping: Array  # force at the stages, (p, n, r, d), which is in the loads already


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """What p disturbances do to a trajectory."""

    position: Array  # at the points of the mesh, (p, n + 1, d)
    unknowns: Array  # of steps, (p, n, s, d)


@dataclass(frozen=True, kw_only=True, eq=False)
class Cotangent:
    """What one number changes by for unit disturbances, the parts of :class:`Disturbance`."""

    loads: Array
    position: Array
    velocity: Array
    momentum: Array
    damping: Array | None = None

    def along(self, change: Disturbance) -> Array:
        """The derivatives of that number, shape ``(p,)``."""
        parts = [(getattr(self, name), getattr(change, name)) for name in vars(self)]
        own = [(a.ravel(), b.reshape(len(b), -1)) for a, b in parts if a is not None]
        return np.asarray(sum(b @ a for a, b in own))


class LinearisedRun:
    """A run of a Runge-Kutta method, ready for tangents and adjoints.

    Of a linear scene the mesh of the steps alone counts. `step_solves` counts systems of one step
    that were solved, a matrix with several right-hand sides once.

    Raises
    ------
    ValueError
        For steps with too many unknowns, or whose linearised equations have no unique solution.
    """

    def __init__(self, scene: Scene, method: Method, steps: RunSteps) -> None:
        self.scene, self.method, self.steps, self.step_solves = scene, method, steps, 0
        self.tables, self.d = steps.tables, scene.dimension
        size = self.tables.degree * self.d
        if size > LARGEST_STEP:
            raise ValueError(
                f"derivatives: {size} unknowns in a step; steps of at most {LARGEST_STEP} are "
                "linearised"
            )
        self._to_inputs, self._kept = self.tables.to_inputs, dict[int, Maps]()
        damping, laws = scene.damping, scene.laws
        found = [one.matrix for one in damping] + [o.size * o.matrix for o in laws]
        # matrices of all damping terms and laws, those of laws times their size, (f, d, d)
        self.coefficients = np.array(found).reshape(-1, self.d, self.d)
        exponents = [min(1.0 - one.order, LARGEST_EXPONENT) for one in damping]
        above = [scene.derivative == "caputo" and one.order > 1 for one in damping]
        # the derivatives by orders have the same states
        terms: list[Term] = [*exponents, *(one.kernel for one in laws)]
        slopes = [Slope(one) for one in exponents]
        every = [*terms, *slopes], above + [False] * len(laws) + above
        is_regular = scene.is_linear and are_regular(steps.step_size)
        self._past = self._known = LinearisedMemory(
            method,
            *every,
            steps.step_size,
            scene.final_time,
            longest=max(1, LARGEST_BLOCK // size) if is_regular else 1,
            together=steps.n_steps if is_regular else max(1, AT_ONCE // size**2),
        )
        if not scene.is_linear:
            self._known = self._past_of(*every)
        self._equations = Equations(
            scene,
            method,
            self.coefficients,
            terms,
            self._past.memory,
            is_regular=is_regular,
        )

    def _past_of(self, terms: Sequence[Term], is_relative: Sequence[bool]) -> LinearisedMemory:
        """The past of motions that are known, in long blocks."""
        sizes, m = self.steps.step_size, self.method.stages
        longest = LARGEST_BLOCK // m if are_regular(sizes) else 1
        return LinearisedMemory(
            self.method,
            terms,
            is_relative,
            sizes,
            self.scene.final_time,
            longest=longest,
            together=sizes.size,
        )

    @cached_property
    def points(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and times of all stages."""
        return self.steps.stage_position, self.steps.velocity, self.steps.stage_time

    def loads_by(self, momentum: Array, force: Array) -> Array:
        """Load vectors ``(n, s + 1, d)`` of changes of P and of Q - F at the stages."""
        t, found = self.tables, np.zeros((self.steps.n_steps, self.tables.degree + 1, self.d))
        for table, values, power in (
            (t.weights * t.slopes, momentum, 0),
            (t.test_weights, force, 1),
        ):
            if values.any():
                own = np.tensordot(table, values, axes=(1, 1)).swapaxes(0, 1)
                found += self.steps.step_size[:, None, None] ** power * own
        return found

    # --- the damping of the scene, term by term ---

    def forces_of(self, kernels: Sequence[RelaxationKernel]) -> Array:
        """Forces of relaxation laws on this motion, without matrices, ``(f, n, m, d)``."""
        past = self._past_of(kernels, [False] * len(kernels))
        return past.along(self.steps.velocity, self.scene.initial_velocity)

    @cached_property
    def plain_forces(self) -> Array:
        """Forces of all terms without their matrices, then minus their derivatives by orders.

        Terms with a coefficient of zero are among them; laws have no orders.
        """
        return self._known.along(self.steps.velocity, self.scene.initial_velocity)

    @property
    def damping_force(self) -> Array:
        """Force F of all damping at the stages, ``(n, m, d)``."""
        return self._damped(self.plain_forces)

    def damping_changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """What disturbances do to F, ``(p, n, m, d)``."""
        found = change.damping.copy()
        for own, plain in zip(found, self.plain_changes(tangent, change), strict=True):
            own += self._damped(plain)
        return found

    def plain_changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """What disturbances do to :attr:`plain_forces` by the motion, ``(p, f, n, m, d)``."""
        pairs = zip(tangent.unknowns, change.velocity, strict=True)
        known = self._known
        return np.array([known.along(np.matmul(self._to_inputs, o), start) for o, start in pairs])

    def _damped(self, plain: Array) -> Array:
        zero = np.zeros(plain.shape[1:])
        acting = zip(plain, self.coefficients, strict=False)
        return sum((np.matmul(force, matrix) for force, matrix in acting), zero)

    # --- from block to block ---

    def _maps(self, stretch: LinearisedStretch) -> Maps:
        if not self.scene.is_linear:
            return self._equations.maps(stretch, self.points)
        # they serve the motion and its changes
        maps = self._kept.get(stretch.first) or self._equations.maps(stretch, None)
        if len(self._kept) < KEPT:
            self._kept[stretch.first] = maps
        return maps

    def _sweep(
        self,
        stretch: LinearisedStretch,
        whole: Array,
        added: Array,
        end: Array,
        states: Array,
        *,
        back: bool,
    ) -> tuple[Array, Array, Array, Array]:
        """Through a stretch by T ``(k or 1, .., ..)``, or back by its transpose.

        From position and momentum ``(2 d, p)`` and states ``(J, d p)``: on what T acted, its values
        with what is added to them ``(k, .., p)``, and both behind the last block.
        """
        f, take = len(self.coefficients), stretch.intake
        u, j, samples = take.shape
        give = stretch.response[:, :f].reshape(u, f * samples, j)
        if back:
            give, take = take.swapaxes(1, 2), give.swapaxes(1, 2)
        k, _, p = added.shape
        given, found, first = np.zeros((k, whole.shape[2], p)), added.copy(), 2 * self.d
        maps = list(whole) if len(whole) > 1 else [whole[0]] * k
        # of small matrices the plainest product is the quickest
        for index in reversed(range(k)) if back else range(k):
            which, on, values = stretch.which[index], given[index], found[index]
            on[:first] = end
            on[first:] = np.dot(give[which], states).reshape(-1, p)
            values += np.dot(maps[index], on)
            end = values[:first]
            states = stretch.decay[which] * states
            states += np.dot(take[which], values[first:].reshape(-1, self.d * p))
        return given, found, end, states

    def tangent(self, change: Disturbance) -> Tangent:
        """What disturbances do to the trajectory."""
        s, (p, d), n = self.tables.degree, change.position.shape, self.steps.n_steps
        positions, unknowns = np.empty((p, n + 1, d)), np.empty((p, n, s, d))
        positions[:, 0] = change.position
        if not p:
            return Tangent(position=positions, unknowns=unknowns)
        end = np.concatenate([change.position.T, change.momentum.T])
        states = np.zeros((self._past.n_states, d * p))
        for one in self._past.stretches:
            maps, own, k = self._maps(one), _blocks(change.loads, one), one.blocks
            free = _times(maps.by_load, own)
            added = np.concatenate([_times(maps.ends, free), self._inputs(free)], axis=1)
            added[:, d : 2 * d] += own.reshape(k, -1, d, p).sum(axis=1)
            # a start velocity that is subtracted is a force of the past
            starts = one.starts[:, : len(self.coefficients)].reshape(k, -1, 1, 1)
            moving = np.zeros((k, maps.whole.shape[2], p))
            moving[:, 2 * d :] = (starts * change.velocity.T).reshape(k, -1, p)
            added += _times(maps.whole, moving)
            given, _, end, states = self._sweep(one, maps.whole, added, end, states, back=False)
            moved = free + _times(maps.by_begin, given + moving)
            unknowns[:, one.steps] = _steps(moved, one).reshape(p, -1, s, d)
            last = moved.reshape(k, one.count, s, d, p)[:, :, -1]
            h = one.sizes[one.which][:, None, None, None]
            displacement = (given[:, None, :d] + h * last.cumsum(axis=1)).reshape(k, -1, p)
            positions[:, one.first + 1 : one.steps.stop + 1] = _steps(displacement, one)
        self.step_solves += n
        return Tangent(position=positions, unknowns=unknowns)

    def adjoint(
        self,
        position: Array,
        unknowns: Array,
        damping: Array | None = None,
        terms: Array | None = None,
    ) -> Cotangent:
        """What disturbances of all kinds do to one number.

        Given are its derivatives by positions at the points of the mesh, ``(n + 1, d)``, by the
        unknowns of steps, ``(n, s, d)``, and at the stages by the force F of all damping,
        ``(n, m, d)``, and of each term without its matrix, ``(f, n, m, d)``.
        """
        d, s, f = self.d, self.tables.degree, len(self.coefficients)
        end = np.concatenate([position[-1], np.zeros(d)])[:, None]
        states, velocity = np.zeros((self._past.n_states, d)), np.zeros(d)
        loads = np.empty((self.steps.n_steps, s + 1, d))
        for one in reversed(self._past.stretches):
            maps, k = self._maps(one), one.blocks
            h = one.sizes[one.which][:, None, None]
            # positions at the points inside of a block are its own work
            own = position[one.steps].reshape(k, one.count, d)
            by_step = unknowns[one.steps].reshape(k, one.count, s, d).copy()
            by_step[:, :-1, -1] += h * own[:, :0:-1].cumsum(axis=1)[:, ::-1]
            direct = by_step.reshape(k, -1, 1)
            added = np.zeros((k, maps.whole.shape[2], 1))
            if f and not (damping is None and terms is None):
                drawn = np.zeros((k, f, one.count * len(self._to_inputs), d))
                if damping is not None:
                    force = damping[one.steps].reshape(k, 1, -1, d)
                    drawn += np.matmul(force, self.coefficients)
                if terms is not None:
                    drawn += terms[:, one.steps].reshape(f, k, -1, d).swapaxes(0, 1)
                local = one.local[one.which, :f].swapaxes(2, 3)
                pulled = np.matmul(local, drawn).sum(axis=1)
                direct += self._unknowns(pulled.reshape(k, -1, 1))
                added[:, 2 * d :] = drawn.reshape(k, -1, 1)
            added += _times(maps.by_begin.swapaxes(1, 2), direct)
            added[:, :d, 0] += own.sum(axis=1)
            turned = maps.whole.swapaxes(1, 2)
            given, found, end, states = self._sweep(one, turned, added, end, states, back=True)
            total = direct + _times(maps.ends.swapaxes(1, 2), given[:, : 2 * d])
            total += self._unknowns(given[:, 2 * d :])
            pulled = _times(maps.by_load.swapaxes(1, 2), total).reshape(k, -1, d)
            loads[one.steps] = (pulled + given[:, None, d : 2 * d, 0]).reshape(-1, s + 1, d)
            starts = one.starts[:, :f].reshape(k, -1)
            velocity += np.einsum("kf,kfd->d", starts, found[:, 2 * d :].reshape(k, -1, d))
        self.step_solves += self.steps.n_steps
        return Cotangent(
            loads=loads,
            position=end[:d, 0],
            velocity=velocity,
            momentum=end[d:, 0],
            damping=damping,
        )

    def _inputs(self, unknowns: Array) -> Array:
        """Velocities at the stages ``(k, B m d, p)`` by unknowns ``(k, B s d, p)``."""
        k, _, p = unknowns.shape
        shaped = unknowns.reshape(k, -1, self.tables.degree, self.d * p)
        return np.asarray(np.matmul(self._to_inputs, shaped).reshape(k, -1, p))

    def _unknowns(self, inputs: Array) -> Array:
        """The transposed map."""
        k, _, p = inputs.shape
        shaped = inputs.reshape(k, -1, len(self._to_inputs), self.d * p)
        return np.asarray(np.matmul(self._to_inputs.T, shaped).reshape(k, -1, p))


def _blocks(values: Array, stretch: LinearisedStretch) -> Array:
    """Values ``(p, n, .., d)`` of steps as ``(k, features, p)``."""
    own = values[:, stretch.steps]
    return own.reshape(len(own), stretch.blocks, -1).transpose(1, 2, 0)


def _steps(values: Array, stretch: LinearisedStretch) -> Array:
    """The way back, ``(p, steps, features / B)``."""
    own = values.transpose(2, 0, 1)
    return own.reshape(len(own), stretch.blocks * stretch.count, -1)


def _times(matrices: Array, values: Array) -> Array:
    """Matrices ``(k or 1, a, b)`` on ``(k, b, p)``; one product where all share one."""
    if len(matrices) > 1:
        return np.asarray(np.matmul(matrices, values))
    k, b, p = values.shape
    found = np.dot(matrices[0], values.swapaxes(0, 1).reshape(b, k * p))
    return np.asarray(found.reshape(-1, k, p).swapaxes(0, 1))
