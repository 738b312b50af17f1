r"""The discrete equations of a run, linearised along it, and solved in both directions.

A disturbance of the scene changes the load vectors of the steps: with the motion held fixed it
changes P by :math:`\partial P` and Q - F by :math:`\partial Q`, and so
:math:`g_\nu = \sum_i b_i (l_\nu' \partial P_i + h l_\nu \partial Q_i)`. A block of B steps of the
engine is then one matrix T,

.. math:: (x', p', W) = T\,(x, p, F) + G g, \qquad F = R z, \quad z' = z + P z + Q W,

from position, momentum and the force F of the past to position and momentum behind it and to the
velocities W at its stages, which drive the memory. It is made of the operator of the block, whose
second derivatives are those on the trajectory: of a linear scene there is one for all blocks, of
others one for every step. Forwards this gives what a disturbance does to the trajectory, one column
for each. Backwards, all transposed, it gives what *all* disturbances do to one number: the mirror
equation of the restricted Hamilton's principle (Hariz Belgacem, Jimenez, Ober-Bloebaum, arXiv
2403.18362), on the same mesh.

Shapes: n steps, p columns, d components of the scene; q members (decoupled modes) of e components,
k blocks of B steps, s unknowns U, r = m stages, J states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from fvi_cli.effects.laws.law import RelaxationKernel
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.damping.damping import Damping
from fvi_cli.integrator.damping.directions import Direction
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.engine.frame import Frame, sampling_of, unit_tables
from fvi_cli.integrator.engine.kinds import law_of
from fvi_cli.integrator.engine.law import Linearisation
from fvi_cli.integrator.engine.operator import Operator, step_matrix
from fvi_cli.integrator.engine.tables import on_components
from fvi_cli.integrator.gradients.past import Past, Stretch, are_regular
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.kernel import LARGEST_EXPONENT, Slope, Term
from fvi_cli.integrator.memory.lag_sequences import expand
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

LARGEST_STEP = 1500
"""Stages times components up to which steps are linearised: matrices of that size are inverted."""
LARGEST_BLOCK = 256
"""Unknowns of a block of a linear scene."""
AT_ONCE = 2**21
"""Entries of the matrices T of steps that are made together."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disturbance:
    """What p changes of a scene do to the equations of a run of n steps.

    Parameters
    ----------
    loads
        Change of the load vectors with the motion held fixed, ``(p, n, s + 1, d)``.
    position, velocity, momentum
        Change of the initial data, ``(p, d)``.
    damping
        Change of the damping force at the stages, ``(p, n, r, d)``, which is in `loads` already.
    """

    loads: Array
    position: Array
    velocity: Array
    momentum: Array
    damping: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Tangent:
    """What p disturbances do to a trajectory.

    Parameters
    ----------
    position
        Changes at the points of the mesh, ``(p, n + 1, d)``.
    unknowns
        Changes of the unknowns of steps, velocities, ``(p, n, s, d)``.
    """

    position: Array
    unknowns: Array


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
        total = np.einsum("nsa,pnsa->p", self.loads, change.loads)
        total += change.position @ self.position + change.velocity @ self.velocity
        total += change.momentum @ self.momentum
        if self.damping is not None:
            total += np.einsum("nra,pnra->p", self.damping, change.damping)
        return np.asarray(total)


class _Maps(NamedTuple):
    """Blocks of a stretch: one for all of them, or one for each, in the first axis ``k or 1``.

    Parameters
    ----------
    by_begin, by_load
        Unknowns U by (x, p, F), ``(.., q, B s e, 2 e + f B m e)``, and by load vectors,
        ``(.., q, B s e, B (s + 1) e)``.
    ends
        Position and momentum behind the block by U alone, ``(.., q, 2 e, B s e)``.
    whole
        T, ``(.., q, 2 e + B m e, 2 e + f B m e)``.
    """

    by_begin: Array
    by_load: Array
    ends: Array
    whole: Array


class LinearisedRun:
    """A run of a Runge-Kutta method, ready for tangents and adjoints.

    Parameters
    ----------
    scene, method
        What was integrated and how.
    steps
        All steps of the run; of a linear scene the mesh alone counts.

    Attributes
    ----------
    step_solves
        Systems of one step solved so far, a matrix with several right-hand sides counted once.

    Raises
    ------
    ValueError
        For steps with too many unknowns, or whose linearised equations have no unique solution.
    """

    def __init__(self, scene: Scene, method: Method, steps: RunSteps) -> None:
        self.scene, self.method, self.steps, self.step_solves = scene, method, steps, 0
        self.tables, d = steps.tables, scene.dimension
        size = self.tables.degree * d
        if size > LARGEST_STEP:
            raise ValueError(
                f"derivatives: {size} unknowns in a step; steps of at most {LARGEST_STEP} are "
                "linearised"
            )
        self.is_regular = scene.is_linear and are_regular(steps.step_size)
        modes = linear_decoupling(scene) if self.is_regular else None
        self.modes = modes or Decoupling(mass=scene.inertia.mass, modes=None)
        self.q, self.e = self.modes.batch, d // self.modes.batch
        self.law = law_of([scene], [self.modes] if scene.is_linear else None)
        damping, laws = scene.damping, scene.laws
        found = [one.coefficient for one in damping] + [o.size * o.coefficient for o in laws]
        self.coefficients = np.array(found).reshape(-1, d, d)
        self._matrices = [self.modes.matrices(one) for one in self.coefficients]
        exponents = [min(1.0 - one.order, LARGEST_EXPONENT) for one in damping]
        above = [scene.derivative == "caputo" and one.order > 1 for one in damping]
        terms: list[Term] = [*exponents, *(one.kernel for one in laws)]
        relative = above + [False] * len(laws)
        # the slopes have the same states
        self._terms = terms + [Slope(one) for one in exponents], relative + above
        self._memory = self._remember(self._terms[0])
        self._to_inputs = sampling_of(method).to_inputs
        longest = max(1, LARGEST_BLOCK // (method.stages * self.e))
        self.past = self._past(
            self._memory,
            *self._terms,
            longest=longest if self.is_regular else 1,
            together=steps.n_steps if self.is_regular else max(1, AT_ONCE // size**2),
        )

    def _remember(self, terms: Sequence[Term]) -> Exponentials | None:
        if not terms:
            return None
        sizes = self.steps.step_size
        return Exponentials(
            self.method,
            tuple(dict.fromkeys(terms)),
            shortest_step=float(sizes.min()),
            final_time=self.scene.final_time,
            steps=float((sizes.min() / sizes).sum()),
        )

    def _past(
        self,
        memory: Exponentials | None,
        terms: Sequence[Term],
        is_relative: Sequence[bool],
        *,
        longest: int,
        together: int,
    ) -> Past:
        sizes, m = self.steps.step_size, self.method.stages
        return Past(memory, terms, is_relative, sizes, m, longest=longest, together=together)

    @cached_property
    def points(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and times of all stages."""
        return self.steps.stage_position, self.steps.velocity, self.steps.stage_time

    def loads_by(self, momentum: Array, force: Array) -> Array:
        """Load vectors ``(n, s + 1, d)`` of changes of P and of Q - F at the stages."""
        t, h = self.tables, self.steps.step_size[:, None, None]
        loads = h * _on_stages(t.test_weights, force)
        return loads + _on_stages(t.weights * t.slopes, momentum) if momentum.any() else loads

    # --- the damping of the scene, term by term ---

    @cached_property
    def _along(self) -> Past:
        """The past in the longest blocks, for motions that are known."""
        if self.is_regular or not are_regular(self.steps.step_size):
            return self.past
        return self._past_in_blocks(self._memory, *self._terms)

    def _past_in_blocks(
        self, memory: Exponentials | None, terms: Sequence[Term], is_relative: Sequence[bool]
    ) -> Past:
        sizes = self.steps.step_size
        longest = LARGEST_BLOCK // self.method.stages if are_regular(sizes) else 1
        return self._past(memory, terms, is_relative, longest=longest, together=sizes.size)

    def forces_of(self, kernels: Sequence[RelaxationKernel]) -> Array:
        """Forces of relaxation laws on this motion, without matrices, ``(k, n, r, d)``."""
        past = self._past_in_blocks(self._remember(kernels), kernels, [False] * len(kernels))
        return past.along(self.steps.velocity, self.scene.initial_velocity)

    @cached_property
    def plain_forces(self) -> Array:
        """Forces of all terms without their matrices, then minus their derivatives by orders.

        Terms with a coefficient of zero are among them; laws have no orders.
        """
        return self._along.along(self.steps.velocity, self.scene.initial_velocity)

    @property
    def damping_force(self) -> Array:
        """Force F of all damping at the stages, ``(n, r, d)``."""
        return self._damped(self.plain_forces)

    def damping_changes(self, tangent: Tangent, change: Disturbance) -> Array:
        """What disturbances do to F, ``(p, n, r, d)``."""
        if not len(change.velocity):
            return change.damping
        velocity = np.moveaxis(np.matmul(self._to_inputs, tangent.unknowns), 0, -1)
        start = np.moveaxis(change.velocity, 0, -1)
        plain = self._along.along(velocity.reshape(*velocity.shape[:2], -1), start.ravel())
        plain = np.moveaxis(plain.reshape(*plain.shape[:3], *start.shape), -1, 1)
        return change.damping + self._damped(plain)

    def _damped(self, plain: Array) -> Array:
        nothing = np.zeros(plain.shape[1:])
        acting = zip(plain, self.coefficients, strict=False)
        return sum((np.matmul(force, matrix) for force, matrix in acting), nothing)

    # --- the matrices of blocks; the first axis is that of members, or that of steps ---

    def _maps(self, stretch: Stretch) -> _Maps:
        t, count, e, matrices = self.tables, stretch.count, self.e, self._matrices
        try:
            start, by_load, gained, by_position = (
                self._of_blocks(stretch) if self.is_regular else self._of_steps(stretch)
            )
        except np.linalg.LinAlgError:
            raise ValueError(
                "derivatives: the linearised equations of a step have no unique solution"
            ) from None
        a, rows, s, m = len(start), start.shape[1], t.degree, t.points.size
        h, local = stretch.sizes, stretch.local[:, : len(matrices)]
        if not self.is_regular:
            h, local = h[stretch.which], local[stretch.which]
        to_force = -h[:, None, None, None, None] * t.test_weights.T

        def of_force(by_loads: Array) -> Array:
            """From derivatives by load vectors to those by forces, ``(a, n, f, B, m e)``."""
            drawn = np.matmul(to_force, by_loads.reshape(a, by_loads.shape[1], -1, s + 1, e))
            lead, count = drawn.shape[:3], len(matrices)
            found = np.empty((*lead[:2], count, lead[2], m * e))
            for index, one in enumerate(matrices):
                found[:, :, index] = np.matmul(drawn, one[:, None, None]).reshape(*lead, -1)
            return found

        # by loads of the first step; by those of another one it is the same later
        first = of_force(by_load[..., : (s + 1) * e]).reshape(a, count, s * e, -1, m * e)
        past = np.moveaxis(expand(np.moveaxis(first, 3, 1)), 1, 2)
        by_begin = np.concatenate([start, past.reshape(a, rows, -1)], axis=2)
        ends = np.zeros((a, 2 * e, rows))
        last = ends[:, :e].reshape(a, e, count, s, e)[..., -1, :]
        last[:] = h[:, None, None, None] * np.eye(e)[:, None]
        lost = np.matmul((h[:, None] * np.tile(t.weights, count))[:, None, None], local)
        lost = np.matmul(lost.reshape(len(h), len(matrices), count, m), self._to_inputs)
        for index, one in enumerate(matrices):
            gained = gained - on_components(lost[:, index].reshape(len(h), 1, -1), one)
        ends[:, e:] = gained
        behind = ends @ by_begin
        behind[..., : 2 * e] += np.eye(2 * e)
        behind[:, e:, :e] += by_position
        sums = np.broadcast_to(np.tile(np.eye(e), count * (s + 1)), (a, e, count * (s + 1) * e))
        behind[:, e:, 2 * e :] += of_force(sums).reshape(a, e, -1)
        driven = np.matmul(self._to_inputs, by_begin.reshape(a, count, s, -1))
        whole = np.concatenate([behind, driven.reshape(a, -1, by_begin.shape[2])], axis=1)
        lead = (1, a) if self.is_regular else (a, 1)
        return _Maps(*(o.reshape(*lead, *o.shape[1:]) for o in (by_begin, by_load, ends, whole)))

    def _second_derivatives(self, stretch: Stretch) -> Linearisation:
        if self.law.is_linear:
            return self.law.linearise(np.zeros((self.q, 1, self.e)), None, 0.0)
        position, velocity, time = (one[stretch.steps] for one in self.points)
        return self.law.linearise(position, velocity, time, per_point=True)

    def _of_blocks(self, stretch: Stretch) -> tuple[Array, Array, Array, Array]:
        """Of a linear scene: U by (x, p) and loads, what p gains by K along U, and by x."""
        h, count, damping = float(stretch.sizes[0]), stretch.count, None
        if self._memory is not None:
            directions = [
                Direction(matrix=one, terms=((term,),), factors=np.ones((1, 1)), is_relative=False)
                for one, term in zip(self._matrices, self._terms[0], strict=False)
            ]
            damping = Damping(directions, self._memory, np.zeros((self.q, self.e)))
        unit = unit_tables(self.method, count, self.e, False)
        frame = Frame(sampling_of(self.method), unit, damping, h, count)
        at = self._second_derivatives(stretch)
        op = Operator(frame, at, damping, is_linear=True)
        if op.singular.any():
            raise np.linalg.LinAlgError
        path = np.tile(h * self.tables.weights, count) @ expand(frame.displacement)
        gained = -on_components(path[None, None], at.stiffness)
        return op.start, op.by_load, gained, -h * count * at.stiffness

    def _of_steps(self, stretch: Stretch) -> tuple[Array, Array, Array, Array]:
        """The same of every step, with the second derivatives at its stages."""
        t, e, n = self.tables, self.e, stretch.blocks
        s, h = t.degree, stretch.sizes[stretch.which][:, None, None]
        at = self._second_derivatives(stretch)
        stiffness = at.stiffness if at.stiffness.ndim == 4 else at.stiffness[:, None]
        stiffness = np.broadcast_to(stiffness, (n, t.points.size, e, e))
        unit = unit_tables(self.method, 1, e, self.law.has_rates)
        local = np.moveaxis(stretch.local[stretch.which], 1, 0)[: len(self._matrices)]
        damp = list(h * (t.test_weights[:-1] @ local @ self._to_inputs))
        inverse = np.linalg.inv(step_matrix(unit, at, h, damp, self._matrices))
        by_load = np.concatenate([-inverse, np.zeros((n, s * e, e))], axis=2)
        # at a stage K and C act on the position at the beginning as on the way from there
        mixed = [] if at.mixed is None else [at.mixed]
        moved = np.concatenate([*mixed, -stiffness], axis=2).reshape(n, -1, e)
        tests, points = h * unit.tests[-1], h * unit.points[0]
        if mixed:
            tests, points = tests + unit.tests[0], points + unit.points[1]
        start = np.concatenate([by_load @ (tests @ moved), -inverse[..., :e]], axis=2)
        weighted = h[..., None] * t.weights[:, None, None]
        turned = [one.swapaxes(2, 3) for one in mixed]
        by_point = weighted * np.concatenate([-stiffness, *turned], axis=3)
        gained = by_point.swapaxes(1, 2).reshape(n, e, -1) @ points
        return start, by_load, gained, -(weighted * stiffness).sum(axis=1)

    # --- values of steps, by blocks ---

    def _blocks(self, values: Array, stretch: Stretch) -> Array:
        """Values ``(q, p, n, ..., e)`` of steps as ``(blocks, q, features, p)``."""
        own = values[:, :, stretch.steps]
        return own.reshape(*own.shape[:2], stretch.blocks, -1).transpose(2, 0, 3, 1)

    def _steps(self, values: Array, stretch: Stretch) -> Array:
        """The way back, ``(q, p, steps, features / B)``."""
        own = values.transpose(1, 3, 0, 2)
        return own.reshape(*own.shape[:2], stretch.blocks * stretch.count, -1)

    def _sweep(
        self,
        stretch: Stretch,
        whole: Array,
        added: Array,
        begin: Array,
        states: Array,
        *,
        back: bool,
    ) -> tuple[Array, Array, Array, Array]:
        """From block to block, or back by the transposed tables.

        Parameters
        ----------
        whole, added
            T, ``(k or 1, q, .., ..)``, and what is added to its values, ``(k, q, .., p)``.
        begin, states
            Position and momentum ``(q, 2 e, p)``, and states ``(q, J, e p)``.

        Returns
        -------
        tuple of Array
            On what T acted, its values, and `begin` and `states` behind the last block.
        """
        f, j, e2 = len(self._matrices), self.past.n_states, 2 * self.e
        response = stretch.response[:, :f]
        response = response.reshape(len(response), f * response.shape[2], j)
        give, take = response, stretch.intake
        if back:
            give, take, whole = take.swapaxes(1, 2), give.swapaxes(1, 2), whole.swapaxes(2, 3)
        k, q, _, p = added.shape
        given, found = np.zeros((k, q, whole.shape[3], p)), added.copy()
        product: Callable[[Array, Array], Array] = np.matmul
        lead: tuple[int, ...] = (q,)
        if q == 1:
            # of small matrices the plainest product is the quickest
            product, lead, begin, states = np.dot, (), begin[0], states[0]
            given, found, whole = given[:, 0], found[:, 0], whole[:, 0]
        maps = list(whole) if len(whole) > 1 else [whole[0]] * k
        drawn = (*lead, -1, p)
        pushed = (*lead, -1, self.e * p)
        for index in reversed(range(k)) if back else range(k):
            u, on, values = stretch.which[index], given[index], found[index]
            on[..., :e2, :] = begin
            on[..., e2:, :] = product(give[u], states).reshape(drawn)
            values += product(maps[index], on)
            begin = values[..., :e2, :]
            states = stretch.decay[u] * states
            states += product(take[u], values[..., e2:, :].reshape(pushed))
        return (
            given.reshape(k, q, -1, p),
            found.reshape(k, q, -1, p),
            begin.reshape(q, -1, p),
            states.reshape(q, j, self.e * p),
        )

    def tangent(self, change: Disturbance) -> Tangent:
        """What disturbances do to the trajectory."""
        modes, q, e, s = self.modes, self.q, self.e, self.tables.degree
        (p, d), n = change.position.shape, self.steps.n_steps
        if not p:
            return Tangent(position=np.zeros((0, n + 1, d)), unknowns=np.zeros((0, n, s, d)))
        loads = modes.forces(change.loads)
        x, velocity = (
            modes.positions(o).swapaxes(1, 2) for o in (change.position, change.velocity)
        )
        end = np.concatenate([x, modes.forces(change.momentum).swapaxes(1, 2)], axis=1)
        states = np.zeros((q, self.past.n_states, e * p))
        positions, unknowns = np.empty((q, p, n + 1, e)), np.empty((q, p, n, s * e))
        positions[:, :, 0] = x.swapaxes(1, 2)
        for one in self.past.stretches:
            maps, own, k = self._maps(one), self._blocks(loads, one), one.blocks
            free = _times(maps.by_load, own)
            added = np.concatenate([_times(maps.ends, free), self._inputs(free)], axis=2)
            added[:, :, e : 2 * e] += own.reshape(k, q, -1, e, p).sum(axis=2)
            # a start velocity that is subtracted is a force of the past
            starts = one.starts[:, : len(self._matrices)].reshape(k, 1, -1, 1, 1)
            moving = np.zeros((k, q, maps.whole.shape[3], p))
            moving[:, :, 2 * e :] = (starts * velocity[:, None]).reshape(k, q, -1, p)
            added += _times(maps.whole, moving)
            given, _, end, states = self._sweep(one, maps.whole, added, end, states, back=False)
            moved = free + _times(maps.by_begin, given + moving)
            unknowns[:, :, one.steps] = self._steps(moved, one)
            last = moved.reshape(k, q, one.count, s, e, p)[:, :, :, -1]
            h = one.sizes[one.which][:, None, None, None, None]
            way = given[:, :, None, :e] + h * last.cumsum(axis=2)
            way = self._steps(way.reshape(k, q, -1, p), one)
            positions[:, :, one.first + 1 : one.steps.stop + 1] = way
        self.step_solves += n
        return Tangent(
            position=modes.scene_positions(positions),
            unknowns=modes.scene_positions(unknowns.reshape(q, p, n, s, e)),
        )

    def adjoint(self, position: Array, unknowns: Array, damping: Array | None = None) -> Cotangent:
        """What disturbances of all kinds do to one number.

        Parameters
        ----------
        position, unknowns
            Derivatives of that number by the positions at the points of the mesh,
            ``(n + 1, d)``, and by the unknowns of steps, ``(n, s, d)``.
        damping
            Its derivatives by the force F of all damping at the stages, ``(n, r, d)``; None: it
            does not depend on it.
        """
        modes, e, q, s = self.modes, self.e, self.q, self.tables.degree
        n, f = self.steps.n_steps, len(self._matrices)
        by_position, by_unknowns = (modes.forces(one)[:, None] for one in (position, unknowns))
        by_damping = None if damping is None else modes.positions(damping)[:, None]
        end = np.concatenate([by_position[:, 0, n, :, None], np.zeros((q, e, 1))], axis=1)
        states, velocity = np.zeros((q, self.past.n_states, e)), np.zeros((q, e))
        loads = np.empty((q, 1, n, (s + 1) * e))
        for one in reversed(self.past.stretches):
            maps, k, h = self._maps(one), one.blocks, one.sizes[one.which][:, None, None, None]
            # positions at the points inside of a block are its own work
            own = self._blocks(by_position[:, :, :-1], one).reshape(k, q, one.count, e)
            inside = np.concatenate([own[:, :, 1:], np.zeros_like(own[:, :, :1])], axis=2)
            direct = self._blocks(by_unknowns, one).reshape(k, q, one.count, s, e).copy()
            direct[:, :, :, -1] += h * inside[:, :, ::-1].cumsum(axis=2)[:, :, ::-1]
            direct = direct.reshape(k, q, -1, 1)
            drawn: Array | None = None
            if by_damping is not None and f:
                force = self._blocks(by_damping, one).reshape(k, q, -1, e)
                drawn = np.stack([np.matmul(force, each) for each in self._matrices], axis=2)
                local = one.local[one.which, :f][:, None].swapaxes(3, 4)
                pulled = np.matmul(local, drawn).sum(axis=2).reshape(k, q, -1, 1)
                direct += self._unknowns(pulled)
                drawn = drawn.reshape(k, q, -1, 1)
            added = _times(maps.by_begin.swapaxes(2, 3), direct)
            added[:, :, :e, 0] += own.sum(axis=2)
            if drawn is not None:
                added[:, :, 2 * e :] += drawn
            given, found, end, states = self._sweep(one, maps.whole, added, end, states, back=True)
            total = direct + _times(maps.ends.swapaxes(2, 3), given[:, :, : 2 * e])
            total += self._unknowns(given[:, :, 2 * e :])
            own = _times(maps.by_load.swapaxes(2, 3), total)
            own += np.tile(given[:, :, e : 2 * e], (1, 1, one.count * (s + 1), 1))
            loads[:, :, one.steps] = self._steps(own, one)
            forces = found[:, :, 2 * e :].reshape(k, q, -1, e)
            velocity += np.einsum("kf,kqfe->qe", one.starts[:, :f].reshape(k, -1), forces)
        self.step_solves += n
        return Cotangent(
            loads=modes.scene_positions(loads.reshape(q, n, s + 1, e)),
            position=modes.scene_forces(end[:, :e, 0]),
            velocity=modes.scene_forces(velocity),
            momentum=modes.scene_positions(end[:, e:, 0]),
            damping=damping,
        )

    def _inputs(self, unknowns: Array) -> Array:
        """Velocities at the stages ``(k, q, B m e, p)`` by unknowns ``(k, q, B s e, p)``."""
        k, q, _, p = unknowns.shape
        found = np.matmul(
            self._to_inputs, unknowns.reshape(k, q, -1, self.tables.degree, self.e * p)
        )
        return np.asarray(found.reshape(k, q, -1, p))

    def _unknowns(self, inputs: Array) -> Array:
        """The transposed map."""
        k, q, _, p = inputs.shape
        found = np.matmul(
            self._to_inputs.T, inputs.reshape(k, q, -1, len(self._to_inputs), self.e * p)
        )
        return np.asarray(found.reshape(k, q, -1, p))


def _on_stages(table: Array, values: Array) -> Array:
    """A small table ``(a, r)`` on the second axis of ``(n, r, d)``."""
    return np.asarray(np.tensordot(table, values, axes=(1, 1)).swapaxes(0, 1))


def _times(matrices: Array, values: Array) -> Array:
    """Matrices ``(k or 1, q, a, b)`` on ``(k, q, b, p)``; one product where all share one."""
    if len(matrices) > 1:
        return np.asarray(np.matmul(matrices, values))
    k, q, b, p = values.shape
    found = np.matmul(matrices[0], values.transpose(1, 2, 0, 3).reshape(q, b, k * p))
    return np.asarray(found.reshape(q, -1, k, p).transpose(2, 0, 1, 3))
