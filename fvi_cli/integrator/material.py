"""The response of material laws to a given displacement: steps on which the laws act as usual.

Velocities at the stages are those of the displacement; steps are cut at its knots, and graded
after the start and after kinks, where the memory of a rate that jumps begins like a fractional
power of the time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.effects.prescribed import PrescribedMotion
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.meshes.controller import AdaptiveSteps
from fvi_cli.integrator.meshes.graded import graded_start_mesh, least_step
from fvi_cli.integrator.meshes.mesh import Mesh, mesh_through, uniform_mesh
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.steps import RunSteps
from fvi_cli.integrator.tables import step_tables
from fvi_cli.integrator.trajectory import Trajectory

START_POWER = 0.5
"""Power for the grading after a kink: every step is a fixed share of its distance; measured in
tests/integrator/run/test_prescribed_run.py."""
HALVINGS_AT_START = 40
"""Halvings of the first step of all: between its stages the force begins like a power of t."""
FEWEST, MOST = 64, 2**14
"""Fewest and most steps with which the polynomials of a displacement are resolved."""


def material_response(
    scene: Scene,
    method: AnyMethod,
    steps: int | Mesh | AdaptiveSteps,
    *,
    with_steps: bool = False,
) -> Trajectory:
    """The run of a scene whose motion is given; the forces of its laws are quantities along it.

    Raises
    ------
    ValueError
        For methods that are not of Runge-Kutta.
    """
    assert scene.prescribed is not None
    if not isinstance(method, Method) or not method.is_runge_kutta:
        raise ValueError(
            f"method: {method.label} cannot take a given displacement; "
            "take rk: gauss, such as gauss3"
        )
    motion = replace(scene.prescribed, final_time=scene.final_time)
    mesh = mesh_of_motion(motion, method, steps)
    found = _steps_through(motion, method, mesh)
    run = Trajectory(
        time=found.time,
        position=found.position,
        n_steps=mesh.n_reported,
        step_size=scene.final_time / mesh.n_reported,
        steps=found if with_steps else None,
    )
    return run if mesh.reported is None else run.at(mesh.reported)


def mesh_of_motion(
    motion: PrescribedMotion, method: Method, steps: int | Mesh | AdaptiveSteps
) -> Mesh:
    """The mesh of a displacement; for a tolerance as many steps as its polynomials need."""
    if isinstance(steps, Mesh):
        return steps
    parts = len(motion.break_points) + 1
    if isinstance(steps, AdaptiveSteps):
        count = FEWEST if parts == 1 else parts
        while True:
            mesh = uniform_mesh(motion.final_time, count, motion.break_points)
            missed = _unresolved(_steps_through(motion, method, mesh))
            if missed <= steps.tolerance or count >= MOST:
                return mesh
            count *= 2
    mesh = uniform_mesh(motion.final_time, max(steps, parts), motion.break_points)
    if method.start != "graded":
        return mesh
    is_sharp = bool(motion.kinks)
    return graded_start_mesh(
        mesh,
        stages=method.degree,
        exponent=lambda at_start: START_POWER if at_start or is_sharp else None,
    )


def halved_mesh(motion: PrescribedMotion, halvings: int) -> Mesh:
    """A step from kink to kink, halved so often towards its beginning, for forces at kinks.

    There the force behind the kink before is smooth: errors are divided by some 4 with
    every halving (tests/studies/fits/test_irregular_bench.py).
    """
    breaks, times, sizes = motion.break_points, [np.zeros(1)], []
    for whole in uniform_mesh(motion.final_time, max(FEWEST, len(breaks) + 1), breaks).stretches:
        count = halvings if whole.begin else HALVINGS_AT_START
        while count and 2.0**-count * whole.step_size < least_step(whole.begin):
            count -= 1
        # the first two are equally long
        parts = 0.5 ** np.array([count, *range(count, 0, -1)], dtype=float)
        sizes.append(whole.step_size * np.append(parts, np.ones(whole.n_steps - 1)))
        times.append(whole.begin + np.cumsum(sizes[-1]))
        times[-1][-1] = whole.end
    every = np.concatenate(sizes)
    return mesh_through(np.concatenate(times), every, np.arange(1, every.size), breaks)


def _unresolved(steps: RunSteps) -> float:
    """Largest last coefficient of the rates on steps, as a displacement."""
    n, r, _ = steps.velocity.shape
    series = steps.tables.stages_to_series @ steps.velocity[..., 0].T
    return float(np.abs(series[-2:] * steps.step_size).max(initial=0.0)) if r > 1 and n else 0.0


def _steps_through(motion: PrescribedMotion, method: Method, mesh: Mesh) -> RunSteps:
    """Steps through a displacement, by its rates at the stages."""
    tables, time, sizes = step_tables(method), mesh.times, mesh.sizes
    # kept inside their steps: rounding must not move a time into the next piece
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
