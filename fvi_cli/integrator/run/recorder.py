"""Points and steps of the scenes of an engine that are kept during a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.run.sources import Proposal, why_unsolved
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.trajectory import NewtonRecord
from fvi_cli.mathematics.arrays import Array, Integers, Mask, Places

WAITING = 256
"""Steps whose points are converted to the coordinates of their scenes together."""


class Solved(NamedTuple):
    """Equal steps of the members of an engine."""

    proposal: Proposal  # where they begin, and the time at the end of the last
    end: float
    position: Array  # at their ends, (q, n, e)
    momentum: Array
    unknowns: Array | None  # U, (q, n, s, e), where polynomials are kept


class _Rows(NamedTuple):
    """Successive points of all scenes; the last axis of times is that of the points."""

    number: Integers  # number of the step before it, from 1; 0: the start
    time: Array
    size: Array  # length of that step
    is_point: Mask  # whether the point is reported; others are kept for polynomials only
    position: Array  # (scenes, n, d)
    momentum: Array

    def of(self, rows: slice | Places) -> _Rows:
        """Some of them."""
        number, time, size, is_point, x, p = self
        return _Rows(number[rows], time[rows], size[rows], is_point[rows], x[:, rows], p[:, rows])


class _End(NamedTuple):
    """Where a scene stops: the number of its steps, the time, position and momentum, (d,) each."""

    number: int
    time: float
    position: Array
    momentum: Array


class Recorder:
    """Reported points of all scenes, thinned, and on request all steps as polynomials.

    Every n-th reported point is kept, the first and the last; with steps, all points of the
    mesh and the polynomials. Runs stop where numbers cease to be finite; `failures` says why, by
    the number of the scene.
    """

    def __init__(self, engine: Engine, *, every: int = 1, with_steps: bool = False) -> None:
        self._engine, self._every, self.with_steps = engine, every, with_steps
        self.failures: dict[int, Failure] = {}
        self._done = self._reported = self._count = 0
        self._live = np.ones(len(engine.scenes), dtype=bool)
        self._iterations, self._most = np.zeros((2, engine.q), dtype=np.int64)
        self._ends: dict[int, _End] = {}
        self._kept: list[_Rows] = []
        self._velocity: list[Array] = []
        self._waiting: list[Solved] = []
        # for some scenes how many of the waiting steps are kept, and why they stop there
        self._stops: dict[int, tuple[int, Failure]] = {}

    # while steps go on

    def begin(self, time: float, position: Array, momentum: Array) -> None:
        """Record the start of the run, both ``(scenes, d)``."""
        none, at, is_point = np.zeros(1, dtype=np.int64), np.array([time]), np.ones(1, dtype=bool)
        self._last = _Rows(none, at, at, is_point, position[:, None], momentum[:, None])
        self._kept.append(self._last)

    def count(self, steps: Steps) -> None:
        """Count the iterations of steps, also of such as are rejected."""
        self._iterations = self._iterations + steps.iterations
        self._most = np.maximum(self._most, steps.iterations)

    def note(self, state: State, steps: Steps) -> None:
        """Record which scenes fail in the next steps; the state is that before them."""
        if not np.count_nonzero(steps.failed):
            return
        for member in np.flatnonzero(steps.failed & state.live).tolist():
            error = why_unsolved(steps, state, member)
            failure = Failure.in_step(self._done + self._count, state.t, error)
            self._stops.setdefault(member // self._engine.width, (self._count, failure))

    def add(self, solved: Solved) -> None:
        """Add the next steps."""
        self._waiting.append(solved)
        self._count += solved.position.shape[1]

    def stop(self, failure: Failure) -> None:
        """Stop all scenes: there is no next step."""
        for scene in range(len(self._live)):
            self._stops.setdefault(scene, (self._count, failure))

    @property
    def is_full(self) -> bool:
        """Whether it is time to :meth:`flush`."""
        return self._count >= WAITING or bool(self._stops)

    def flush(self, state: State) -> None:
        """Keep the added steps; members of scenes that stop here are solved no more."""
        rows, before = self._last, self._last
        if self._waiting:
            rows = self._joined()
            # a sum is finite only if all terms are
            if not np.isfinite(rows.position.sum() + rows.momentum.sum()):
                self._stop_at_infinity(rows)
        for scene, (count, failure) in self._stops.items():
            if self._live[scene]:
                self.failures[scene] = failure
                self._end(scene, rows.of(slice(count - 1, count)) if count else before)
        if self._waiting:
            keeps_all = self.with_steps or bool(rows.is_point.all())
            self._kept.append(rows if keeps_all else rows.of(np.flatnonzero(rows.is_point)))
            if self.with_steps:
                self._velocity.append(self._velocities())
            self._last = rows.of(slice(-1, None))
            self._done, self._count, self._waiting = self._done + self._count, 0, []
        if self._stops:
            self._stops = {}
            state.live = state.live & np.repeat(self._live, self._engine.width)

    def _joined(self) -> _Rows:
        """The waiting steps in the coordinates of the scenes."""
        proposals, ends, position, momentum, _ = zip(*self._waiting, strict=True)
        counts = [one.shape[1] for one in position]

        def spread(values: Sequence[float]) -> Array:
            return np.repeat(values, counts) if len(values) > 1 else np.asarray(values[0])

        last = np.cumsum(counts) - 1
        behind = [one.first - end for one, end in zip(proposals, last - counts, strict=True)]
        index = np.arange(self._count)
        number = index + spread(behind)
        sizes = spread([one.h for one in proposals])
        times = spread([one.origin for one in proposals]) + sizes * number
        times[last] = ends
        every = spread([one.reported_every for one in proposals])
        passed = number + spread([one.passed for one in proposals])
        is_point = (every > 0) & (passed % np.maximum(every, 1) == 0)
        order = self._reported + np.cumsum(is_point)
        self._reported = int(order[-1])
        x, p = self._engine.to_scene(_join(position, 1), _join(momentum, 1))
        sizes = np.broadcast_to(sizes, times.shape)
        return _Rows(
            self._done + 1 + index, times, sizes, is_point & (order % self._every == 0), x, p
        )

    def _velocities(self) -> Array:
        """Velocities at the stages of the waiting steps, shape ``(scenes, n, r, d)``."""
        unknowns = _join([one.unknowns for one in self._waiting if one.unknowns is not None], 1)
        velocity = np.matmul(self._engine.tables.slopes[1:].T, unknowns)
        q, n, r, _ = velocity.shape
        found = self._engine.scene_positions(velocity.reshape(q, n * r, -1))
        return found.reshape(len(self._live), n, r, -1)

    def _stop_at_infinity(self, rows: _Rows) -> None:
        """Stop scenes before their first step to numbers that are not finite."""
        every = np.concatenate([rows.position, rows.momentum], axis=2)
        finite = np.asarray(np.isfinite(every).all(axis=2))
        for scene in np.flatnonzero(~finite.all(axis=1)).tolist():
            at = int(finite[scene].argmin())
            if scene not in self._stops or at < self._stops[scene][0]:
                failure = Failure.not_finite(self._done + at, float(rows.time[at]))
                self._stops[scene] = (at, failure)

    def _end(self, scene: int, last: _Rows) -> None:
        self._live[scene] = False
        x, p = last.position[scene, 0].copy(), last.momentum[scene, 0].copy()
        self._ends[scene] = _End(int(last.number[0]), float(last.time[0]), x, p)

    # when they have ended

    def finish(self) -> None:
        """Note that all steps are done."""
        for scene in np.flatnonzero(self._live).tolist():
            self._end(scene, self._last)

    @property
    def _rows(self) -> _Rows:
        """All rows; the pieces are replaced, so that no value is stored twice."""
        if len(self._kept) > 1:
            columns = [list(one) for one in zip(*self._kept, strict=True)]
            self._kept.clear()
            joined: list[Any] = []
            for pieces, axis in zip(columns, (0, 0, 0, 0, 1, 1), strict=True):
                joined.append(_join(pieces, axis))
                pieces.clear()
            self._kept.append(_Rows(*joined))
        return self._kept[0]

    def points(self, scene: int) -> tuple[Array, Array, Array]:
        """Times, positions and momenta that are kept of a scene, including its last point."""
        rows, end = self._rows, self._ends[scene]
        count = int(np.searchsorted(rows.number, end.number, side="right"))
        chosen: slice | Places = slice(count)
        if not rows.is_point[:count].all():
            chosen = np.flatnonzero(rows.is_point[:count])
        time, position, momentum = rows.time[chosen], rows.position[scene], rows.momentum[scene]
        position, momentum = position[chosen], momentum[chosen]
        if rows.number[chosen][-1] != end.number:
            time = np.append(time, end.time)
            position = np.concatenate([position, end.position[None]])
            momentum = np.concatenate([momentum, end.momentum[None]])
        return time, position, momentum

    def steps(self, scene: int) -> RunSteps:
        """All steps of a scene as polynomials."""
        count, tables = self._ends[scene].number, self._engine.tables
        rows = self._rows.of(slice(count + 1))
        velocity = np.zeros((1, 0, tables.points.size, rows.position.shape[2]))
        if self._velocity:
            self._velocity = [_join(self._velocity, 1)]
            velocity = self._velocity[0]
        return RunSteps(
            tables=tables,
            time=rows.time,
            step_size=rows.size[1:],
            position=rows.position[scene],
            momentum=rows.momentum[scene],
            velocity=velocity[scene if velocity.size else 0, :count],
        )

    def steps_done(self, scene: int) -> int:
        """Number of steps that a scene did."""
        return self._ends[scene].number

    def newton(self, scene: int) -> NewtonRecord:
        """Numbers of iterations of a scene."""
        first = scene * self._engine.width
        return NewtonRecord(iterations=int(self._iterations[first]), largest=int(self._most[first]))


def _join(pieces: Sequence[Array], axis: int) -> Array:
    return np.concatenate(pieces, axis=axis) if len(pieces) > 1 else pieces[0]
