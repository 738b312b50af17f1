"""Steps that are found on the way: the local error decides on their lengths."""

from __future__ import annotations

import math

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.failure import Failure, StepFailedError
from fvi_cli.integrator.meshes.controller import AdaptiveSteps, StepController
from fvi_cli.integrator.meshes.forces import StepPath
from fvi_cli.integrator.meshes.local_error import LocalError
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.sources import Proposal, why_unsolved
from fvi_cli.integrator.tables import step_tables
from fvi_cli.mathematics.arrays import Array

UNKEPT = "the local error cannot be kept"


def step_controller(scene: Scene, method: Method, steps: AdaptiveSteps) -> StepController:
    """Sizes of the steps of a run.

    Raises
    ------
    ValueError
        If the method is no Gauss method of degree 2 or more.
    """
    if method.cq != "gauss" or method.degree < 2:
        raise ValueError(
            f"mesh: adaptive steps are for Gauss methods of degree 2 and more, not "
            f"for {method.label}"
        )
    return StepController(steps, scene, method.degree)


class AdaptiveSource:
    """Single steps of one scene; those whose local error is too large are rejected."""

    def __init__(self, scene: Scene, method: Method, steps: AdaptiveSteps) -> None:
        self.controller = step_controller(scene, method, steps)
        self._local_error = LocalError(scene, step_tables(method), steps.may_miss)
        self._most_steps = steps.most_steps
        self.failure: Failure | None = None
        self._done = 0
        self._error = StepFailedError(UNKEPT)

    def propose(self) -> Proposal | None:
        """The next step to try."""
        controller = self.controller
        if controller.is_finished:
            return None
        begin, error = controller.time, self._error
        if self._done >= self._most_steps:
            error = StepFailedError("the largest number of steps is reached", reason="most steps")
        if controller.is_stuck or self._done >= self._most_steps:
            self.failure = Failure.in_step(self._done, begin, error)
            return None
        h, is_fresh = controller.propose(), controller.is_fresh
        return Proposal(begin, h, n_steps=1, total=1, is_fresh=is_fresh, origin=begin)

    def judge(self, engine: Engine, state: State, steps: Steps) -> float | None:
        """The end of a step that keeps the local tolerance; None rejects it."""
        controller, h = self.controller, steps.h
        position = engine.scene_positions(state.x[:, None])[0, 0]
        unknowns = engine.scene_positions(steps.unknowns[:, 0])[0]
        scale, error = _largest(position), math.inf
        if steps.failed.any():
            self._error = why_unsolved(steps, state)
        else:
            self._error = StepFailedError(UNKEPT)
            scale += h * _largest(unknowns)
            path = StepPath(begin=controller.time, size=h, position=position, unknowns=unknowns)
            error = self._local_error.of(
                path, controller.tolerance_for(scale), is_fresh=controller.is_fresh
            )
        if not controller.judge(h, error, scale):
            return None
        self._done += 1
        return controller.time


def _largest(values: Array) -> float:
    """Largest absolute value; zero if it is not finite."""
    found = float(np.maximum.reduce(np.abs(values), axis=None))
    return found if math.isfinite(found) else 0.0
