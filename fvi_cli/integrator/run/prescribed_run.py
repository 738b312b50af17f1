"""Runs whose motion is given: steps through a displacement, on which dampers act as on others.

Velocities at the stages are those of the displacement; steps are cut at its knots, and graded
behind the start and behind kinks, where the memory of a rate that jumps begins like a fractional
power of the time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.adaptive import AdaptiveSteps
from fvi_cli.integrator.meshes.graded_start import graded_start_mesh
from fvi_cli.integrator.meshes.mesh import Mesh, Stretch, uniform_mesh
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import AnySteps
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.trajectory import Trajectory, thinned
from fvi_cli.mathematics.arrays import Array

START_POWER = 0.5
"""Grading behind a kink: so that every step is a fixed part of its distance, measured in
tests/integrator/run/test_prescribed_run.py."""
BEHIND_KINKS = 1e-6
"""Tolerances relative to the range of the displacement below which steps are graded: equal ones of
eight stages err by up to 3e-5 of the force a step behind a kink, measured there too. Fits hold
coarse runs against fine ones."""
FEWEST, MOST = 64, 2**14
"""Steps of a displacement whose polynomials are to be resolved."""


def integrate_prescribed(
    scene: Scene,
    motion: PrescribedMotion,
    method: AnyMethod,
    steps: AnySteps,
    *,
    every: int = 1,
    with_steps: bool = False,
) -> Trajectory:
    """The run of a scene whose motion is given.

    Raises
    ------
    ValueError
        For methods that are not of Runge-Kutta.
    """
    if not isinstance(method, Method) or not method.is_runge_kutta:
        raise ValueError(
            f"method: {method.case} is not for a given displacement; take rk: gauss, such as gauss3"
        )
    motion = replace(motion, final_time=scene.final_time)
    mesh = prescribed_mesh(motion, method, steps)
    found = prescribed_steps(motion, method, mesh)
    kept = np.concatenate([[True], *(_reported(one) for one in mesh.stretches)])
    trajectory = Trajectory(
        time=found.time[kept],
        position=found.position[kept],
        n_steps=mesh.n_reported,
        step_size=scene.final_time / mesh.n_reported,
        steps=found if with_steps else None,
    )
    return thinned(trajectory, every)


def _reported(stretch: Stretch) -> Array:
    count, every = stretch.n_steps, stretch.reported_every
    if not every:
        return np.zeros(count, dtype=bool)
    return np.asarray(np.arange(1, count + 1) % every == 0)


def prescribed_mesh(motion: PrescribedMotion, method: Method, steps: AnySteps) -> Mesh:
    """The mesh of a displacement; for a tolerance as many steps as its polynomials need."""
    if isinstance(steps, Mesh):
        return steps
    if isinstance(steps, AdaptiveSteps):
        parts = len(motion.break_points) + 1
        count = FEWEST if parts == 1 else parts
        mesh = uniform_mesh(motion.final_time, count, motion.break_points)
        found = prescribed_steps(motion, method, mesh)
        while _unresolved(found) > steps.tolerance and count < MOST:
            count *= 2
            mesh = uniform_mesh(motion.final_time, count, motion.break_points)
            found = prescribed_steps(motion, method, mesh)
        if steps.tolerance >= BEHIND_KINKS * float(np.ptp(found.position)):
            return mesh
        return _graded(motion, method, count)
    count = max(steps, len(motion.break_points) + 1)
    if method.start == "graded":
        return _graded(motion, method, count)
    return uniform_mesh(motion.final_time, count, motion.break_points)


def _graded(motion: PrescribedMotion, method: Method, n_steps: int) -> Mesh:
    sharp = bool(motion.kinks)
    return graded_start_mesh(
        motion.final_time,
        n_steps,
        motion.break_points,
        stages=method.degree,
        exponent=lambda at_start: START_POWER if at_start or sharp else None,
    )


def _unresolved(steps: RunSteps) -> float:
    """Largest last coefficient of the rates on steps, as a displacement."""
    n, r, _ = steps.velocity.shape
    series = steps.tables.stages_to_series @ steps.velocity[..., 0].T
    return float(np.abs(series[-2:] * steps.step_size).max(initial=0.0)) if r > 1 and n else 0.0


def prescribed_steps(motion: PrescribedMotion, method: Method, mesh: Mesh) -> RunSteps:
    """Steps through a displacement, by its rates at the stages."""
    tables = step_tables(method)
    inside = [one.begin + one.step_size * np.arange(1, one.n_steps) for one in mesh.stretches]
    ends = [np.append(own, one.end) for own, one in zip(inside, mesh.stretches, strict=True)]
    time = np.concatenate([[0.0], *ends])
    sizes = np.concatenate([np.full(one.n_steps, one.step_size) for one in mesh.stretches])
    # by the step in which they lie: rounding of a time must not meet the piece beside it
    stages = np.clip(
        time[:-1, None] + sizes[:, None] * tables.points,
        np.nextafter(time[:-1], np.inf)[:, None],
        np.nextafter(time[1:], -np.inf)[:, None],
    )
    rate = motion.rate(time)
    return RunSteps(
        tables=tables,
        time=time,
        position=motion.displacement(time),
        momentum=rate,
        step_size=sizes,
        velocity=motion.rate(stages),
    )
