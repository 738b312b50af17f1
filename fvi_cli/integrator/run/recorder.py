"""Points and steps of the scenes of an engine that are kept during a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import not_finite, why_unsolved
from fvi_cli.integrator.meshes.mesh import Stretch
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.mathematics.arrays import Array

WAITING = 256
"""Steps whose points are converted to the coordinates of their scenes together."""


class Solved(NamedTuple):
    """Equal steps of the members of an engine."""

    stretch: Stretch
    first: int  # steps of the stretch before them
    position: Array  # at their ends, (q, n, e)
    momentum: Array
    unknowns: Array | None  # U, (q, n, s, e), where polynomials are kept


class _Points(NamedTuple):
    """Successive points of all scenes, one behind every step."""

    time: Array  # (n,)
    position: Array  # (scenes, n, d)
    momentum: Array
    size: Array  # length of the step before it, (n,)


class Recorder:
    """Points of all scenes, and on request the polynomials of all steps.

    Runs stop where numbers cease to be finite; `failures` says why, by the number of the scene.
    """

    def __init__(self, engine: Engine, *, with_steps: bool = False) -> None:
        self._engine, self.with_steps = engine, with_steps
        self.failures: dict[int, str] = {}
        self._done = self._count = 0
        self._iterations = np.zeros(engine.q, dtype=np.int64)
        starts = [(one.initial_position, one.initial_velocity) for one in engine.scenes]
        x = np.array([[position] for position, _ in starts])
        p = np.array(
            [[one.momentum(*own, 0.0)] for one, own in zip(engine.scenes, starts, strict=True)]
        )
        # columns in pieces
        self._pieces: list[list[Any]] = [[one] for one in _Points(np.zeros(1), x, p, np.zeros(1))]
        self._columns: list[Any] = []
        self._velocity: list[Array] = []
        self._waiting: list[Solved] = []
        self._ends: dict[int, int] = {}  # numbers of steps of scenes that have stopped

    def count(self, steps: Steps) -> None:
        """Count the iterations of steps, also of such as are rejected."""
        self._iterations = self._iterations + steps.iterations

    def note(self, state: State, steps: Steps) -> None:
        """Stop the scenes that fail in the next steps; the state is that before them."""
        if not np.count_nonzero(steps.failed):
            return
        for member in np.flatnonzero(steps.failed & state.live).tolist():
            step, why = self._done + self._count, why_unsolved(steps, state, member)
            words = f"step {step}, t = {state.t:.6g}: {why}"
            self._stop(state, member // self._engine.width, step, words)

    def _stop(self, state: State, scene: int, end: int, why: str) -> None:
        """Stop a scene after so many steps, if it goes on there; its members are solved no more."""
        if end < self._ends.get(scene, math.inf):
            self.failures[scene], self._ends[scene] = why, end
            state.live = state.live & (np.arange(state.live.size) // self._engine.width != scene)

    def add(self, solved: Solved) -> None:
        """Add the next steps."""
        self._waiting.append(solved)
        self._count += solved.position.shape[1]

    @property
    def is_over(self) -> bool:
        """Whether all scenes have stopped."""
        return len(self.failures) == len(self._engine.scenes)

    @property
    def is_full(self) -> bool:
        """Whether enough steps wait for :meth:`flush`."""
        return self._count >= WAITING

    def flush(self, state: State) -> None:
        """Keep the added steps."""
        if not self._waiting:
            return
        added = self._joined()
        # a sum is finite only if all terms are
        if not np.isfinite(added.position.sum() + added.momentum.sum()):
            self._stop_at_infinity(state, added)
        if self.with_steps:
            self._velocity.append(self._velocities())
        for pieces, piece in zip(self._pieces, added, strict=True):
            pieces.append(piece)
        self._done, self._count, self._waiting = self._done + self._count, 0, []

    def finish(self, state: State, failure: str) -> None:
        """Note that there are no more steps, where `failure` says so since all scenes stop."""
        self.flush(state)
        for scene in range(len(self._engine.scenes)) if failure else ():
            self._stop(state, scene, self._done, failure)
        # pieces of a column are freed when they are joined
        for axis in (0, 1, 1, 0):
            self._columns.append(_join(self._pieces.pop(0), axis))
        scenes, _, d = self._columns[1].shape
        none = np.zeros((scenes, 0, self._engine.tables.points.size, d))
        self._velocity = [_join(self._velocity or [none], 1)]

    def _joined(self) -> _Points:
        """The waiting steps in the coordinates of the scenes."""
        stretches, firsts, position, momentum, _ = zip(*self._waiting, strict=True)
        counts = np.array([one.shape[1] for one in position])
        done, last = np.array(firsts) + counts, np.cumsum(counts) - 1
        # numbers of the steps in their stretches, from 1
        number = np.arange(self._count) + np.repeat(done - last, counts)
        sizes = np.repeat([one.step_size for one in stretches], counts)
        times = np.repeat([one.begin for one in stretches], counts) + sizes * number
        ends = zip(stretches, done.tolist(), strict=True)
        times[last] = [one.time_after(count) for one, count in ends]
        x, p = self._engine.to_scene(_join(position, 1), _join(momentum, 1))
        return _Points(times, x, p, sizes)

    def _velocities(self) -> Array:
        """Velocities at the stages of the waiting steps, shape ``(scenes, n, r, d)``."""
        unknowns = _join([one.unknowns for one in self._waiting if one.unknowns is not None], 1)
        velocity = np.matmul(self._engine.tables.slopes[1:].T, unknowns)
        q, n, r, _ = velocity.shape
        of_scenes = self._engine.scene_positions(velocity.reshape(q, n * r, -1))
        return of_scenes.reshape(len(self._engine.scenes), n, r, -1)

    def _stop_at_infinity(self, state: State, added: _Points) -> None:
        """Stop scenes before their first step to numbers that are not finite."""
        both = np.concatenate([added.position, added.momentum], axis=2)
        finite = np.asarray(np.isfinite(both).all(axis=2))
        for scene in np.flatnonzero(~finite.all(axis=1)).tolist():
            at = int(finite[scene].argmin())
            end, why = self._done + at, not_finite(self._done + at, float(added.time[at]))
            self._stop(state, scene, end, why)

    # the following is for runs whose steps are all done

    def steps(self, scene: int) -> RunSteps:
        """All steps of a scene; as polynomials only if these were asked for."""
        count = self._ends.get(scene, self._done)
        time, position, momentum, size = self._columns
        return RunSteps(
            tables=self._engine.tables,
            time=time[: count + 1],
            step_size=size[1 : count + 1],
            position=position[scene, : count + 1],
            momentum=momentum[scene, : count + 1],
            velocity=self._velocity[0][scene, :count],
        )

    def iterations_of(self, scene: int) -> int:
        """Iterations of Newton in all steps of a scene, also in rejected ones."""
        return int(self._iterations[scene * self._engine.width])


def _join(pieces: Sequence[Any], axis: int) -> Any:
    return np.concatenate(pieces, axis=axis) if len(pieces) > 1 else pieces[0]
