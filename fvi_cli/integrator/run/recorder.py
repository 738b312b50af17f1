"""Points and steps of the scenes of an engine that are kept during a run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure
from fvi_cli.integrator.run.sources import (
    Points,
    Solved,
    Stops,
    points_of,
    velocities_of,
    why_unsolved,
)
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.trajectory import NewtonRecord
from fvi_cli.mathematics.arrays import Array

WAITING = 256
"""Steps whose points are converted to the coordinates of their scenes together."""


@dataclass(frozen=True, eq=False)
class _Ending:
    """Where a scene stopped: steps that it did, rows that are kept, and its last point."""

    done: int
    rows: int
    time: float
    position: Array
    momentum: Array


class Recorder:
    """Reported points of all scenes, thinned, and on request all steps as polynomials.

    Every n-th reported point is kept, the first and the last; with steps, all points of the
    mesh and the polynomials. Runs stop where numbers cease to be finite.

    Attributes
    ----------
    done, reported
        Steps and reported points so far, without the start.
    live
        Which scenes continue, shape ``(scenes,)``.
    failures
        Why others stopped, by the number of the scene.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        every: int = 1,
        with_steps: bool = False,
    ) -> None:
        self._engine, self._every = engine, every
        self.with_steps = with_steps
        self.done = self.reported = 0
        self.live = np.ones(len(engine.scenes), dtype=bool)
        self.failures: dict[int, Failure] = {}
        self._iterations, self._most = np.zeros((2, engine.q), dtype=np.int64)
        self._endings: dict[int, _Ending] = {}
        self._rows: dict[str, list[Array]] = {name: [] for name in ("t", "h", "x", "p", "v")}
        self._is_point: list[np.ndarray] = []
        self._last: tuple[float, Array, Array] = (0.0, np.zeros(0), np.zeros(0))
        self._waiting: list[Solved] = []
        self._count = 0
        self._stops: Stops = {}

    # while steps go on

    def begin(self, time: float, position: Array, momentum: Array) -> None:
        """Record the start of the run, both ``(scenes, d)``."""
        at = np.array([time])
        self._keep(at, at, position[:, None], momentum[:, None], None, np.ones(1, dtype=bool))
        self._last = (time, position, momentum)

    def note(self, state: State, steps: Steps) -> None:
        """Record the iteration of the next steps, and failures; the state is that before them."""
        if not steps.failed.any():
            return
        for member in np.flatnonzero(steps.failed & state.live).tolist():
            scene = member // self._engine.width
            if self.live[scene] and scene not in self._stops:
                error = why_unsolved(steps, state, member)
                failure = Failure.in_step(self.reached, state.t, error)
                self._stops[scene] = (self._count, failure)

    def count(self, steps: Steps) -> None:
        """Count the iterations of steps, also of such as are rejected."""
        self._iterations = self._iterations + steps.iterations
        self._most = np.maximum(self._most, steps.iterations)

    def newton(self, scene: int) -> NewtonRecord:
        """Numbers of iterations of a scene."""
        first = scene * self._engine.width
        return NewtonRecord(iterations=int(self._iterations[first]), largest=int(self._most[first]))

    def add(self, solved: Solved) -> None:
        """Add the next steps."""
        self._waiting.append(solved)
        self._count += solved.n_steps

    def stop(self, failure: Failure) -> None:
        """Stop all scenes: there is no next step."""
        for scene in np.flatnonzero(self.live).tolist():
            self._stops.setdefault(scene, (self._count, failure))

    @property
    def reached(self) -> int:
        """Steps so far, including those that wait to be checked."""
        return self.done + self._count

    @property
    def is_full(self) -> bool:
        """Whether it is time to :meth:`flush`."""
        return self._count >= WAITING or bool(self._stops)

    def flush(self, state: State) -> None:
        """Keep the added steps; members of scenes that stop here are solved no more."""
        stops, self._stops = self._stops, {}
        if self._waiting:
            self._take(stops)
        else:
            for scene, (_, failure) in stops.items():
                self._end(scene, failure, 0, self._n_rows, self._last)
        if stops:
            state.live = state.live & np.repeat(self.live, self._engine.width)

    def _take(self, stops: Stops) -> None:
        """Keep the points of waiting steps, of every scene up to where it stops."""
        points, reported = points_of(self._engine, self._waiting, self.done)
        # a sum is finite only if all terms are
        if not np.isfinite(points.position.sum() + points.momentum.sum()):
            self._stop_at_infinity(points, stops)
        numbers = self.reported + 1 + np.arange(np.count_nonzero(reported))
        is_point = reported
        if self._every > 1:
            is_point = reported.copy()
            is_point[reported] = numbers % self._every == 0
        # all of them without a copy
        keeps_all = self.with_steps or bool(is_point.all())
        rows = slice(None) if keeps_all else np.flatnonzero(is_point)
        for scene, (count, failure) in stops.items():
            kept = self._n_rows
            kept += count if keeps_all else int(np.count_nonzero(is_point[:count]))
            self._end(scene, failure, count, kept, _last(points, count) if count else self._last)
        self._keep(
            points.times[rows],
            points.sizes[rows],
            points.position[:, rows],
            points.momentum[:, rows],
            velocities_of(self._engine, self._waiting) if self.with_steps else None,
            is_point[rows],
        )
        self._last = _last(points, points.times.size)
        self.done, self.reported = self.done + self._count, self.reported + numbers.size
        self._waiting, self._count = [], 0

    def _stop_at_infinity(self, points: Points, stops: Stops) -> None:
        """Stop scenes before their first step to numbers that are not finite."""
        every = np.concatenate([points.position, points.momentum], axis=2)
        finite = np.asarray(np.isfinite(every).all(axis=2))
        for scene in np.flatnonzero(self.live & ~finite.all(axis=1)).tolist():
            at = int(finite[scene].argmin())
            if scene not in stops or at < stops[scene][0]:
                failure = Failure.not_finite(points.done + at, float(points.times[at]))
                stops[scene] = (at, failure)

    def _end(
        self, scene: int, failure: Failure, count: int, rows: int, last: tuple[float, Array, Array]
    ) -> None:
        """Stop a scene after `count` more steps."""
        time, position, momentum = last
        self.failures[scene], self.live[scene] = failure, False
        self._endings[scene] = _Ending(
            self.done + count, rows, time, position[scene], momentum[scene]
        )

    def _keep(
        self,
        times: Array,
        sizes: Array,
        position: Array,
        momentum: Array,
        velocity: Array | None,
        is_point: np.ndarray,
    ) -> None:
        for name, one in zip("thxpv", (times, sizes, position, momentum, velocity), strict=True):
            if one is not None:
                self._rows[name].append(one)
        self._is_point.append(is_point)

    @property
    def _n_rows(self) -> int:
        return sum(one.size for one in self._is_point)

    # when they have ended

    def finish(self) -> None:
        """Note that all steps are done."""
        time, position, momentum = self._last
        rows = self._n_rows
        for scene in np.flatnonzero(self.live).tolist():
            self._endings[scene] = _Ending(
                done=self.done,
                rows=rows,
                time=time,
                position=position[scene],
                momentum=momentum[scene],
            )

    def points(self, scene: int) -> tuple[Array, Array, Array]:
        """Times, positions and momenta that are kept of a scene, including its last point."""
        end, kept = self._endings.get(scene), self._join_points()
        time, position, momentum = (
            self._join("t"),
            self._join("x")[scene],
            self._join("p")[scene],
        )
        rows = kept.size if end is None else end.rows
        if rows < kept.size or not kept.all():
            chosen = np.flatnonzero(kept[:rows])
            time, position, momentum = time[chosen], position[chosen], momentum[chosen]
        if end is not None and (not time.size or time[-1] != end.time):
            time = np.append(time, end.time)
            position = np.concatenate([position, end.position[None]])
            momentum = np.concatenate([momentum, end.momentum[None]])
        return time, position, momentum

    def steps(self, scene: int) -> RunSteps:
        """All steps of a scene as polynomials."""
        rows = self._endings[scene].rows
        tables, d = self._engine.tables, self._engine.scenes[0].dimension
        velocity = np.zeros((0, tables.points.size, d))
        if self._rows["v"]:
            velocity = self._join("v")[scene, : rows - 1]
        return RunSteps(
            tables=tables,
            time=self._join("t")[:rows],
            step_size=self._join("h")[1:rows],
            position=self._join("x")[scene, :rows],
            momentum=self._join("p")[scene, :rows],
            velocity=velocity,
        )

    def steps_done(self, scene: int) -> int:
        """Number of steps that a scene did."""
        end = self._endings.get(scene)
        return self.done if end is None else end.done

    def _join(self, name: str) -> Array:
        """Join pieces to one array, which replaces them, so that no value is stored twice."""
        pieces = self._rows[name]
        if len(pieces) > 1:
            pieces[:] = [np.concatenate(pieces, axis=0 if name in "th" else 1)]
        return pieces[0]

    def _join_points(self) -> np.ndarray:
        self._is_point = [np.concatenate(self._is_point)]
        return self._is_point[0]


def _last(points: Points, count: int) -> tuple[float, Array, Array]:
    """Time, positions and momenta at the end of `count` steps."""
    at = count - 1
    return float(points.times[at]), points.position[:, at].copy(), points.momentum[:, at].copy()
