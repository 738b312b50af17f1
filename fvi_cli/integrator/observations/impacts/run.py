r"""A motion with impacts: where it meets a surface its normal velocity is reversed and scaled.

At a falling root of g(q, t) the momentum changes by a push along the normal,

.. math:: p^+ = p^- - (1 + e) \frac{\dot g}{\nabla g^T M^{-1} \nabla g} \nabla g, \qquad
   \dot g = \nabla g \cdot v + \partial_t g,

so that :math:`\dot g^+ = -e\, \dot g^-` (Newton's law of restitution). The states of the damping
are kept: the force remembers the motion before. After an impact the position has the power
:math:`3 - \gamma` of the time, and steps are graded towards it as towards the start.
"""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fvi_cli.effects.diagnostics_request import NO_DIAGNOSTICS
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.state import State, Steps
from fvi_cli.integrator.meshes.adaptive import SHORTEST_STEP
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.impacts.bouncing import Bouncing
from fvi_cli.integrator.observations.impacts.surface import (
    Surface,
    is_rough_behind_impacts,
    start_objection,
)
from fvi_cli.integrator.observations.request import Impact
from fvi_cli.integrator.results.momenta import smooth_momenta
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.adaptive import MOST_SHORTEST
from fvi_cli.integrator.run.points import MeshSource
from fvi_cli.integrator.run.recorder import Recorder
from fvi_cli.integrator.run.scenes_run import ScenesRun, trajectory_of
from fvi_cli.integrator.trajectory import Trajectory
from fvi_cli.mathematics.arrays import Array


def integrate_with_impacts(
    scene: Scene,
    method: Method,
    n_steps: int,
    impacts: Mapping[str, Impact],
    *,
    coordinates: Sequence[str],
    parameters: Mapping[str, float],
) -> tuple[Trajectory, dict[str, Array]]:
    """Integrate a scene with surfaces that it bounces off, by a Runge-Kutta method.

    Steps are T / N long, and shorter after the start, break points and impacts.

    All ends of steps are reported; the times of the impacts are returned by name. Endless rebounds
    end the run at the time to which they converge, with a remark.

    Raises
    ------
    ValueError
        For a start behind a surface, or on it and moving through it.
    """
    began = clock.perf_counter()
    surfaces = {
        name: Surface(impact=one, coordinates=coordinates, parameters=parameters)
        for name, one in impacts.items()
    }
    for name, surface in surfaces.items():
        if objection := start_objection(scene, surface):
            raise ValueError(f"impacts.{name}: {surface.impact.when.text} {objection}")
    engine = _engine(scene, method)
    source = Bouncing(scene, method, n_steps, surfaces)
    this = ScenesRun(engine, source, Recorder(engine, with_steps=True))
    this.begin()
    ready = clock.perf_counter()
    seconds = this.march()
    steps = this.recorder.steps(0)
    momentum, jump = steps.momentum.copy(), np.array(source.jumps[: steps.n_steps + 1])
    for point, push in source.late.items():
        # the run may have stopped before the push
        momentum[point : point + 1] += push
    steps = replace(steps, momentum=momentum, jump=jump if jump.any() else None)
    if is_rough_behind_impacts(scene):
        momentum = smooth_momenta(steps, scene.momentum, scene.break_points)
        steps = replace(steps, momentum=momentum)
    this.remarks = (source.rest,) if source.rest else ()
    trajectory = trajectory_of(
        this,
        0,
        1,
        NO_DIAGNOSTICS,
        with_steps=True,
        seconds=(ready - began, seconds),
        bounced=steps,
        n_steps=n_steps,
    )
    return trajectory, {name: np.array(times) for name, times in source.times.items()}


def replayed(scene: Scene, method: Method, steps: RunSteps) -> RunSteps | None:
    """The steps of a run with impacts by another method: the same sizes and pushes."""
    engine = _engine(scene, method)
    jumps = np.zeros_like(steps.momentum) if steps.jump is None else steps.jump
    source = _Replay(scene, steps, jumps)
    this = ScenesRun(engine, source, Recorder(engine, with_steps=True))
    this.begin()
    this.march()
    if this.recorder.failures:
        return None
    return replace(this.recorder.steps(0), jump=jumps)


class _Replay(MeshSource):
    """The steps of another run, with the same pushes."""

    def __init__(self, scene: Scene, steps: RunSteps, jumps: Array) -> None:
        pushed = np.flatnonzero(jumps.any(axis=1)).tolist()
        self._pushes = {float(steps.time[k]): jumps[k] for k in pushed}
        super().__init__(steps.mesh((*scene.break_points, *self._pushes)))

    def judge(self, engine: Engine, state: State, steps: Steps) -> float:
        """The time at the end of a step; adds the push there."""
        end = self.accept(steps.count)
        if (push := self._pushes.get(end)) is not None:
            steps.dp = steps.dp + engine.member_forces([push])[:, None]
        return end


def _engine(scene: Scene, method: Method) -> Engine:
    """Single steps of any size, by a Runge-Kutta method."""
    if not method.is_runge_kutta:
        raise ValueError(f"mesh: {method.cq} takes equal steps only; use rk: gauss")
    shortest = SHORTEST_STEP * scene.final_time
    return Engine([scene], method, shortest_step=shortest, steps=MOST_SHORTEST, most=1)
