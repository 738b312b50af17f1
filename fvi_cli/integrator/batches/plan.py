"""How many scenes of one kind will be stepped side by side, and what their memory takes."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import decoupling_of
from fvi_cli.integrator.batches.memory import rates_and_weights
from fvi_cli.integrator.batches.systems import kernels_of
from fvi_cli.integrator.convolution.damping import directions_of
from fvi_cli.integrator.convolution.lags import lag_tail
from fvi_cli.integrator.engine.plan import MeshPlan
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import mesh_for
from fvi_cli.integrator.step_tables import step_tables

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
    slots = 1 if coupled == 1 else len(directions)
    if method.is_runge_kutta:
        terms = [term for one in directions for term in one.terms]
        n_states = n_lags = 0
        if terms:
            rates, _ = rates_and_weights(
                (terms[0], kernels_of(scene)),
                shortest_step=mesh.shortest_step,
                n_steps=mesh.equivalent_steps,
                final_time=scene.final_time,
                stages=method.stages,
            )
            n_states = rates.size
        per_step, inputs, pairs = 2 * method.stages * n_states, method.stages, method.stages**2
    else:
        orders = tuple(sorted({term.order for term in scene.active_damping}))
        tail = lag_tail(method.bdf_order, orders, mesh.n_steps)
        m, inputs = step_tables(method).sample_points.size, method.degree
        n_lags = tail.near if orders else 0
        n_states = (n_lags + tail.rates.size) * inputs
        per_step, pairs = len(orders) * m * n_states + tail.rates.size * inputs, m * inputs
    operations = 0
    for one in mesh.stretches if n_states else ():
        in_matrices = scene.is_linear and in_blocks(one.n_steps, inputs * coupled)
        singly = one.n_steps % BLOCK if in_matrices else one.n_steps
        operations += one.n_steps * per_step + slots * pairs * _pairs_of_steps(singly)
    return MeshPlan(
        n_steps=mesh.n_steps,
        single=0,
        block=BLOCK,
        systems=decoupling.batch,
        coupled=coupled,
        has_modes=decoupling.has_modes,
        n_states=n_states,
        operations=scene.dimension * operations,
        n_lags=n_lags,
    )


def in_blocks(n_steps: int, step_numbers: int) -> bool:
    """Whether so many equal steps of linear systems are done in whole blocks.

    Parameters
    ----------
    n_steps, step_numbers
        Number of steps, and numbers that drive the damping in each.
    """
    return n_steps >= LEAST_BLOCKS * BLOCK and step_numbers * BLOCK <= LARGEST_BLOCK


def _pairs_of_steps(n_steps: int) -> int:
    """How many steps of the same block lie before others, for steps that are done one by one."""
    whole, rest = divmod(n_steps, BLOCK)
    return whole * (BLOCK * (BLOCK - 1) // 2) + rest * (rest - 1) // 2
