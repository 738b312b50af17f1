"""The engine: steps of q scenes of one kind by one method, all members at once.

Shapes: q members, e components, s unknowns of a step, r quadrature points, m samples of the damping
force, i inputs of the memory in a step, J states, B steps. Decoupled modes of a linear scene are
members with one component.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from functools import lru_cache, partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.block import Block, Rows
from fvi_cli.integrator.engine.law import Linear, Linearisation, StepLaw, law_of, modes_of
from fvi_cli.integrator.engine.newton import (
    Linearised,
    Problem,
    Solution,
    solve_block,
    solve_step,
)
from fvi_cli.integrator.engine.products import on_steps
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.engine.step import DenseStep, Frame, Step, dense_step, unit_tables
from fvi_cli.integrator.engine.structures import Structure, StructureStep, is_structure
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.memory.damping import damping_of
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array, Mask
from fvi_cli.mathematics.lagrange import lobatto_basis

LONGEST_GUESS = 1.5
"""The polynomial of a step is the guess for the next one if that is up to so many times as long."""
KEPT_TABLES = 128
"""Number of step sizes whose tables are kept."""


class Engine:
    """Steps of scenes of one kind, which differ in numbers only.

    `shortest_step` and `steps` as for :func:`fvi_cli.integrator.memory.kernel.power_kernel`;
    `n_steps`, which backward differences need. `is_single`: all steps are solved one by one.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        method: Method,
        *,
        shortest_step: float,
        steps: float | None,
        n_steps: int | None = None,
        is_single: bool = False,
    ) -> None:
        self.scenes, self.method, self.tables = tuple(scenes), method, step_tables(method)
        self.modes = modes_of(scenes)
        is_large = self.modes is None and is_structure(scenes, method)
        self.law: StepLaw | Linear | Structure
        self.law = Structure(scenes[0]) if is_large else law_of(scenes, self.modes)
        self.x0 = self.member_positions([one.initial_position for one in scenes])
        self.p0 = self.member_forces(
            [one.momentum(one.initial_position, one.initial_velocity, 0.0) for one in scenes]
        )
        self.q, self.e = self.x0.shape
        # number of members (modes) of each scene
        self.width = 1 if self.modes is None else scenes[0].dimension
        self.damping = damping_of(
            scenes,
            method,
            shortest_step=shortest_step,
            steps=steps,
            n_steps=n_steps,
            modes=self.modes,
            in_reach=is_large,
        )
        self.n_states = 0 if self.damping is None else self.damping.n_states
        self._no_iterations = np.zeros(self.q, dtype=np.int64)
        self.is_single = is_single or is_large
        self._matrices = []
        if self.damping is not None and not is_large:
            self._matrices = [np.asarray(one.matrix) for one in self.damping.directions]
        self.loads_of = [StepLoads(one, method, self.tables) for one in scenes]
        self._frames: OrderedDict[tuple[float, int], Frame] = OrderedDict()
        self._blocks: OrderedDict[tuple[float, int], Block] = OrderedDict()

    def start(self) -> State:
        """The state at t = 0."""
        zero = np.zeros((self.q, self.e))
        z, column = np.zeros((self.q, 0, self.e)), np.zeros((1, 0, 1))
        if self.damping is not None:
            z, column = self.damping.start()
        return State(
            t=0.0,
            x=self.x0.copy(),
            p=self.p0.copy(),
            x_lost=zero,
            p_lost=zero,
            z=z,
            column=column,
            live=np.ones(self.q, dtype=bool),
        )

    def frame(self, h: float, count: int) -> Frame:
        """Tables of `count` steps of length h."""
        key = (h, count)
        if key not in self._frames:
            unit = unit_tables(self.method, self.e, self.law.has_rates)
            self._frames[key] = Frame(unit, self.damping, h, count)
            if len(self._frames) > KEPT_TABLES:
                self._frames.popitem(last=False)
        return self._frames[key]

    def linear_block(self, h: float, count: int) -> Block:
        """The map of `count` steps of linear scenes."""
        key = (h, count)
        if key not in self._blocks:
            frame = self.frame(h, count)
            step: Step
            if isinstance(self.law, Structure):
                step = StructureStep(self.law, frame, self.damping)
            else:
                assert isinstance(self.law, Linear)
                step = self._step(frame, self.law.at)
            self._blocks[key] = Block(frame, step, self._matrices, has_position=True)
            if len(self._blocks) > KEPT_TABLES:
                self._blocks.popitem(last=False)
        return self._blocks[key]

    def solve(
        self, state: State, h: float, count: int, loads: Array | None, block: int = 1
    ) -> Steps:
        """Solve `count` steps by the tables of `block` steps; x, p and z of the state are kept.

        Load vectors are ``(q, count, s + 1, e)``.
        """
        block = max(block, count)
        frame = self.frame(h, block)
        force = self._past(frame, state, count)
        law = self.law
        if isinstance(law, Linear | Structure):
            linear = self.linear_block(h, block)
            rows = linear.solve(state.x, state.p, force, loads, count)
            return self._steps(frame, state, rows, linear.singular, None)
        given = (
            np.zeros((self.q, count, self.tables.degree + 1, self.e)) if loads is None else loads
        )
        if force is not None:
            given = given + on_steps(frame.to_loads, force.reshape(self.q, count, -1, self.e))
        problem = Problem(law=law, t=state.t, x=state.x, p=state.p, loads=given, live=state.live)
        if block == 1:
            guess = frame.points @ self._guess(law, state, h).reshape(self.q, -1, 1)
            linearise = partial(self._linearised, law, state, frame)
            solution = solve_step(problem, guess[..., 0], linearise)
        else:
            solution = solve_block(problem, self._linearised_block(law, state, frame, count))
        return self._steps(frame, state, solution.rows, solution.failed, solution)

    def _past(self, frame: Frame, state: State, count: int) -> Array | None:
        """Force of the past on the first steps of a frame, ``(q, count m, e)``."""
        # dampers of order 1 have no states and no past
        if self.damping is None or frame.memory is None or not self.n_states:
            return None
        return self.damping.past(frame.memory, state.z, state.column, count)

    def _step(self, frame: Frame, at: Linearisation) -> DenseStep:
        local = [one[:, 0] for one in frame.damp]
        return dense_step(frame.unit, at, frame.h, local, self._matrices)

    def _linearised(self, law: StepLaw, state: State, frame: Frame, points: Array) -> Linearised:
        """The equations of a single step, linearised at points ``(q, r w)``."""
        shape = (self.q, self.tables.points.size, -1)
        times = state.t + frame.h * self.tables.points
        at, remainders = law.expand(state.x, points.reshape(shape), times)
        step = self._step(frame, at)
        return Linearised(at, Block(frame, step, self._matrices, has_position=False), remainders)

    def _linearised_block(self, law: StepLaw, state: State, frame: Frame, count: int) -> Linearised:
        """A block, linearised at its beginning or an earlier one; the last remainder as a guess."""
        linearised = state.block
        if linearised is None or linearised.block.frame is not frame:
            begin = np.zeros((self.q, 1, self.e * (2 if law.has_rates else 1)))
            if law.has_rates:
                begin[:, 0, self.e :] = law.velocity(state.x, state.p, state.t)
            at, _ = law.expand(state.x, begin, np.array([state.t]))
            mass, stiffness = (one.reshape(-1, self.e, self.e) for one in (at.mass, at.stiffness))
            at = Linearisation(mass, None, stiffness)
            block = Block(frame, self._step(frame, at), self._matrices, has_position=False)
            linearised = Linearised(at, block, np.zeros(0))
        width = frame.points.shape[0] // self.tables.points.size
        rest = np.zeros((self.q, count * self.tables.points.size, width))
        if state.rest is not None:
            rest += state.rest[:, None]
        state.block = linearised._replace(rest=rest)
        return state.block

    def _guess(self, law: StepLaw, state: State, h: float) -> Array:
        """A guess of U: by the polynomial of the last step, or else by uniform motion."""
        c = self.tables.control_points[1:]
        if state.unknowns is not None and h <= LONGEST_GUESS * state.h:
            to_next = _continuation(self.tables.degree, h / state.h)
            return np.asarray(np.matmul(to_next, state.unknowns))
        v = law.velocity(state.x, state.p, state.t)
        return np.asarray(c[:, None] * v[:, None])

    def _steps(
        self, frame: Frame, state: State, rows: Rows, failed: Mask, solution: Solution | None
    ) -> Steps:
        """Steps from their rows, with the states of the memory after them."""
        u, count = rows.unknowns, rows.unknowns.shape[1]
        z, column = state.z, state.column
        if self.damping is not None and frame.memory is not None and self.n_states:
            inputs = self.damping.within(u)
            if self.method.is_runge_kutta:
                inputs = on_steps(self.tables.to_inputs, inputs)
            z = frame.memory.push(z, inputs.reshape(self.q, -1, z.shape[-1]), count)
            column = self.damping.push_column(frame.memory, column, count)
        return Steps(
            h=frame.h,
            count=count,
            dx=rows.dx,
            dp=rows.dp,
            unknowns=u,
            z=z,
            column=column,
            failed=failed,
            iterations=self._no_iterations if solution is None else solution.iterations,
            finite=None if solution is None else solution.finite,
            rest=None if solution is None else solution.rest,
        )

    def accept(self, state: State, steps: Steps, end: float) -> None:
        """Move the state to the end of solved steps."""
        state.x, state.x_lost = compensated(state.x, state.x_lost, steps.dx[:, -1])
        state.p, state.p_lost = compensated(state.p, state.p_lost, steps.dp[:, -1])
        state.z, state.column = steps.z, steps.column
        state.unknowns, state.h, state.t = steps.unknowns[:, -1], steps.h, end
        if steps.rest is not None:
            state.rest = steps.rest[:, -1]
        if np.count_nonzero(steps.failed):
            state.live = state.live & ~steps.failed

    def loads(self, begin: float, h: float, count: int, *, is_fresh: bool) -> Array | None:
        """Load vectors on equal steps, ``(q, count, s + 1, e)``."""
        by_scene = [one.of_steps(begin, h, count, is_fresh=is_fresh) for one in self.loads_of]
        if all(one is None for one in by_scene):
            return None
        zero = np.zeros((count, self.tables.degree + 1, self.scenes[0].dimension))
        return self.member_forces([zero if one is None else one for one in by_scene])

    def member_positions(self, values: Sequence[Array] | Array) -> Array:
        """Positions or velocities of S scenes ``(S, ..., d)`` as of members, ``(q, ..., e)``."""
        if self.modes is None:
            return np.array(values)
        return np.concatenate([m.positions(x) for m, x in zip(self.modes, values, strict=True)])

    def member_forces(self, values: Sequence[Array] | Array) -> Array:
        """Momenta and forces of scenes ``(S, ..., d)`` as those of members, ``(q, ..., e)``."""
        if self.modes is None:
            return np.array(values)
        return np.concatenate([m.forces(p) for m, p in zip(self.modes, values, strict=True)])

    def scene_positions(self, x: Array) -> Array:
        """Positions or velocities of members ``(q, n, e)`` as those of scenes, ``(S, n, d)``."""
        if self.modes is None:
            return x
        k = self.width
        return np.array([m.scene_positions(x[i * k : i * k + k]) for i, m in enumerate(self.modes)])

    def to_scene(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Positions and momenta of members ``(q, n, e)`` as those of scenes, ``(S, n, d)``."""
        if self.modes is None:
            return x, p
        k = self.width
        forces = [m.scene_forces(p[i * k : i * k + k]) for i, m in enumerate(self.modes)]
        return self.scene_positions(x), np.array(forces)


@lru_cache(maxsize=1024)
def _continuation(degree: int, ratio: float) -> Array:
    """From U of a step (increments over h) to U of the next, `ratio` times as long, ``(s, s)``."""
    basis = lobatto_basis(degree)
    values = basis.values(1.0 + ratio * basis.control_points[1:])[1:].T
    return np.asarray((values - np.eye(degree)[-1]) / ratio)
