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
from fvi_cli.integrator.meshes.controller import MOST_SHORTEST, SHORTEST_STEP
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.impacts.bouncing import Bouncing
from fvi_cli.integrator.observations.impacts.surface import (
    Surface,
    start_objection,
)
from fvi_cli.integrator.observations.request import Impact
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
) -> tuple[Trajectory, dict[str, Array], str]:
    """Integrate a scene with surfaces that it bounces off, by a Runge-Kutta method.

    Steps are T / N long, and shorter after the start, break points and impacts.

    All ends of steps are reported; the times of the impacts are returned by name, and the surface
    on which the motion came to rest, with a remark: there the run ends.

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
    if jump.any() and scene.acts_above_order_1:
        steps = replace(steps, momentum=steps.momenta_of_polynomials(scene))
    if source.rests_on:
        this.remarks = (f"at rest from t = {steps.time[-1]:.10g}",)
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
    times = {name: np.array(times) for name, times in source.times.items()}
    return trajectory, times, source.rests_on


def _engine(scene: Scene, method: Method) -> Engine:
    """Single steps of any size, by a Runge-Kutta method."""
    if not method.is_runge_kutta:
        raise ValueError(f"mesh: {method.cq} takes equal steps only; use rk: gauss")
    shortest = SHORTEST_STEP * scene.final_time
    return Engine([scene], method, shortest_step=shortest, steps=MOST_SHORTEST, most=1)
