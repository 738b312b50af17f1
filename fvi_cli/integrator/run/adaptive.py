"""Steps that are found on the way: the local error decides on their lengths."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import why_unsolved
from fvi_cli.integrator.meshes.controller import AdaptiveSteps, first_step, shortest_step
from fvi_cli.integrator.meshes.local_error import LocalError
from fvi_cli.integrator.meshes.mesh import Stretch
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import Source
from fvi_cli.integrator.tables import step_tables

STEPS_PER_OCTAVE = 4
"""Step sizes are powers of the fourth root of 2, so that the tables of a size are used again."""
SAFETY, SHRINKAGE, GROWTH = 0.9, 0.2, 32.0
"""The next size is 0.9 of the one that the estimate allows, 0.2 to 32 times the last one.

Five small problems at four tolerances take 465 steps, rejected ones included; safety .8 to .95 and
growth 8 to 1,000 take 463 to 513."""
ROUND_OFF = 1e-14
"""Relative to the position; no step is rejected for a smaller error."""


class AdaptiveSource(Source):
    """Single steps of one scene; those whose local error is too large are rejected.

    Break points are points of the mesh; a motion that is singular begins like a fractional power
    of t there, and at 0. So are samples of the force, where it is continuous.
    """

    def __init__(self, scene: Scene, method: Method, steps: AdaptiveSteps) -> None:
        self._asked, self._exponent = steps, 1.0 / (method.degree + 1)
        self._local_error = LocalError(scene, step_tables(method), steps.may_miss)
        self._final_time = final_time = scene.final_time
        self._breaks = {*scene.break_points, final_time}
        samples = () if scene.forcing is None else scene.forcing.samples
        knots = {float(t) for one in samples for t in one.knots if 0.0 < t < final_time}
        self._ends = sorted(self._breaks | knots)
        self._first, self._shortest = first_step(scene), shortest_step(scene)
        self._size = self._intended = self._first
        # where the next step begins, and whether that is the start or a break point
        self._time, self._is_fresh = 0.0, True

    def propose(self, engine: Engine, state: State) -> Stretch | None:
        """The next step to try."""
        if self._ends and self.n_steps >= self._asked.most_steps:
            self._fail("the largest number of steps is reached")
        if self.failure or not self._ends:
            return None
        begin, left = self._time, self._ends[0] - self._time
        octaves = math.log2(min(self._size, self._asked.max_step) / self._final_time)
        octaves = math.floor(STEPS_PER_OCTAVE * octaves) / STEPS_PER_OCTAVE
        h = self._intended = self._final_time * 2.0**octaves
        h = left if h >= left * (1 - 1e-12) else min(h, 0.5 * left)
        end = self._ends[0] if h == left else begin + h
        return Stretch(begin=begin, end=end, n_steps=1, step_size=h, is_fresh=self._is_fresh)

    def accepts(self, engine: Engine, state: State, steps: Steps) -> bool:
        """Whether a step keeps the local tolerance, or has the shortest size and is solved."""
        h, why = steps.h, "the local error cannot be kept"
        path = self.path(engine, state, steps)
        scale = float(np.abs(path.position).max() + h * np.abs(path.unknowns).max())
        tolerance, error = max(self._asked.tolerance, ROUND_OFF * scale), math.inf
        if steps.failed.any():
            why = why_unsolved(steps, state)
        else:
            error = self._local_error.of(path, tolerance, is_fresh=self._is_fresh)
        is_solved = math.isfinite(error)
        factor = (tolerance / max(error, 1e-300)) ** self._exponent if is_solved else 0.0
        self._size = h * min(GROWTH, max(SHRINKAGE, SAFETY * factor))
        if not is_solved or (error > tolerance and h > self._shortest):
            if h <= self._shortest:
                self._fail(why)
            self._size = max(self._size, self._shortest)
            return False
        self.n_steps, self._is_fresh = self.n_steps + 1, False
        if h < self._ends[0] - self._time:
            self._time += h
            return True
        # a step that was cut short at a point says little about the size that is possible
        self._size = max(self._size, self._intended)
        self._time = self._ends.pop(0)
        if self._time in self._breaks:
            self._is_fresh, self._size = True, self._first
        return True

    def _fail(self, why: str) -> None:
        self.failure = f"step {self.n_steps}, t = {self._time:.6g}: {why}"
