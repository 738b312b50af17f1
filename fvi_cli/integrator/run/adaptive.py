"""Steps that are found on the way: the local error decides on their lengths."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import why_unsolved
from fvi_cli.integrator.meshes.controller import AdaptiveSteps, StepController
from fvi_cli.integrator.meshes.forces import StepPath
from fvi_cli.integrator.meshes.local_error import LocalError
from fvi_cli.integrator.meshes.mesh import Stretch
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import Proposal
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array


class AdaptiveSource:
    """Single steps of one scene; those whose local error is too large are rejected."""

    def __init__(self, scene: Scene, method: Method, steps: AdaptiveSteps) -> None:
        self._controller = StepController(steps, scene, method.degree)
        self._local_error = LocalError(scene, step_tables(method), steps.may_miss)
        self._most_steps, self._last_rejection = steps.most_steps, ""
        self.n_steps, self.failure, self.rejected = 0, "", 0
        self.pushes: list[Array] = []

    def propose(self, engine: Engine, state: State) -> Proposal | None:
        """The next step to try."""
        controller = self._controller
        if controller.is_finished:
            return None
        begin, is_last = controller.time, self.n_steps >= self._most_steps
        if controller.is_stuck or is_last:
            why = "the largest number of steps is reached" if is_last else self._last_rejection
            self.failure = f"step {self.n_steps}, t = {begin:.6g}: {why}"
            return None
        h, is_fresh = controller.propose(), controller.is_fresh
        return Proposal(
            Stretch(begin=begin, end=begin + h, n_steps=1, step_size=h, is_fresh=is_fresh)
        )

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The end of a step that keeps the local tolerance; None rejects it."""
        controller, h = self._controller, steps.h
        position = engine.scene_positions(state.x[:, None])[0, 0]
        unknowns = engine.scene_positions(steps.unknowns[:, 0])[0]
        scale, error = _largest(position), math.inf
        self._last_rejection = "the local error cannot be kept"
        if steps.failed.any():
            self._last_rejection = str(why_unsolved(steps, state))
        else:
            scale += h * _largest(unknowns)
            path = StepPath(begin=controller.time, size=h, position=position, unknowns=unknowns)
            error = self._local_error.of(
                path, controller.tolerance_for(scale), is_fresh=controller.is_fresh
            )
        if not controller.judge(h, error, scale):
            self.rejected += 1
            return None
        self.n_steps += 1
        return controller.time


def _largest(values: Array) -> float:
    """Largest absolute value; zero if it is not finite: the scale of an error stays finite."""
    largest = float(np.maximum.reduce(np.abs(values), axis=None))
    return largest if math.isfinite(largest) else 0.0
