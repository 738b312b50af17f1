"""Runs whose memory does not grow with the number of steps.

Everything is done chunk by chunk: forces are evaluated, blocks of steps advanced, and the points
of the grid that are wanted are kept. What one block leaves to the next is a `Checkpoint`, and
chunks and blocks lie where they lie on the whole grid, so that a run that was interrupted goes on
bit for bit as if it had not been.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.lagrangian import Lagrangian
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.checkpoint import Checkpoint
from fvi_cli.integrator.exponential_history import exponential_kernel
from fvi_cli.integrator.exponential_march import (
    CHUNK,
    LARGEST_BLOCK,
    LinearMarch,
    March,
    block_length,
    linear_decoupling,
)
from fvi_cli.integrator.exponential_newton import NewtonMarch
from fvi_cli.integrator.growth_bound import GrowthBound, first_outside, growth_bound
from fvi_cli.integrator.integrate import series_of
from fvi_cli.integrator.known_forces import KnownForces, known_forces
from fvi_cli.integrator.known_part import KnownPart, settled_method
from fvi_cli.integrator.memory import build_memory
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.stepping import StepProblem
from fvi_cli.integrator.trajectory import NewtonRecord, Trajectory

Array = NDArray[np.float64]

PROBED_STEPS = 33
"""Steps whose known forces tell how large they are in the run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A stretch of a run.

    Parameters
    ----------
    trajectory
        The kept points after the start of the stretch (with the start for the first one).
    checkpoint
        Where the next stretch begins; None after the end of the run, or a failure.
    """

    trajectory: Trajectory
    checkpoint: Checkpoint | None


def integrate_part(
    scene: Scene,
    method: Method,
    n_steps: int,
    *,
    until: int | None = None,
    checkpoint: Checkpoint | None = None,
    every: int = 1,
) -> Part:
    """Integrate from a checkpoint on to the first block boundary at or after step `until`.

    The trajectories of successive parts, one after the other, are that of the whole run to the
    last bit.

    Parameters
    ----------
    scene, method, n_steps
        As for :func:`fvi_cli.integrator.integrate.integrate`, always those of the whole run.
    until
        Where to stop, the end by default.
    checkpoint
        Where to begin, the start by default.
    every
        Keep every n-th point of the grid (and the first and the last).

    Raises
    ------
    ValueError
        If the method is not a Runge-Kutta one, the checkpoint belongs to another run, or a number
        is outside of its range.
    """
    if every < 1:
        raise ValueError(f"every: {every} is not allowed; it must be at least 1")
    begin = 0 if checkpoint is None else checkpoint.step
    if until is None:
        until = n_steps
    if not begin < until <= n_steps:
        raise ValueError(f"until: {until} is not allowed; it must be {begin + 1} to {n_steps}")
    began = time.perf_counter()
    march, known, bound, remarks = _march(scene, method, n_steps, checkpoint)
    h = scene.final_time / n_steps
    end = min(n_steps, -(-until // march.block) * march.block)
    ready = time.perf_counter()
    kept = _Kept(scene, known, n_steps, every, begin, end)
    newton = NewtonRecord()
    failure, done = "", begin
    with np.errstate(all="ignore"):
        while done < end and not failure:
            advanced(done, n_steps)
            first = done - done % CHUNK
            last = min(first + CHUNK, end)
            marched = march.chunk(first, done, last)
            failure = marched.failure
            newton = _noted(newton, done, marched.iterations)
            stop = first + marched.finished
            fresh = marched.position[done - first : marched.finished]
            outside = first_outside(bound, fresh, done + 1, h)
            if outside is not None:
                stop, failure = done + 1 + outside[0], outside[1]
            kept.keep(first, done, stop, marched.position, marched.momentum, final=bool(failure))
            done = stop
    finished = time.perf_counter()
    if scene.lagrangian is not None:
        failure = kept.cut_where_irregular(scene.lagrangian) or failure
    following = None
    if not failure and done < n_steps:
        following = march.checkpoint(method.case, done)
    diverged = failure.startswith("diverged") or not (
        np.isfinite(kept.position).all() and np.isfinite(kept.momentum).all()
    )
    return Part(
        trajectory=Trajectory(
            time=kept.time,
            position=kept.position,
            momentum=kept.momentum,
            energy=kept.energy,
            n_steps=n_steps,
            step_size=h,
            status="ok" if not failure else ("diverged" if diverged else "failed"),
            message=failure,
            history_operations=march.operations,
            newton=newton,
            setup_seconds=ready - began,
            stepping_seconds=finished - ready,
            remarks=remarks,
            every=every,
        ),
        checkpoint=following,
    )


def _march(
    scene: Scene, method: Method, n_steps: int, checkpoint: Checkpoint | None
) -> tuple[March, KnownPart | None, GrowthBound, tuple[str, ...]]:
    """Everything that is needed before the first step."""
    tables, h = step_tables(method), scene.final_time / n_steps
    asked = (method.case, n_steps, h)
    if checkpoint is not None:
        found = (checkpoint.case, checkpoint.n_steps, checkpoint.step_size)
        if found != asked:
            raise ValueError(f"checkpoint: it belongs to the run {found}, not to {asked}")
    series = series_of(scene, method, n_steps)
    known = series.known
    settled = settled_method(scene, method, series)
    from_rest = known is not None and known.carries_start
    damping = scene.active_damping
    memory = build_memory(
        scene,
        settled,
        tables,
        n_steps,
        damping,
        from_rest=from_rest,
        n_weights=min(LARGEST_BLOCK, n_steps + 1),
    )
    kernel = exponential_kernel(settled, h, n_steps, damping, memory.channels)
    rest = np.zeros(scene.dimension)
    problem = StepProblem(
        scene=scene,
        tables=tables,
        memory=memory,
        step_size=h,
        n_steps=n_steps,
        position=rest if from_rest else scene.initial_position,
        momentum=rest if from_rest else _start_momentum(scene),
    )
    forces = known_forces(scene, settled, tables, memory, known, n_steps)
    samples = tables.sample_points.size
    if scene.is_linear:
        decoupling = linear_decoupling(problem)
        batch = decoupling.batch
        size = samples * scene.dimension // batch
        block = block_length(size, batch)
        march: March = LinearMarch(problem, forces, decoupling, kernel, block, checkpoint)
    else:
        block = block_length(samples * scene.dimension, 1)
        march = NewtonMarch(problem, forces, kernel, block, checkpoint)
    return march, known, _bound(problem, forces), series.remarks


def _start_momentum(scene: Scene) -> Array:
    position, velocity = scene.initial_position, scene.initial_velocity
    if scene.lagrangian is not None:
        return scene.lagrangian.momentum(position, velocity, 0.0)
    return np.asarray(scene.inertia.mass @ velocity)


def _energy(scene: Scene, position: Array, momentum: Array, time: Array) -> Array:
    lagrangian = scene.lagrangian
    if lagrangian is None:
        return scene.energy(position, momentum)
    velocity = lagrangian.velocity(position, momentum, time)
    return lagrangian.energy(position, velocity, time)


def _bound(problem: StepProblem, forces: KnownForces) -> GrowthBound:
    """The bound of the run, its largest force from steps spread over the whole of it."""
    n_steps = problem.n_steps
    steps = np.unique(np.linspace(0, n_steps - 1, PROBED_STEPS).astype(int)).tolist()
    found = [forces.moments(step, step + 1) for step in steps]
    present = [moments for moments in found if moments is not None]
    return growth_bound(replace(problem, moments=np.concatenate(present)) if present else problem)


def _noted(record: NewtonRecord, step: int, iterations: tuple[int, ...]) -> NewtonRecord:
    if not any(iterations):
        return record
    worst = int(np.argmax(iterations))
    is_worse = iterations[worst] > record.largest
    return NewtonRecord(
        iterations=record.iterations + sum(iterations),
        largest=max(record.largest, iterations[worst]),
        worst_step=step + worst if is_worse else record.worst_step,
    )


class _Kept:
    """The points of the grid that are kept, with the known part of the solution added."""

    def __init__(
        self,
        scene: Scene,
        known: KnownPart | None,
        n_steps: int,
        every: int,
        begin: int,
        end: int,
    ) -> None:
        self._scene, self._known, self._every, self._n_steps = scene, known, every, n_steps
        # multiples of `every` in (begin, end], the start and the end of the run, a failure
        room = end // every - begin // every + 3
        self._time, self._energy = np.empty(room), np.empty(room)
        self._position = np.empty((room, scene.dimension))
        self._momentum = np.empty((room, scene.dimension))
        self._count = 0
        if begin == 0:
            self._add(
                np.zeros(1), scene.initial_position[None].copy(), _start_momentum(scene)[None]
            )

    @property
    def time(self) -> Array:
        """Times of the kept points, shape ``(n,)``."""
        return self._time[: self._count]

    @property
    def position(self) -> Array:
        """Positions, shape ``(n, d)``."""
        return self._position[: self._count]

    @property
    def momentum(self) -> Array:
        """Momenta, shape ``(n, d)``."""
        return self._momentum[: self._count]

    @property
    def energy(self) -> Array:
        """Energies, shape ``(n,)``."""
        return self._energy[: self._count]

    def keep(
        self, first: int, begin: int, end: int, position: Array, momentum: Array, *, final: bool
    ) -> None:
        """Keep what is wanted of the steps `begin` to `end`; row 0 is the end of step `first`."""
        if end <= begin:
            return
        wanted = np.arange(begin - begin % self._every + self._every, end + 1, self._every)
        if (final or end == self._n_steps) and (wanted.size == 0 or wanted[-1] != end):
            wanted = np.append(wanted, end)
        if wanted.size == 0:
            return
        rows = wanted - first - 1
        h = self._scene.final_time / self._n_steps
        chosen, momenta = position[rows], momentum[rows]
        if self._known is not None:
            # on the whole chunk, whatever part of it is done: the same rounding
            grid = h * np.arange(first + 1, min(first + CHUNK, self._n_steps) + 1, dtype=float)
            known_position, known_velocity = self._known.on_grid(grid)
            chosen = chosen + known_position[rows]
            if self._scene.lagrangian is None:
                known_momentum = known_velocity @ self._scene.inertia.mass
            else:
                known_momentum = self._scene.lagrangian.momentum(
                    known_position, known_velocity, grid
                )
            momenta = momenta + known_momentum[rows]
        self._add(h * wanted.astype(float), chosen, momenta)

    def cut_where_irregular(self, lagrangian: Lagrangian) -> str:
        """Leave out what comes after the last regular point; why, in words, if anything does."""
        from fvi_cli.integrator.general import regular_until

        self._count, failure = regular_until(
            lagrangian, self.position, self.momentum, self.energy, self.time
        )
        return failure

    def _add(self, grid: Array, position: Array, momentum: Array) -> None:
        at = slice(self._count, self._count + grid.size)
        self._time[at], self._position[at], self._momentum[at] = grid, position, momentum
        self._energy[at] = _energy(self._scene, position, momentum, grid)
        self._count += grid.size
