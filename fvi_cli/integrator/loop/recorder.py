"""What is kept of the scenes of an engine while their steps go on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from fvi_cli.integrator.advance import advanced
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.newton_log import NewtonLog
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure, StepFailedError, no_unique_solution
from fvi_cli.integrator.loop.source import Proposal
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.mathematics.arrays import Array

WAITING = 256
"""Steps whose points are brought into the coordinates of their scenes and checked together."""

Stops = dict[int, tuple[int, Failure]]
"""For some scenes how many of successive steps are kept, and why they stop there."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Successive steps of all scenes.

    Parameters
    ----------
    done
        Steps of the run before them.
    times, sizes
        Ends of the steps and their lengths, shape ``(n,)``.
    position, momentum
        At the ends, shape ``(scenes, n, d)``.
    before
        Position where they begin, shape ``(scenes, d)``.
    unknowns
        Polynomials of scenes that are not linear, ``(scenes, n, s, d)``.
    """

    done: int
    times: Array
    sizes: Array
    position: Array
    momentum: Array
    before: Array
    unknowns: Array | None


class Check(Protocol):
    """What tells that runs cannot be right from some step on."""

    def __call__(self, points: Points, live: Sequence[int], stops: Stops) -> None:
        """Stop scenes among `live` at the first step that is wrong, where that is earlier."""


@dataclass(frozen=True, eq=False)
class _Ending:
    """Where a scene stopped: steps that it did, rows that are kept, and its last point."""

    done: int
    rows: int
    time: float
    position: Array
    momentum: Array


_Block = tuple[Proposal, float, Array, Array, Array | None, Array | None]


def step_failure(steps: Steps, member: int, state: State) -> tuple[int, StepFailedError]:
    """Which of successive steps has no solution for a member, and why."""
    attempt, place = next(
        (one, int(places[0]))
        for one in reversed(steps.attempts)
        if (places := np.flatnonzero((one.members == member) & (one.iterations > 0))).size
    )
    changes, position = attempt.of_member(place), state.x[member]
    if attempt.first:
        position = position + steps.dx[member, attempt.first - 1]
    near = "[" + ", ".join(f"{value:.4g}" for value in position) + "]"
    if not np.isfinite(changes[-1]):
        words = (
            "the force is not finite (no real number, or a division by zero) near "
            f"q = {near}; take a smaller step if the motion itself stays away from there"
        )
    else:
        words = (
            f"Newton's iteration did not converge in {len(changes)} iterations (changes "
            f"{changes[0]:.1e} .. {changes[-1]:.1e}); take a smaller step, or see whether the "
            f"mass matrix is singular near q = {near}"
        )
    return attempt.first, StepFailedError(words, changes)


def why_unsolved(steps: Steps, state: State) -> StepFailedError:
    """Why a step of one scene that begins at `state` has no solution."""
    if not steps.attempts:
        return no_unique_solution(steps.h)
    return step_failure(steps, int(np.flatnonzero(steps.failed)[0]), state)[1]


class Recorder:
    """Reported points of all scenes, thinned, and where wanted all steps as polynomials.

    Parameters
    ----------
    engine
        Whose steps they are.
    every
        Keep every n-th reported point, the first and the last.
    with_steps
        Keep all points of the mesh and the polynomials of all steps.
    n_reported
        Number of points of the whole run, by which its progress is reported.
    check
        What stops runs that cannot be right, beside numbers that are not finite.

    Attributes
    ----------
    done, reported
        Steps and reported points so far, without the start.
    live
        Scenes that go on, shape ``(scenes,)``.
    failures
        Why others stopped, by the number of the scene.
    """

    def __init__(
        self,
        engine: Engine,
        *,
        every: int = 1,
        with_steps: bool = False,
        n_reported: int | None = None,
        check: Check | None = None,
    ) -> None:
        self._engine, self._every, self._check = engine, every, check
        self._n_reported = n_reported
        self.with_steps = with_steps
        self.done = self.reported = self._begun = 0
        self.live = np.ones(len(engine.scenes), dtype=bool)
        self.failures: dict[int, Failure] = {}
        self.newton = NewtonLog(len(engine.scenes))
        self._endings: dict[int, _Ending] = {}
        self._rows: dict[str, list[Array]] = {name: [] for name in ("t", "h", "x", "p", "v")}
        self._is_point: list[np.ndarray] = []
        self._last: tuple[float, Array, Array] = (0.0, np.zeros(0), np.zeros(0))
        self._waiting: list[_Block] = []
        self._count = self._waiting_points = 0
        self._stops: Stops = {}

    # while steps go on

    def begin(self, time: float, position: Array, momentum: Array) -> None:
        """The start of the run, both ``(scenes, d)``."""
        at = np.array([time])
        self._keep(at, at, position[:, None], momentum[:, None], None, np.ones(1, dtype=bool))
        self._last = (time, position, momentum)

    def note(self, state: State, steps: Steps) -> None:
        """How the iteration for the next steps went; the state is that before them."""
        first = self.reached
        self.newton.add(first, steps.attempts)
        if not steps.failed.any():
            return
        for member in np.flatnonzero(steps.failed & state.live).tolist():
            scene = member // self._engine.width
            if not self.live[scene] or scene in self._stops:
                continue
            if not steps.attempts:
                error = no_unique_solution(steps.h)
                failure = Failure(str(error), error.reason, first, state.t)
                self._stops[scene] = (self._count, failure)
                continue
            before, error = step_failure(steps, member, state)
            failure = Failure.in_step(first + before, state.t + before * steps.h, error)
            self._stops[scene] = (self._count + before, failure)

    def add(
        self,
        asked: Proposal,
        end: float,
        position: Array,
        momentum: Array,
        inputs: Array | None,
        unknowns: Array | None = None,
    ) -> None:
        """The next steps.

        Parameters
        ----------
        asked
            Where they begin.
        end
            The time at the end of the last.
        position, momentum
            Of the members at their ends, shape ``(q, n, e)``.
        inputs, unknowns
            What drives the memory, ``(q, n, i, e)``, where polynomials are kept, and U,
            ``(q, n, s, e)``, where scenes are not linear.
        """
        if self._n_reported is not None:
            advanced(self.reported + self._waiting_points, self._n_reported)
        self._waiting.append((asked, end, position, momentum, inputs, unknowns))
        n, every = position.shape[1], asked.reported_every
        self._count += n
        if every:
            self._waiting_points += (asked.first + n) // every - asked.first // every

    def stop(self, failure: Failure) -> None:
        """No scene has a next step."""
        for scene in np.flatnonzero(self.live).tolist():
            self._stops.setdefault(scene, (self._count, failure))

    @property
    def reached(self) -> int:
        """Steps so far, those among them that wait to be checked."""
        return self.done + self._count

    @property
    def is_full(self) -> bool:
        """Whether it is time to :meth:`flush`."""
        return self._count >= WAITING or bool(self._stops)

    def flush(self, state: State) -> None:
        """Check and keep what was added; members of scenes that stop here rest from now on."""
        if not self._waiting:
            return
        points, reported = self._points()
        stops, self._stops = self._stops, {}
        every = np.concatenate([points.position, points.momentum], axis=2)
        finite = np.asarray(np.isfinite(every).all(axis=2))
        for scene in np.flatnonzero(self.live & ~finite.all(axis=1)).tolist():
            at = int(finite[scene].argmin())
            if scene not in stops or at < stops[scene][0]:
                failure = Failure.not_finite(points.done + at, float(points.times[at]))
                stops[scene] = (at + 1, failure)
        live = np.flatnonzero(self.live).tolist()
        if self._check is not None:
            self._check(points, live, stops)
        numbers = self.reported + 1 + np.arange(np.count_nonzero(reported))
        is_point = reported.copy()
        is_point[reported] = numbers % self._every == 0
        rows = np.arange(points.times.size) if self.with_steps else np.flatnonzero(is_point)
        for scene, (count, failure) in stops.items():
            self.failures[scene], self.live[scene] = failure, False
            time, position, momentum = self._last
            if count:
                time = float(points.times[count - 1])
                position = points.position[:, count - 1]
                momentum = points.momentum[:, count - 1]
            self._endings[scene] = _Ending(
                done=self.done + count,
                rows=self._n_rows + int(np.count_nonzero(rows < count)),
                time=time,
                position=position[scene].copy(),
                momentum=momentum[scene].copy(),
            )
        if stops:
            state.live = state.live & np.repeat(self.live, self._engine.width)
        self._keep(
            points.times[rows],
            points.sizes[rows],
            points.position[:, rows],
            points.momentum[:, rows],
            self._velocity() if self.with_steps else None,
            is_point[rows],
        )
        self._last = (
            float(points.times[-1]),
            points.position[:, -1].copy(),
            points.momentum[:, -1].copy(),
        )
        self.done, self.reported = self.done + self._count, self.reported + numbers.size
        self._waiting, self._count, self._waiting_points = [], 0, 0

    def _points(self) -> tuple[Points, np.ndarray]:
        """What waits, in the coordinates of the scenes, and which points are reported."""
        engine = self._engine
        asked, ends, position, momentum, _, unknowns = zip(*self._waiting, strict=True)
        counts = [one.shape[1] for one in position]
        repeated = np.repeat(np.arange(len(counts)), counts)
        last = np.cumsum(counts) - 1
        number = np.arange(repeated.size) - np.append(0, last[:-1] + 1)[repeated] + 1
        number += np.array([one.first for one in asked])[repeated]
        sizes = np.array([one.h for one in asked])[repeated]
        times = np.array([one.origin for one in asked])[repeated] + sizes * number
        times[last] = ends
        every = np.array([one.reported_every for one in asked])[repeated]
        x, p = engine.to_scene(np.concatenate(position, axis=1), np.concatenate(momentum, axis=1))
        found = Points(
            done=self.done,
            times=times,
            sizes=sizes,
            position=x,
            momentum=p,
            before=self._last[1],
            unknowns=None if engine.law.is_linear else np.concatenate(unknowns, axis=1),
        )
        return found, (every > 0) & (number % np.maximum(every, 1) == 0)

    def _velocity(self) -> Array:
        """Velocities at the stages of the steps that wait, shape ``(scenes, n, r, d)``."""
        engine, scenes = self._engine, len(self._engine.scenes)
        r, d = engine.tables.points.size, engine.scenes[0].dimension
        inputs = [one[4] for one in self._waiting if one[4] is not None]
        velocity = np.concatenate(inputs, axis=1)
        if not engine.method.is_runge_kutta:
            velocity = np.matmul(engine.tables.slopes[1:].T, velocity)
        q, n = velocity.shape[:2]
        return engine.scene_positions(velocity.reshape(q, n * r, -1)).reshape(scenes, n, r, d)

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
        """All steps are done."""
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
        """Times, positions and momenta that are kept of a scene, its last point among them."""
        end, kept = self._endings.get(scene), self._joined_points()
        time, position, momentum = (
            self._joined("t"),
            self._joined("x")[scene],
            self._joined("p")[scene],
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
            velocity = self._joined("v")[scene, : rows - 1]
        return RunSteps(
            tables=tables,
            time=self._joined("t")[:rows],
            step_size=self._joined("h")[1:rows],
            position=self._joined("x")[scene, :rows],
            momentum=self._joined("p")[scene, :rows],
            velocity=velocity,
        )

    def steps_done(self, scene: int) -> int:
        """Number of steps that a scene did."""
        end = self._endings.get(scene)
        return (self.done if end is None else end.done) - self._begun

    # behind a checkpoint

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything that is kept so far, by name."""
        found: dict[str, NDArray[Any]] = {
            **{name: self._joined(name) for name, pieces in self._rows.items() if pieces},
            **{f"newton {name}": one for name, one in self.newton.arrays().items()},
            "is point": self._joined_points(),
            "last time": np.array(self._last[0]),
            "last position": self._last[1],
            "last momentum": self._last[2],
            "done": np.array([self.done, self.reported]),
        }
        stopped = sorted(self.failures)
        failures = [self.failures[scene] for scene in stopped]
        ends = [self._endings[scene] for scene in stopped]
        if stopped:
            found |= {
                "stopped": np.array(
                    [(k, end.done, end.rows) for k, end in zip(stopped, ends, strict=True)]
                ),
                "stopped points": np.array([(e.position, e.momentum) for e in ends]),
                "stopped times": np.array(
                    [(e.time, f.time) for e, f in zip(ends, failures, strict=True)], dtype=float
                ),
                "stopped words": np.array([(f.words, f.reason) for f in failures]),
                "stopped steps": np.array([-1 if f.step is None else f.step for f in failures]),
            }
        return found

    def restore(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Go on from what :meth:`arrays` gave; KeyError where something of it is missing."""
        # no polynomials where they are not kept
        names = [name for name in self._rows if name != "v" or self.with_steps]
        rows = {name: [arrays[name]] for name in names}
        newton = NewtonLog(self.live.size)
        newton.restore({name.removeprefix("newton "): one for name, one in arrays.items()})
        last = (float(arrays["last time"]), arrays["last position"], arrays["last momentum"])
        is_point, (done, reported) = arrays["is point"], arrays["done"].tolist()
        stopped = self._stopped(arrays) if "stopped" in arrays else {}
        self._rows |= rows
        self._is_point, self.newton, self._last = [is_point], newton, last
        self.done, self.reported = done, reported
        for scene, (failure, end) in stopped.items():
            self.live[scene] = False
            self.failures[scene], self._endings[scene] = failure, end

    def _stopped(self, arrays: Mapping[str, NDArray[Any]]) -> dict[int, tuple[Failure, _Ending]]:
        rows = zip(
            *(arrays[f"stopped{name}"].tolist() for name in ("", " times", " words", " steps")),
            arrays["stopped points"],
            strict=True,
        )
        found = {}
        for (scene, done, kept), (time, begin), (words, reason), step, point in rows:
            failure = Failure(words, reason, None if step < 0 else step, begin)
            position, momentum = point
            found[scene] = failure, _Ending(done, kept, time, position, momentum)
        return found

    def go_on(self, state: State, done: int, reported: int) -> None:
        """Begin behind so many steps and reported points of the run, without a start."""
        position, momentum = self._engine.to_scene(state.x[:, None], state.p[:, None])
        self._last = (state.t, position[:, 0], momentum[:, 0])
        self.done, self.reported, self._begun = done, reported, done

    def _joined(self, name: str) -> Array:
        """Pieces as one array, which takes their place: nothing is there twice."""
        pieces = self._rows[name]
        if len(pieces) > 1:
            pieces[:] = [np.concatenate(pieces, axis=0 if name in "th" else 1)]
        return pieces[0]

    def _joined_points(self) -> np.ndarray:
        self._is_point = [np.concatenate(self._is_point)]
        return self._is_point[0]
