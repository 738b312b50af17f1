"""The engine: steps of q scenes of one kind by one method, all members at once.

Shapes: q members, e components, s unknowns of a step, r quadrature points, m samples of the damping
force, i inputs of the memory in a step, J states, B steps. Decoupled modes of a linear scene are
members with one component.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.frame import Frame, longest_block
from fvi_cli.integrator.engine.law import StepLaw, force_of, law_of, modes_of
from fvi_cli.integrator.engine.newton import Newton, Solution
from fvi_cli.integrator.engine.operator import Operator, Operators
from fvi_cli.integrator.engine.state import State, Steps, compensated
from fvi_cli.integrator.engine.structures import GROUP, StructureLaw, is_structure, solve_one_by_one
from fvi_cli.integrator.engine.tables import on_steps
from fvi_cli.integrator.loads import StepLoads
from fvi_cli.integrator.memory.damping import damping_of
from fvi_cli.integrator.memory.interface import along
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.lagrange import lobatto_basis

LONGEST_GUESS = 1.5
"""The polynomial of a step is the guess for the next one if that is up to so many times as long."""
NEVER_SHORTER = 1 << 30  # longest block at the start: no limit


class Engine:
    """Steps of scenes of one kind, which differ in numbers only.

    `shortest_step` and `steps` as for :func:`fvi_cli.integrator.memory.kernel.power_kernel`;
    `n_steps` for backward differences. `most` is the longest block of members that are batched
    with others; None: as the size of matrices allows.
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
        self.modes, reach = modes_of(scenes), None
        self.law: StepLaw
        if is_structure(scenes, method, self.modes):
            self.modes, self.law = None, StructureLaw(scene)
            reach = self.law.reach
        else:
            self.law = law_of(scenes, self.modes)
        self.x0 = self.member_positions([one.initial_position for one in scenes])
        self.v0 = self.member_positions([one.initial_velocity for one in scenes])
        self.q, self.e = self.x0.shape
        # number of members of a scene
        self.width = 1 if self.modes is None else self.modes[0].batch
        self.p0 = self.law.momentum(self.x0, self.v0, 0.0)
        self.damping = damping_of(
            scenes,
            method,
            shortest_step=shortest_step,
            steps=steps,
            n_steps=n_steps,
            modes=self.modes,
            reach=reach,
        )
        self.n_states = 0 if self.damping is None else self.damping.n_states
        self._operators = Operators(self.law, self.damping, method, self.e)
        self.loads_of = [StepLoads(one, method, self.tables) for one in scenes]
        self.has_loads = any(not one.is_empty for one in self.loads_of)
        self.is_batch = most is not None
        inputs = len(self.tables.to_inputs) * self.e
        self.most = longest_block(self.law, self.q, inputs) if most is None else most
        if isinstance(self.law, StructureLaw):
            self.most = GROUP

    def start(self) -> State:
        """The state at t = 0."""
        q, e = self.q, self.e
        z, column = np.zeros((q, 0, e)), np.zeros((1, 0, 1))
        if self.damping is not None:
            z, column = self.damping.start()
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

    def add_loads(self, scene: int, loads: Array) -> None:
        """Add load vectors of the first steps of a scene, ``(n, s + 1, d)``, to its own."""
        self.loads_of[scene].add(loads)
        self.has_loads = True

    def frame(self, h: float, count: int) -> Frame:
        """Tables of `count` steps of length h."""
        return self._operators.frame(h, count)

    def operator(self, h: float, count: int) -> Operator:
        """The equations of `count` steps of linear scenes."""
        return self._operators.of_linear(h, count)

    def guess(self, state: State, h: float) -> Array:
        """A guess of U: by the polynomial of the last step, or else by uniform motion."""
        c = self.tables.control_points[1:]
        if state.unknowns is not None and h <= LONGEST_GUESS * state.h:
            ahead = _continuation(self.tables.degree, h / state.h)
            return np.asarray(np.matmul(ahead, state.unknowns))
        v = self.law.velocity(state.x, state.p, state.t)
        return np.asarray(c[:, None] * v[:, None])

    def solve(
        self,
        state: State,
        h: float,
        count: int,
        loads: Array | None,
        most: int | None = None,
    ) -> Steps:
        """Solve `count` steps; the state is not changed.

        Load vectors are ``(q, count, s + 1, e)``; tables are those of `most` steps.
        """
        if isinstance(self.law, StructureLaw):
            frame = self.frame(h, count)
            return solve_one_by_one(frame, self.law, self.damping, state, loads)
        most = max(count, most or count)
        if self.law.is_linear:
            op = self.operator(h, most)
            past = self._past(op.frame, state, count)
            if self.is_batch and 1 < count == op.frame.count:
                return self._linear(op, state, past, loads)
            known = self._known(op.frame, past, count, loads)
            u = op.solve(state, known).reshape(*known.shape[:2], -1, self.e)
            failed = op.singular.repeat(self.q // len(op.singular))
            return self._steps_from(
                op.frame, state, known, u, self._linear_impulse(op, state, u), failed
            )
        if most == 1:
            op, points, rest = self._operators.of_step(state, h, self.guess(state, h))
        else:
            op = self._operators.of_block(state, h, most)
            points, rest = None, None
        known = self._known(op.frame, self._past(op.frame, state, count), count, loads)
        found = Newton(self.law, self.damping, op, state, known).run(points, rest)
        u = found.unknowns.reshape(*known.shape[:2], -1, self.e)
        impulse = self._nonlinear_impulse(op, found, count)
        return self._steps_from(op.frame, state, known, u, impulse, found.failed, found)

    def _past(self, frame: Frame, state: State, count: int) -> Array | None:
        """Force of the past on the first steps of a frame, ``(q, count m, e)``."""
        # dampers of order 1 have no states and no past, but tables of blocks expect one
        if self.damping is None or frame.damping is None or not (self.n_states or count > 1):
            return None
        return self.damping.past(frame.damping, state.z, state.column, count)

    def _known(self, frame: Frame, past: Array | None, count: int, loads: Array | None) -> Array:
        """Known loads of steps with the sign of the left side, ``(q, count, s + 1, e)``."""
        if past is None:
            shape = (self.q, count, self.tables.degree + 1, self.e)
            return np.zeros(shape) if loads is None else -loads
        known = on_steps(frame.to_loads, past.reshape(self.q, count, -1, self.e))
        return known if loads is None else known - loads

    def _steps_from(
        self,
        frame: Frame,
        state: State,
        known: Array,
        u: Array,
        impulse: Array,
        failed: Mask,
        found: Solution | None = None,
    ) -> Steps:
        """Steps with unknowns `u` and, in each step, an impulse of the forces of the law."""
        q, count = u.shape[:2]
        inputs = self._inputs(u)
        change = -np.add.reduce(known, axis=2)
        z, damping = state.z, self.damping
        if damping is not None and frame.damping is not None:
            for impulses, one in zip(frame.impulses, damping.combinations, strict=True):
                if count < frame.count:
                    impulses = impulses[:, :count, : inputs.shape[1]]
                change -= along(np.matmul(impulses, inputs), one.matrix)
            if self.n_states:
                z = frame.damping.kernels.push(state.z, inputs, count)
        none = np.zeros(q, dtype=np.int64)
        return Steps(
            h=frame.h,
            count=count,
            dx=frame.h * _sums(u[:, :, -1]),
            dp=_sums(change + impulse),
            unknowns=u,
            inputs=inputs,
            z=z,
            iterations=none if found is None else found.iterations,
            most=none if found is None else found.iterations,
            failed=failed,
            failed_at=none,
            change=np.zeros(q) if found is None else found.change,
            rest=None if found is None else found.rest,
        )

    def _inputs(self, u: Array) -> Array:
        """Inputs of the memory in steps, ``(q, B i, e)``."""
        if self.method.is_runge_kutta:
            u = on_steps(self.tables.to_inputs, u)
        return u.reshape(len(u), -1, self.e)

    def _linear(self, op: Operator, state: State, past: Array | None, loads: Array | None) -> Steps:
        """A block of linear members, by one matrix for each member, and one for load vectors."""
        frame, (q, e), count, damping = op.frame, state.x.shape, op.frame.count, self.damping
        force = [] if past is None else [past.reshape(q, -1)]
        given = np.concatenate([state.x, state.p, *force], axis=1)
        found = np.matmul(op.outputs, given[..., None])[..., 0]
        if loads is not None:
            found += np.matmul(op.outputs_of_loads, loads.reshape(q, -1, 1))[..., 0]
        n = count * len(self.tables.to_inputs) * e
        inputs = found[:, :n].reshape(q, -1, e)
        dx, dp = found[:, n:].reshape(q, 2, count, e).swapaxes(0, 1)
        # later steps need the unknowns of the last step only
        unknowns = inputs.reshape(q, count, -1, e)[:, -1:]
        if self.method.is_runge_kutta:
            unknowns = on_steps(self.tables.to_unknowns, unknowns)
        z = state.z
        if damping is not None and frame.damping is not None:
            z = frame.damping.kernels.push(state.z, inputs, count)
        none = np.zeros(q, dtype=np.int64)
        return Steps(
            h=frame.h,
            count=count,
            dx=dx,
            dp=dp,
            unknowns=unknowns,
            inputs=inputs,
            z=z,
            iterations=none,
            most=none,
            failed=np.zeros(q, dtype=bool),
            failed_at=none,
            change=np.zeros(q),
        )

    def _linear_impulse(self, op: Operator, state: State, u: Array) -> Array:
        """Impulse of the linear forces in each step."""
        place = on_steps(op.frame.mean, u)[:, :, 0] + op.frame.h * state.x[:, None]
        if u.shape[1] > 1:
            place[:, 1:] += op.frame.h * (op.frame.h * _sums(u[:, :-1, -1]))
        return -force_of(op.at.stiffness, place)

    def _nonlinear_impulse(self, op: Operator, found: Solution, count: int) -> Array:
        """Impulse of the forces of the law in each step."""
        _, mixed, stiffness = op.at
        e = self.e
        force = found.rest[..., -e:] - force_of(stiffness, found.points[..., :e])
        if mixed is not None:
            force = force + np.matmul(found.points[..., None, e:], mixed)[..., 0, :]
        weights = (op.frame.h * self.tables.weights)[None]
        return on_steps(weights, force.reshape(len(force), count, -1, e))[:, :, 0]

    def accept(self, state: State, steps: Steps, end: float) -> None:
        """Move the state to the end of solved steps."""
        state.x, state.x_lost = compensated(state.x, state.x_lost, steps.dx[:, -1])
        state.p, state.p_lost = compensated(state.p, state.p_lost, steps.dp[:, -1])
        if self.damping is not None and self.damping.has_column:
            state.column = self.pushed_column(state.column, steps.h, steps.count)
        state.z = steps.z
        state.unknowns, state.h, state.t = steps.unknowns[:, -1], steps.h, end
        if steps.rest is not None:
            state.rest = steps.rest[:, -1]
        if steps.has_failed:
            state.live = state.live & ~steps.failed

    def pushed_column(self, column: Array, h: float, count: int) -> Array:
        """States of a start velocity of 1 after `count` steps."""
        tables = self._operators.frame_of_at_least(h, count, self.most).damping
        if self.damping is None or tables is None:
            return column
        return self.damping.push_column(tables, column, count)

    def of(self, places: Places) -> Engine:
        """The engine of some members; tables of step sizes are shared."""
        if np.array_equal(places, np.arange(self.q)):
            return self
        part = copy.copy(self)
        part._operators = self._operators.of(places)
        part.law, part.damping = part._operators.law, part._operators.damping
        part.q = len(places)
        return part

    def loads(self, begin: float, h: float, count: int, *, is_fresh: bool) -> Array | None:
        """Load vectors on equal steps, ``(q, count, s + 1, e)``."""
        if not self.has_loads:
            return None
        found = [one.of_steps(begin, h, count, is_fresh=is_fresh) for one in self.loads_of]
        if all(one is None for one in found):
            return None
        zero = np.zeros((count, self.tables.degree + 1, self.scenes[0].dimension))
        return self.member_forces([zero if one is None else one for one in found])

    def member_positions(self, values: Sequence[Array] | Array) -> Array:
        """Positions or velocities of scenes ``(S, ..., d)`` as of members, ``(q, ..., e)``."""
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
        if self.modes is None or self.width == 1:
            return x
        k = self.width
        return np.array([m.scene_positions(x[i * k : i * k + k]) for i, m in enumerate(self.modes)])

    def to_scene(self, x: Array, p: Array) -> tuple[Array, Array]:
        """Positions and momenta of members ``(q, n, e)`` as those of scenes, ``(S, n, d)``."""
        if self.modes is None or self.width == 1:
            return x, p
        k = self.width
        forces = [m.scene_forces(p[i * k : i * k + k]) for i, m in enumerate(self.modes)]
        return self.scene_positions(x), np.array(forces)


def _sums(values: Array) -> Array:
    """Sums up to every step, ``(q, B, e)``."""
    return values if values.shape[1] == 1 else np.cumsum(values, axis=1)


@lru_cache(maxsize=1024)
def _continuation(degree: int, ratio: float) -> Array:
    """From U of a step to U of the next, which is `ratio` times as long, ``(s, s)``."""
    basis = lobatto_basis(degree)
    ahead = basis.values(1.0 + ratio * basis.control_points[1:])[1:].T
    return np.asarray((ahead - np.eye(degree)[-1]) / ratio)
