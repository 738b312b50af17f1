r"""Some steps of finished runs, solved again by a method of more stages.

A step of a run begins at its position and momentum there, which have the order 2 m of the points.
The inputs of the memory are velocities of the run itself: a polynomial of degree m + 1 through
those at the m stages and at both ends of a step. Its error enters only through the kernel, which is
smooth in the past. So each chosen step is solved by itself, and the others are not solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import PIECE
from fvi_cli.integrator.damping.damping import Damping, DampingTables
from fvi_cli.integrator.decoupling import linear_decoupling
from fvi_cli.integrator.engine.structures import GROUP
from fvi_cli.integrator.memory.exponentials import ExponentialKernels
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.motion import end_slopes, largest_near
from fvi_cli.integrator.observations.pieces import AT_A_TIME
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import engine_for
from fvi_cli.integrator.step_tables import StepTables, step_tables
from fvi_cli.mathematics.arrays import Array, Mask, Places
from fvi_cli.mathematics.lagrange import LagrangeBasis
from fvi_cli.mathematics.series.chebyshev import in_rows


def can_be_single(scene: Scene, run: RunSteps, chosen: Places) -> bool:
    """Whether steps of a run can be solved by themselves, and are few enough for that."""
    is_rough = any(term.order > 1 for term in scene.active_damping)
    if is_rough or run.jump is not None or scene.lagrangian is not None:
        return False
    modes = linear_decoupling(scene)
    return 2 * chosen.size <= run.n_steps and (modes is None or modes.batch == 1)


def solved_steps(
    scenes: Sequence[Scene], method: Method, runs: Sequence[RunSteps], chosen: Sequence[Places]
) -> list[RunSteps | None]:
    """Runs on one mesh of scenes of one kind with their chosen steps solved by another method.

    None for runs in which a step has no solution, and for stiff runs.
    """
    found: list[RunSteps | None] = []
    for first in range(0, len(scenes), PIECE):
        # so many stay in the cache
        part = slice(first, first + PIECE)
        found += _solved(scenes[part], method, runs[part], chosen[part])
    return found


def _solved(
    scenes: Sequence[Scene], method: Method, runs: Sequence[RunSteps], chosen: Sequence[Places]
) -> list[RunSteps | None]:
    mesh = runs[0].mesh(scenes[0].break_points)
    engine, tables = engine_for(scenes, method, mesh, most=1), step_tables(method)
    position, momentum = (
        np.stack([getattr(one, name) for one in runs]) for name in ("position", "momentum")
    )
    with np.errstate(all="ignore"):
        every = zip(scenes, position, momentum, strict=True)
        at_points = np.stack([scene.velocity(x, p, runs[0].time) for scene, x, p in every])
    stages = np.stack([one.velocity for one in runs])
    inputs, failed = _at_stages(stages, at_points, runs[0].tables, method)
    velocity = inputs.copy()
    owner = np.repeat(np.arange(len(runs)), [one.size for one in chosen])
    numbers = np.concatenate(chosen)
    start, damping = engine.start(), engine.damping
    states, begin = start.z, 0
    # the force of the past is computed beforehand
    start.z = start.z[:, :0]
    for stretch in mesh.stretches:
        h, end = stretch.step_size, begin + stretch.n_steps
        own = np.flatnonzero((begin <= numbers) & (numbers < end))
        past = np.zeros((own.size, tables.points.size, engine.e))
        if damping is not None:
            path = _Path(damping, damping.tables(h, min(GROUP, stretch.n_steps)), inputs)
            states = path.follow(states, begin, end, owner[own], numbers[own], past)
        loads = engine.loads(stretch.begin, h, stretch.n_steps, is_fresh=stretch.is_fresh)
        for first in range(0, own.size, AT_A_TIME):
            part = slice(first, first + AT_A_TIME)
            member, step = owner[own[part]], numbers[own[part]]
            state = replace(start.of(member), x=position[member, step], p=momentum[member, step])
            given = None if loads is None else loads[member, step - begin][:, None]
            guess = np.matmul(tables.to_unknowns, inputs[member, step])
            with np.errstate(all="ignore"):
                solved, wrong = engine.of(member).solve_after(state, h, past[part], given, guess)
            velocity[member, step] = solved.reshape(step.size, -1, engine.e)
            failed[member[wrong]] = True
        begin = end
    return [
        None if is_wrong else replace(run, tables=tables, velocity=one)
        for run, one, is_wrong in zip(runs, velocity, failed.tolist(), strict=True)
    ]


def _at_stages(
    velocity: Array, at_points: Array, own: StepTables, method: Method
) -> tuple[Array, Mask]:
    """Velocities at the stages of another method, ``(q, n, r, d)``, and which runs are stiff.

    Takes velocities at the stages ``(q, n, m, d)`` and at the points ``(q, n + 1, d)`` of runs. In
    stiff runs the points keep errors that decay at the stages.
    """
    q, n, m, d = velocity.shape
    stages = velocity.swapaxes(2, 3).reshape(-1, m)
    to_ends = end_slopes(own.degree).T @ own.to_unknowns
    gaps = in_rows(stages, to_ends.T).reshape(q, n, d, 2)
    first, last = (one.reshape(-1, 1) for one in (at_points[:, :-1], at_points[:, 1:]))
    gaps -= np.concatenate([first, last], axis=1).reshape(gaps.shape)
    near = np.stack([largest_near(one, np.arange(n)) for one in velocity])
    is_stiff = np.any(~(np.abs(gaps) <= near[..., None]), axis=(1, 2, 3))
    points = np.concatenate([[0.0], own.points, [1.0]])
    table = LagrangeBasis(control_points=points).values(step_tables(method).points)
    found = in_rows(np.concatenate([first, stages, last], axis=1), table)
    return np.ascontiguousarray(found.reshape(q, n, d, -1).swapaxes(2, 3)), is_stiff


class _Path:
    """The memory along equal steps with inputs ``(q, n, i, e)``."""

    def __init__(self, damping: Damping, tables: DampingTables, inputs: Array) -> None:
        self.damping, self.tables, self.inputs = damping, tables, inputs

    def follow(
        self, states: Array, begin: int, end: int, owner: Places, steps: Places, past: Array
    ) -> Array:
        """States at the end; puts forces of the past on steps into `past`, ``(p, m, e)``."""
        damping, tables, (q, _, i, e) = self.damping, self.tables, self.inputs.shape
        block, column = tables.kernels.count, np.zeros((1, damping.n_states, 1))
        earlier = [one.copy() for one in tables.sequences]
        for one in earlier:
            one[:, 0] = 0.0
        before = replace(tables, sequences=tuple(earlier))
        for first in range(begin, end, block * PIECE):
            last = min(first + block * PIECE, end)
            whole, rest = divmod(last - first, block)
            blocks = whole + (rest > 0)
            driven = np.zeros((q, blocks * block, i, e))
            driven[:, : last - first] = self.inputs[:, first:last]
            driven = driven.reshape(q, blocks, block * i, e)
            added, path = self._added(driven), np.empty((blocks, *states.shape))
            for index in range(blocks):
                path[index] = states
                if index < whole:
                    states = states + (self._change * states + added[index])
            if rest:
                states = tables.kernels.push(states, driven[:, -1, : rest * i], rest)
            force = damping.past(tables, path, column, block)
            force = force + damping.own(before, driven.swapaxes(0, 1), block)
            (own,) = np.nonzero((first <= steps) & (steps < last))
            number, offset = np.divmod(steps[own] - first, block)
            past[own] = force.reshape(blocks, q, block, -1, e)[number, owner[own], offset]
        return states

    @property
    def _change(self) -> Array:
        return self._kernels.change[:, None]

    @property
    def _kernels(self) -> ExponentialKernels:
        kernels = self.tables.kernels
        assert isinstance(kernels, ExponentialKernels)
        return kernels

    def _added(self, driven: Array) -> Array:
        """Contributions of inputs of blocks ``(q, b, B i, e)`` to the states, ``(b, q, J, e)``."""
        q, blocks, size, e = driven.shape
        rows = driven.swapaxes(2, 3).reshape(-1, size)
        found = in_rows(rows, self._kernels.intake.T).reshape(q, blocks, e, -1)
        return np.ascontiguousarray(found.transpose(1, 0, 3, 2))
