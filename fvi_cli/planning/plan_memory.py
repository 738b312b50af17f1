"""How much memory a run will take at its peak, from the sizes of its arrays.

What is counted are the arrays that are alive together, as they were found by tracing: the dense
matrices of a block and what its past does while they are put together, and the trajectory.
"""

from __future__ import annotations

from fvi_cli.integrator.damping.damper_forces import PIECE
from fvi_cli.integrator.engine.recurrence import pays_as_one
from fvi_cli.integrator.loads.panels import tested_rule
from fvi_cli.integrator.loop.loop import chunk_steps
from fvi_cli.integrator.loop.plan import MeshPlan
from fvi_cli.integrator.members import MOST_TOGETHER
from fvi_cli.planning.machinery import Machinery

SMALLEST = 8_000
"""Numbers in the tables of a method, in expressions and the like."""


def peak_bytes(run: Machinery) -> int:
    """Largest memory of a run in bytes, the program itself left out."""
    numbers = _side_by_side(run, run.plan) if run.is_side_by_side else _any_mesh(run, run.plan)
    return int(8 * (SMALLEST + numbers))


def _any_mesh(run: Machinery, plan: MeshPlan) -> float:
    """No more of the past than the states, and of the run what is kept."""
    d = run.scene.dimension
    points = run.n_steps / run.every + 3
    kept = (1 + 2 * d) * points
    matrices, past = _newton(run, plan), _past(run, plan.block)
    making = matrices + 0.5 * past
    if run.scene.is_linear:
        matrices = _linear_blocks(run, plan)
        making = matrices + past
    # of the past about half is left when the steps are done; the energy is found behind them
    left, chunk = matrices + 0.5 * past, min(chunk_steps(d), plan.n_steps)
    several = left if chunk < plan.n_steps else 0.0
    working = chunk * _per_step(run)
    stepping = kept + max(making, left + working, several + working + chunk * _forcing(run))
    stepping = max(stepping, kept + (2 + d) * points)
    if not run.diagnosed:
        return stepping
    # diagnostics are made of all stages, when the matrices of the blocks are gone
    found = (10 + (7 + 5 * run.inputs) * d) * plan.n_steps
    again = (3 + (2 + run.inputs) * d) * plan.n_steps + _past(run, min(PIECE, plan.n_steps))
    return max(stepping, kept + max(found, again))


def _per_step(run: Machinery) -> int:
    """Numbers in a step of those that are done together, and in its load vectors."""
    rows = 0 if run.scene.forcing is None else 3 * (run.method.degree + 1)
    return run.scene.dimension * (6 + 2 * run.inputs + rows)


def _forcing(run: Machinery) -> int:
    """Numbers in the forces of a step while its load vectors are made."""
    if run.scene.forcing is None or run.method.forcing_quadrature == "galerkin":
        return 0
    points, _ = tested_rule(run.method.degree, is_graded=False)
    return (1 + 2 * run.scene.dimension) * points.size


def _linear_blocks(run: Machinery, plan: MeshPlan) -> float:
    chunk = min(chunk_steps(run.scene.dimension), plan.n_steps)
    q, e, block, states = plan.systems, plan.coupled, plan.block, plan.n_states
    numbers = float(run.block_numbers)
    size = (states + 2) * e
    if q == 1 and block and pays_as_one(size, block, chunk // block, plan.n_steps):
        numbers += size * (size + run.block_columns + block * (run.inputs + 2) * e)
        if plan.n_lags:
            # the change of all states, and what takes a block to them
            numbers += 2 * states**2 + states * block * run.inputs
        numbers += 0.5 * _past(run, block)
    return numbers


def _newton(run: Machinery, plan: MeshPlan) -> float:
    """Matrices of the linear scene, and what is made of them for blocks of some lengths."""
    points = plan.block * run.tables.points.size * plan.coupled
    times = 1.0
    if run.scene.lagrangian is not None:
        # velocities are unknowns as well; new matrices are made beside the old ones
        points, times = 2 * points, 1.5
    driven = points + plan.block * (run.inputs + 2) * plan.coupled
    return times * (run.block_numbers + driven * run.block_columns + points**2)


def _past(run: Machinery, block: int) -> float:
    """Numbers in what the states do to a block of so many steps, while it is made."""
    states, m, d = run.plan.n_states, run.samples, run.scene.dimension
    rows = max(block, 1) * m
    if run.plan.n_lags:
        return states * (3.2 * run.n_terms * rows + 4 * d)
    return states * (rows * (2 * max(run.n_directions, 1) + 1) + 2 * block + 4 * m + 2 * d)


def _side_by_side(run: Machinery, plan: MeshPlan) -> float:
    """Trajectories of all members, put together at the end, and what their steps take."""
    d, states = run.components, plan.n_states
    points = run.n_steps / run.every + 2
    m, e, q = run.samples, run.coupled, min(run.systems, MOST_TOGETHER)
    block, chunk = max(plan.block, 1), chunk_steps(q * e)
    size = (run.method.degree + 1) * e
    tables = states * (3 * block * m + 5 * q * e) + 2 * block * m * m * states
    matrices = q * (2 * size * (size + e) + block * m * (m + 2 * e))
    loads = 0 if run.scene.forcing is None else 3 * chunk * size * q
    return max(5 * d, 4 * d + 2 * run.members) * points + tables + matrices + loads
