"""How the steps of a mesh will be done: what planning tells of a run before it begins."""

from __future__ import annotations

from dataclasses import dataclass

from fvi_cli.integrator.engine.blocks import block_for
from fvi_cli.integrator.engine.engine import Engine
from fvi_cli.integrator.engine.structures import StructureLaw
from fvi_cli.integrator.meshes.mesh import Mesh


@dataclass(frozen=True, kw_only=True)
class MeshPlan:
    """How the steps of a mesh will be done, and what their memory takes."""

    n_steps: int  # steps of the mesh, and those of them that are done one by one
    single: int
    n_sizes: int  # number of step sizes
    block: int  # most steps of a block; 0: there are none
    systems: int  # independent systems of a scene, and components of each
    coupled: int
    has_modes: bool  # whether these are modes of the scene, no components of its coordinates
    n_states: int  # states that stand for the past
    operations: int | None  # multiply-adds of the memory for a scene; None: not known
    # steps of the past that are remembered one by one in states of their own; all others are
    # exponentials
    n_lags: int = 0


def memory_operations(engine: Engine, n_steps: int) -> int:
    """Multiply-adds of the memory of a scene in so many steps."""
    damping = engine.damping
    return 0 if damping is None else n_steps * engine.width * damping.operations_per_step


def plan_steps(engine: Engine, mesh: Mesh) -> MeshPlan:
    """How the loop will do the steps of a mesh for each scene of an engine."""
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
