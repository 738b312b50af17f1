"""Second runs on the meshes of finished ones, which tell what lies between their points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.mesh_balance import damping_along
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.observations.impacts import replayed
from fvi_cli.integrator.observations.motion import DenseMotion
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.run.on_mesh import integrate_on_mesh
from fvi_cli.integrator.run.setup import prepare_on_mesh
from fvi_cli.integrator.run.unfinished import RunKeeper
from fvi_cli.mathematics.arrays import Array

MOST_STAGES = 12
"""Stages of the second run at most."""


def dense_motion(
    scenes: Sequence[Scene],
    method: Method,
    steps: Sequence[RunSteps],
    checkpoints: RunKeeper | None = None,
) -> DenseMotion:
    """The dense motions of finished runs, by second runs on their meshes.

    Parameters
    ----------
    scenes, method
        What moved, and by which Runge-Kutta method.
    steps
        All steps of every run.
    checkpoints
        Where the second run of a single scene keeps a checkpoint, and goes on from one.
    """
    stages = min(2 * method.degree, MOST_STAGES)
    if stages == method.degree:
        return _motion(scenes, [method] * len(steps), steps, steps, [""] * len(steps))
    own = Method(
        cq="gauss", degree=stages, start="none", forcing_quadrature=method.forcing_quadrature
    )
    methods, shapes, remarks = [], [], []
    for scene, one in zip(scenes, steps, strict=True):
        second, said = _second_run(scene, own, one, checkpoints)
        methods.append(method if second is None else own)
        shapes.append(one if second is None else second)
        remarks.append(
            ""
            if second is not None
            else "between the points of the mesh the motion is known to the order of a step only: "
            f"the run of {stages} stages {said}"
        )
    return _motion(scenes, methods, steps, shapes, remarks)


def _motion(
    scenes: Sequence[Scene],
    methods: Sequence[Method],
    steps: Sequence[RunSteps],
    shapes: Sequence[RunSteps],
    remarks: Sequence[str],
) -> DenseMotion:
    forces = partial(stage_forces, methods=methods, shapes=shapes)
    return DenseMotion(
        scenes=tuple(scenes),
        steps=tuple(steps),
        shapes=tuple(shapes),
        forces=tuple(forces(scenes)),
        remarks=tuple(remarks),
        stage_forces=forces,
    )


def _second_run(
    scene: Scene, method: Method, steps: RunSteps, checkpoints: RunKeeper | None
) -> tuple[RunSteps | None, str]:
    """The run by another method on the same mesh, or why there is none."""
    shorter = replace(scene, final_time=float(steps.time[-1]))
    mesh = steps.mesh(scene.break_points)
    if steps.jump is None:
        second = integrate_on_mesh(shorter, method, mesh, with_steps=True, checkpoints=checkpoints)
        whole = second.steps if second.status == "ok" else None
        return whole, f"{second.status}: {second.message}"
    return replayed(prepare_on_mesh(shorter, method, mesh), steps, checkpoints), "failed"


def stage_forces(
    scenes: Sequence[Scene], methods: Sequence[Method], shapes: Sequence[RunSteps]
) -> list[Array | None]:
    """Damping forces at the stages of runs, ``(n, r, d)``; None without damping."""
    return [_stage_forces(*one) for one in zip(scenes, methods, shapes, strict=True)]


def _stage_forces(scene: Scene, method: Method, steps: RunSteps) -> Array | None:
    if not scene.active_forces or not steps.n_steps:
        return None
    damping = prepare_on_mesh(scene, method, steps.mesh(scene.break_points)).damping
    if damping is None:  # pragma: no cover - there are forces
        return None
    with np.errstate(all="ignore"):
        return damping_along(damping, steps.velocity, steps.step_size)[0]
