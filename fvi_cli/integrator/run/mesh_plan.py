"""How the steps of a mesh will be solved, found without solving them."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.engine.blocks import block_for
from fvi_cli.integrator.engine.structures import StructureLaw
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import engine_for, mesh_for
from fvi_cli.integrator.run.scenes_run import memory_operations


@dataclass(frozen=True, kw_only=True)
class MeshPlan:
    """How the steps of a mesh will be solved, and what their memory takes."""

    n_steps: int  # steps of the mesh, and steps that are solved one by one
    single: int
    n_sizes: int  # number of step sizes
    block: int  # most steps of a block; 0: there are none
    systems: int  # independent systems of a scene, and components of each
    coupled: int
    has_modes: bool  # whether the systems are modes of the scene, not its coordinates
    n_states: int  # states that stand for the past
    operations: int | None  # multiply-adds of the memory for a scene; None: not known
    # past steps that are stored one by one in states of their own; all others are stored as
    # exponentials
    n_lags: int = 0


def plan_on_mesh(
    scene: Scene, method: Method, steps: int | Mesh, *, most: int | None = None
) -> MeshPlan:
    """How :func:`fvi_cli.integrator.run.on_mesh.integrate_scenes` will do the steps of a scene."""
    mesh = mesh_for(scene, method, steps)
    engine = engine_for([scene], method, mesh, most=most)
    single = largest = 0
    for one in mesh.stretches:
        block = block_for(engine, one.n_steps)
        if block == 1 or isinstance(engine.law, StructureLaw):
            single += one.n_steps
        else:
            largest = max(largest, block)
    return MeshPlan(
        n_steps=mesh.n_steps,
        single=single,
        n_sizes=len({one.step_size for one in mesh.stretches}),
        block=largest,
        systems=engine.width,
        coupled=engine.e,
        has_modes=engine.modes is not None and engine.modes[0].has_modes,
        n_states=engine.n_states,
        operations=memory_operations(engine, mesh.n_steps),
        n_lags=0 if engine.damping is None else engine.damping.memory.n_lags,
    )
