"""How many scenes of one kind will be stepped side by side, and what their memory takes."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import decoupling_of
from fvi_cli.integrator.batches.memory import rates_and_weights
from fvi_cli.integrator.batches.systems import kernels_of
from fvi_cli.integrator.convolution.damping import directions_of
from fvi_cli.integrator.meshes.mesh import Mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.march import MeshPlan
from fvi_cli.integrator.run.runge_kutta import mesh_for

BLOCK = 16
"""Steps of a block: the fewer, the more often all states are pushed, the more, the more lags."""

LEAST_BLOCKS = 8
"""Blocks in a stretch that pay for the matrices of whole blocks of linear systems."""
LARGEST_BLOCK = 100
"""Steps of a block times stages times components, at most, for these matrices."""


def plan_side_by_side(scene: Scene, method: Method, n_steps: int) -> MeshPlan:
    """How scenes like this one are stepped side by side; no step is done."""
    mesh, decoupling = mesh_for(scene, method, n_steps), decoupling_of(scene)
    directions = directions_of(scene)
    coupled = scene.dimension // decoupling.batch
    terms = [term for one in directions for term in one.terms]
    n_states = 0
    if terms:
        rates, _ = rates_and_weights(
            (terms[0], kernels_of(scene)),
            shortest_step=mesh.shortest_step,
            n_steps=mesh.equivalent_steps,
            final_time=scene.final_time,
            stages=method.stages,
        )
        n_states = rates.size
    operations = memory_operations(
        mesh,
        stages=method.stages,
        n_states=n_states,
        coupled=coupled,
        slots=1 if coupled == 1 else len(directions),
        is_linear=scene.is_linear,
    )
    return MeshPlan(
        n_steps=mesh.n_steps,
        single=0,
        block=BLOCK,
        systems=decoupling.batch,
        coupled=coupled,
        has_modes=decoupling.has_modes,
        n_states=n_states,
        operations=decoupling.batch * operations,
    )


def in_blocks(n_steps: int, step_numbers: int) -> bool:
    """Whether so many equal steps of linear systems are done in whole blocks.

    Parameters
    ----------
    n_steps, step_numbers
        Number of steps, and stages times components of each.
    """
    return n_steps >= LEAST_BLOCKS * BLOCK and step_numbers * BLOCK <= LARGEST_BLOCK


def memory_operations(
    mesh: Mesh, *, stages: int, n_states: int, coupled: int, slots: int, is_linear: bool
) -> int:
    """Multiply-adds of the memory of one system on a mesh.

    Parameters
    ----------
    mesh
        Where the steps are.
    stages, n_states
        Of the method, and states of the damping.
    coupled, slots
        Components of the system, and directions of its damping.
    is_linear
        Whether it is: matrices of whole blocks hold the lags.
    """
    if n_states == 0:
        return 0
    total = 0
    for one in mesh.stretches:
        whole, rest = divmod(one.n_steps, BLOCK)
        if is_linear and in_blocks(one.n_steps, stages * coupled):
            whole = 0
        pairs = whole * (BLOCK * (BLOCK - 1) // 2) + rest * (rest - 1) // 2
        total += 2 * one.n_steps * stages * n_states + slots * stages**2 * pairs
    return coupled * total
