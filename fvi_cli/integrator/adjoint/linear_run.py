"""Runs of linear scenes by the linearised equations, which are then their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.adjoint.linearised import Disturbance, LinearisedRun
from fvi_cli.integrator.adjoint.variation import loads_of
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.results.run_steps import RunSteps
from fvi_cli.integrator.step_tables import step_tables
from fvi_cli.integrator.steps.dynamics import dynamics_of


def linear_run(scene: Scene, method: Method, mesh: Mesh) -> LinearisedRun:
    """A run of a linear scene on a mesh, ready for tangents and adjoints.

    The motion is what initial data and loads, as disturbances, make of rest: the tables of its
    steps are made once for the run and its derivatives.

    Raises
    ------
    ValueError
        If the equations of a step have no unique solution, or a step has too many unknowns.
    """
    tables, d = step_tables(method), scene.dimension
    sizes = np.concatenate([np.full(one.n_steps, one.step_size) for one in mesh.stretches])
    inside = [one.begin + one.step_size * np.arange(1, one.n_steps) for one in mesh.stretches]
    ends = [np.append(own, one.end) for own, one in zip(inside, mesh.stretches, strict=True)]
    time = np.concatenate([[0.0], *ends])
    nothing = np.zeros((time.size, d))
    stages = np.zeros((sizes.size, tables.points.size, d, 1))
    rest = RunSteps(
        tables=tables,
        time=time,
        position=nothing,
        momentum=nothing,
        step_size=sizes,
        velocity=stages[..., 0],
    )
    run = LinearisedRun(scene, method, rest)
    start = dynamics_of(scene).momentum(scene.initial_position, scene.initial_velocity, 0.0)
    motion = run.tangent(
        Disturbance(
            momentum=stages,
            force=stages,
            loads=loads_of(scene, method, rest)[..., None],
            position=scene.initial_position[:, None],
            velocity=scene.initial_velocity[:, None],
            start_momentum=start[:, None],
        )
    )
    run.steps = replace(
        rest,
        position=motion.position[..., 0],
        momentum=motion.momentum[..., 0],
        velocity=np.einsum("rs,nsd->nrd", run.to_velocity, motion.unknowns[..., 0]),
    )
    return run
