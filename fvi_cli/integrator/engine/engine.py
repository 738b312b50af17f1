"""The engine: steps of q scenes of one kind by one method, all members at once.

Shapes: q members, e components, s unknowns of a step, r quadrature points, m samples of the damping
force, i inputs of the memory in a step, J states, B steps. Decoupled modes of a linear scene are
members with one component.
"""

from __future__ import annotations

import copy
from collections import OrderedDict
from collections.abc import Callable, Sequence

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.blocks import longest_block
from fvi_cli.integrator.engine.directions import directions_of
from fvi_cli.integrator.engine.frame import Frame, sampling_of, unit_tables
from fvi_cli.integrator.engine.kinds import law_of, modes_of
from fvi_cli.integrator.engine.law import Linearisation, force_of
from fvi_cli.integrator.engine.newton import Newton, Solution
from fvi_cli.integrator.engine.operator import Operator
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.engine.tables import apply, apply_to_each, on_steps
from fvi_cli.integrator.loads.step_loads import StepLoads
from fvi_cli.integrator.memory.exponentials import Exponentials
from fvi_cli.integrator.memory.interface import Memory
from fvi_cli.integrator.memory.lags import Lags
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.mathematics.arrays import Array, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

KEPT_TABLES = 128
LEAST_BLOCK_STEPS = 16
"""On fewer equal steps by backward differences every sum over the past is written out."""
LONGEST_GUESS = 1.5
"""The polynomial of a step is continued over a step up to so many times as long."""
NEVER_SHORTER = 1 << 30


class Engine:
    """Steps of scenes that differ in their numbers alone.

    Parameters
    ----------
    scenes, method
        What is integrated, and how.
    shortest_step, steps
        As for :func:`fvi_cli.integrator.convolution.kernel.power_kernel`.
    n_steps
        Number of equal steps, for backward differences.
    most
        Steps of the longest block, for members that are one batch with others; None: as the size of
        matrices allows.

    Attributes
    ----------
    law, directions, memory
        The conservative part, damping by direction, and what it remembers.
    q, e
        Numbers of members and of components of each.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        method: Method,
        *,
        shortest_step: float,
        steps: float | None,
        n_steps: int | None = None,
        most: int | None = None,
    ) -> None:
        scene = scenes[0]
        self.scenes, self.method, self.tables = tuple(scenes), method, step_tables(method)
        self.sampling = sampling_of(method)
        self.modes = modes_of(scenes)
        self.law = law_of(scenes, self.modes)
        self.x0 = self._members(lambda one: one.initial_position)
        self.v0 = self._members(lambda one: one.initial_velocity)
        self.q, self.e = self.x0.shape
        self.p0 = self.law.momentum(self.x0, self.v0, 0.0)
        is_bdf = not method.is_runge_kutta
        self.directions = directions_of(scenes, self.modes, has_order_one=is_bdf)
        self.terms = tuple(dict.fromkeys(t for one in self.directions for t in one.terms))
        self.memory = self._memory(shortest_step, steps, n_steps) if self.terms else None
        self.n_states = self.memory.n_states if self.memory is not None else 0
        relative = any(one.is_relative for one in self.directions)
        plain = any(one.terms and not one.is_relative for one in self.directions)
        self.has_column = relative and (is_bdf or plain)
        self._starts_relative = relative and not self.has_column
        self._basis = lobatto_basis(self.tables.degree)
        self._forget()
        self.loads_of = [StepLoads(one, method, self.tables) for one in scenes]
        self._leave_out_first_kick(scene)
        self.has_loads = any(not one.is_empty for one in self.loads_of)
        self.is_batch = most is not None
        self.most = longest_block(self) if most is None else most

    def _forget(self) -> None:
        self._frames: OrderedDict[tuple[float, int], Frame] = OrderedDict()
        self._operators: OrderedDict[tuple[float, int], Operator] = OrderedDict()
        self._of_step: Operator | None = None
        self._of_block: Operator | None = None

    def _memory(self, shortest_step: float, steps: float | None, n_steps: int | None) -> Memory:
        final_time = self.scenes[0].final_time
        if self.method.is_runge_kutta:
            return Exponentials(
                self.method,
                self.terms,
                shortest_step=shortest_step,
                final_time=final_time,
                steps=steps,
            )
        if n_steps is None:
            raise ValueError("n_steps: backward differences take a number of equal steps")
        return Lags(
            self.method,
            self.tables,
            [one for one in self.terms if isinstance(one, float)],
            n_steps=n_steps,
            h=final_time / n_steps,
            writes_out=n_steps < LEAST_BLOCK_STEPS
            if self.method.history == "auto"
            else self.method.history == "direct",
        )

    def _leave_out_first_kick(self, scene: Scene) -> None:
        """Samples on the nodes, Riemann-Liouville: the first is without the kick of q0."""
        nodes = self.method.sampling == "nodes" and scene.derivative == "riemann-liouville"
        if not nodes or not isinstance(self.memory, Lags):
            return
        h = self.memory.h
        past = self._past(self.frame(h, 1), self.start(), 1)
        if past is None:
            return
        _, forces = self.to_scene(past[:, 0, :1], past[:, 0, :1])
        weights = self.tables.sample_test_weights[:, 0]
        for loads, own in zip(self.loads_of, forces[:, 0], strict=True):
            loads.add(h * np.outer(weights, own)[None])

    def _members(self, of: Callable[[Scene], Array]) -> Array:
        """Positions or velocities of all scenes as members, ``(q, e)``."""
        if self.modes is None:
            return np.array([of(one) for one in self.scenes])
        pairs = zip(self.modes, self.scenes, strict=True)
        return np.concatenate([mode.positions(of(one)) for mode, one in pairs])

    def start(self) -> State:
        """The state at t = 0."""
        q, e, memory = self.q, self.e, self.memory
        z = np.zeros((q, self.n_states, e))
        column = np.zeros((1, self.n_states, 1))
        if self.has_column and memory is not None:
            column[:] = memory.column_start
        elif self._starts_relative:
            z += self.v0[:, None]
        nodes = self.method.sampling == "nodes"
        if nodes and self.scenes[0].derivative == "riemann-liouville" and isinstance(memory, Lags):
            first = np.zeros((q, self.tables.degree, e))
            first[:, -1] = self.x0 / memory.h
            z = memory.push(None, z, first, 1)
        return State(
            t=0.0,
            x=self.x0.copy(),
            p=self.p0.copy(),
            x_lost=np.zeros((q, e)),
            p_lost=np.zeros((q, e)),
            z=z,
            column=column,
            live=np.ones(q, dtype=bool),
            longest=np.full(q, NEVER_SHORTER),
            wait=np.zeros(q, dtype=np.int64),
            excess=np.zeros(q, dtype=np.int64),
            stale=np.zeros(q, dtype=bool),
        )

    def frame(self, h: float, count: int) -> Frame:
        """Tables of `count` steps of length h."""
        key = (h, count)
        if key not in self._frames:
            unit = unit_tables(self.method, count, self.e, self.law.has_rates)
            self._frames[key] = Frame(
                self.method, unit, self.memory, self.terms, self.directions, h, count
            )
            if len(self._frames) > KEPT_TABLES:
                self._frames.popitem(last=False)
        return self._frames[key]

    def operator(self, state: State, h: float, count: int, guess: Array | None) -> Operator:
        """For blocks by the second derivatives of the state; for single steps at the guess."""
        key = (h, count)
        if self.law.is_linear:
            if key not in self._operators:
                at = self.law.linearise(state.x[:, None], None, 0.0)
                self._operators[key] = Operator(
                    self.frame(h, count), at, self.directions, is_linear=True
                )
                if len(self._operators) > KEPT_TABLES:
                    self._operators.popitem(last=False)
            return self._operators[key]
        return self._single(state, h, guess) if count == 1 else self._block(state, key)

    def _single(self, state: State, h: float, guess: Array | None) -> Operator:
        if state.single is None or state.single_h != h:
            state.single, state.single_h = self._at_guess(state, h, guess), h
        known = self._of_step
        if known is None or known.frame.h != h or known.at is not state.single:
            known = Operator(self.frame(h, 1), state.single, self.directions, is_linear=False)
            self._of_step = known
        return known

    def _at_guess(self, state: State, h: float, guess: Array | None) -> Linearisation:
        if guess is None:
            raise ValueError("guess: it is needed for single steps")
        points = apply_to_each(self.frame(h, 1).points, guess.reshape(self.q, -1))
        points = points.reshape(self.q, self.tables.points.size, -1)
        v = points[..., self.e :] if self.law.has_rates else None
        x, t = state.x[:, None] + points[..., : self.e], state.t + h * self.tables.points
        return self.law.linearise(x, v, t, per_point=True)

    def _block(self, state: State, key: tuple[float, int]) -> Operator:
        if state.block is None or state.stale.any():
            x, v = state.x[:, None], None
            if self.law.has_rates:
                v = self.law.velocity(state.x, state.p, state.t)[:, None]
            fresh = self.law.linearise(x, v, state.t).copy()
            if state.block is not None:
                kept = np.flatnonzero(~state.stale)
                fresh.put(kept, state.block.of(kept))
            state.block, state.stale = fresh, np.zeros_like(state.stale)
        known = self._of_block
        if known is None or (known.frame.h, known.frame.count) != key:
            known = Operator(self.frame(*key), state.block.copy(), self.directions, is_linear=False)
            self._of_block = known
        elif (places := known.at.differing(state.block)).size:
            own = [one.of(places) for one in self.directions]
            known.put(places, Operator(known.frame, state.block.of(places), own, is_linear=False))
        return known

    def guess(self, state: State, h: float) -> Array:
        """U of a step by the polynomial of the last one; uniform motion without one."""
        c = self.tables.control_points[1:]
        if state.unknowns is not None and h <= LONGEST_GUESS * state.h:
            ratio = h / state.h
            ahead = self._basis.values(1.0 + ratio * c)[1:].T
            ahead = (ahead - np.eye(c.size)[-1]) / ratio
            return np.asarray(np.matmul(ahead, state.unknowns))
        v = self.law.velocity(state.x, state.p, state.t)
        return np.asarray(c[:, None] * v[:, None])

    def _past(
        self, frame: Frame, state: State, count: int, *, starts_at_rest: bool = False
    ) -> Array | None:
        """Force of the past on `count` steps, ``(q, count, m, e)``; None without damping."""
        if not self.directions:
            return None
        m = self.sampling.to_loads.shape[1]
        total = np.zeros((state.x.shape[0], count * m, self.e))
        for one, response, offset in zip(
            self.directions, frame.response, frame.caputo_offset, strict=True
        ):
            force: Array | None = None
            if one.terms:
                force = np.matmul(response[: count * m], state.z)
            if one.is_relative and not starts_at_rest:
                own = offset[: count * m]
                if self.has_column:
                    own = own + response[: count * m] @ state.column[0, :, 0]
                moved = own[:, None] * self.v0[:, None]
                force = moved if force is None else force + moved
            if force is not None:
                total += force_of(one.matrix, force)
        return total.reshape(-1, count, m, self.e)

    def _own_force(self, frame: Frame, inputs: Array, count: int) -> Array:
        """Force of the block's own inputs, ``(q, count, m, e)``."""
        m = count * self.sampling.to_loads.shape[1]
        total = np.zeros((len(inputs), m, self.e))
        for one, local in zip(self.directions, frame.local, strict=True):
            total += force_of(one.matrix, np.matmul(local[:m, : inputs.shape[1]], inputs))
        return total.reshape(len(inputs), count, -1, self.e)

    def solve(
        self,
        state: State,
        h: float,
        count: int,
        loads: Array | None,
        most: int | None = None,
        *,
        starts_at_rest: bool = False,
    ) -> Steps:
        """Solve `count` steps; the state stays.

        Parameters
        ----------
        state, h, count
            Where they begin, their length and number.
        loads
            Load vectors of known forces, ``(q, count, s + 1, e)``; None: there are none.
        most
            Number of steps of the tables to use, at least `count`.
        starts_at_rest
            Whether the start velocity, which Caputo derivatives subtract, counts as zero.
        """
        most = max(count, most or count)
        is_linear = self.law.is_linear
        guess = self.guess(state, h) if most == 1 and not is_linear else None
        op = self.operator(state, h, most, guess)
        frame, e, s = op.frame, self.e, self.tables.degree
        q = state.x.shape[0]
        past = self._past(frame, state, count, starts_at_rest=starts_at_rest)
        known = np.zeros((q, count, s + 1, e)) if past is None else on_steps(frame.to_loads, past)
        if loads is not None:
            known = known - loads
        n, c = count * s * e, count * (s + 1) * e
        begin = np.concatenate([state.x, state.p], axis=1)
        unknowns = apply(op.start[:, :n], begin) - apply(op.by_load[:, :n, :c], known.reshape(q, c))
        solution: Solution | None = None
        if not is_linear:
            solution = Newton(self, op, state, unknowns, known, count, guess).run()
            unknowns = solution.unknowns
        u = unknowns.reshape(q, count, s, e)
        inputs = (
            on_steps(self.sampling.to_inputs, u) if self.method.is_runge_kutta else u
        ).reshape(q, -1, e)
        change = -known.sum(axis=2)
        if self.directions:
            own = self._own_force(frame, inputs, count)
            change = change - on_steps(frame.to_loads.sum(axis=0)[None], own)[:, :, 0]
        moved = h * np.cumsum(u[:, :, -1], axis=1)
        if solution is None:
            change = change - self._pulled(op, state, u, moved)
        else:
            change = change + self._kicked(op, solution, count)
        z = state.z
        if self.memory is not None and frame.kernels is not None:
            z = self.memory.push(frame.kernels, state.z, inputs, count)
        return Steps(
            h=h,
            count=count,
            dx=moved,
            dp=np.cumsum(change, axis=1),
            unknowns=u,
            inputs=inputs,
            z=z,
            iterations=np.ones(q, dtype=np.int64) if solution is None else solution.iterations,
            failed=np.zeros(q, dtype=bool) if solution is None else solution.failed,
            rest=None if solution is None else solution.rest,
        )

    def _pulled(self, op: Operator, state: State, u: Array, moved: Array) -> Array:
        """Impulse of the linear forces in each step, with the sign of the left side."""
        frame, h = op.frame, op.frame.h
        mean = (h * self.tables.weights)[None] @ frame.displacement[0]
        place = on_steps(mean, u)[:, :, 0] + h * state.x[:, None]
        place[:, 1:] += h * moved[:, :-1]
        return force_of(op.at.stiffness, place)

    def _kicked(self, op: Operator, found: Solution, count: int) -> Array:
        """Impulse of the forces of the law in each step."""
        _, mixed, stiffness = op.at
        e = self.e
        force = found.rest[..., -e:] - force_of(stiffness, found.points[..., :e])
        if mixed is not None:
            force = force + np.matmul(found.points[..., None, e:], mixed)[..., 0, :]
        weights = (op.frame.h * self.tables.weights)[None]
        return on_steps(weights, force.reshape(len(force), count, -1, e))[:, :, 0]

    def accept(self, state: State, steps: Steps, end: float) -> None:
        """Go to the end of solved steps."""
        state.x, state.x_lost = compensated(state.x, state.x_lost, steps.dx[:, -1])
        state.p, state.p_lost = compensated(state.p, state.p_lost, steps.dp[:, -1])
        if self.has_column:
            state.column = self.pushed_column(state.column, steps.h, steps.count)
        state.z = steps.z
        state.unknowns, state.h, state.t = steps.unknowns[:, -1], steps.h, end
        if steps.rest is not None:
            state.rest = steps.rest[:, -1]
        if steps.failed.any():
            state.live = state.live & ~steps.failed

    def pushed_column(self, column: Array, h: float, count: int) -> Array:
        """States of the start velocity behind `count` steps."""
        memory, frame = self.memory, self._kept_frame(h, count)
        if memory is None or frame.kernels is None:
            return column
        inputs = np.zeros((1, count * len(self.sampling.to_inputs), 1))
        if memory.column is not None:
            inputs[0, :, 0] = np.tile(memory.column, count)
        return memory.push(frame.kernels, column, inputs, count)

    def _kept_frame(self, h: float, count: int) -> Frame:
        whole = self._frames.get((h, self.most))
        return self.frame(h, count) if whole is None or self.most < count else whole

    def of(self, places: Places) -> Engine:
        """The engine of some members; tables of step sizes are shared."""
        if len(places) == self.q:
            return self
        part = copy.copy(self)
        part.law = self.law.of(places)
        part.directions = tuple(one.of(places) for one in self.directions)
        part.q, part.v0 = len(places), self.v0[places]
        part._of_step = None
        part._of_block = None if self._of_block is None else self._of_block.of(places)
        return part

    def loads(self, begin: float, h: float, count: int, *, is_fresh: bool) -> Array | None:
        """Load vectors of known forces on equal steps, ``(q, count, s + 1, e)``."""
        if not self.has_loads:
            return None
        every = []
        for one, scene in zip(self.loads_of, self.scenes, strict=True):
            found = one.of_steps(begin, h, count, is_fresh=is_fresh)
            if found is None:
                found = np.zeros((count, self.tables.degree + 1, scene.dimension))
            every.append(found)
        if self.modes is None:
            return np.array(every)
        return np.concatenate(
            [mode.forces(one) for mode, one in zip(self.modes, every, strict=True)]
        )

    def to_scene(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Positions and momenta of members ``(q, n, e)`` as those of scenes, ``(S, n, d)``."""
        if self.modes is None:
            return x, p
        k = self.modes[0].batch
        return (
            np.array([m.scene_positions(x[i * k : i * k + k]) for i, m in enumerate(self.modes)]),
            np.array([m.scene_forces(p[i * k : i * k + k]) for i, m in enumerate(self.modes)]),
        )
