"""How much memory a run will take at its peak, from the sizes of its arrays.

What is counted are the arrays that are alive together, as they were found by tracing: the dense
matrices of a block and what its past does while they are put together, and the trajectory.
"""

from __future__ import annotations

from fvi_cli.integrator.damping.damper_forces import PIECE
from fvi_cli.integrator.engine.recurrence import pays_as_one
from fvi_cli.integrator.loads.panels import tested_rule
from fvi_cli.integrator.loop.loop import chunk_steps
from fvi_cli.integrator.members import MOST_TOGETHER
from fvi_cli.planning.machinery import Machinery

SHORT_BLOCK = 8
"""Steps of a block of graded steps, about."""
SMALLEST = 8_000
"""Numbers in the tables of a method, in expressions and the like."""


def peak_bytes(run: Machinery) -> int:
    """Largest memory of a run in bytes, the program itself left out."""
    d, points, plan = run.components, run.n_steps / run.every + 3, run.plan
    kept = (2 + 2 * d) * points
    together = min(run.systems, MOST_TOGETHER)
    chunk = min(chunk_steps(together * run.coupled), plan.n_steps)
    tables = _tables(run, together, max(plan.block, 1))
    # of graded steps blocks are short
    tables += (plan.n_sizes - 1) * _tables(run, together, min(max(plan.block, 1), SHORT_BLOCK))
    making = tables + _recurrence(run, together, chunk)
    stepping = kept + tables + chunk * min(1.0, MOST_TOGETHER / run.systems) * _per_step(run)
    # what was kept is put together array by array, and the energies are found
    ended = kept + max(tables + d * points, (run.members + 2 * run.scene.dimension) * points)
    found = max(making, stepping, ended)
    if run.diagnosed:
        of_steps = (10 + (7 + 5 * run.inputs) * d) * plan.n_steps
        again = (3 + (2 + run.inputs) * d) * plan.n_steps
        pieces = min(PIECE, plan.n_steps) + 3 * SHORT_BLOCK * (plan.n_sizes - 1)
        again += 3 * plan.n_states * pieces * run.samples
        found = max(found, kept + tables + max(of_steps, again))
    return int(8 * (SMALLEST + found))


def _tables(run: Machinery, together: int, block: int) -> float:
    """Matrices of a block of all systems that are stepped together, and of their memory."""
    m, i, e = run.samples, run.inputs, run.plan.coupled
    unknowns = block * run.method.degree * e
    found = float(together * unknowns * (unknowns + block * e))
    if run.n_directions:
        found += run.n_directions * block * m * (block * i + 1.5 * run.plan.n_states)
    if run.scene.is_linear:
        return found
    # remainders at the points: of momenta too, for general Lagrangians
    width = 1 if run.scene.lagrangian is None else 2
    rests = block * run.tables.points.size * e * width
    return found + together * rests * (rests + unknowns) + rests * unknowns


def _recurrence(run: Machinery, together: int, chunk: int) -> float:
    """What is made of the unit vectors of a recurrence; 0 where there is none."""
    plan, e = run.plan, run.plan.coupled
    size, block = (plan.n_states + 2) * e, max(plan.block, 1)
    pays = pays_as_one(size, block, chunk // block, plan.n_steps)
    if not (run.scene.is_linear and together == 1 and pays):
        return 0.0
    unknowns = block * run.method.degree * e
    loads = unknowns + block * e
    outputs = block * (run.inputs + 2) * e
    # states of lags are shifted by matrices
    found = (5.0 if plan.n_lags else 2.0) * size * size + size * (
        loads + 2 * unknowns + block * run.samples * e + outputs
    )
    return found if run.scene.forcing is None else found + 2 * outputs * loads


def _per_step(run: Machinery) -> float:
    """Numbers in a step of a chunk: points, what they are checked by, and load vectors."""
    d = run.components
    rows = 0 if run.scene.forcing is None else 3 * (run.method.degree + 1)
    unknowns = 0 if run.scene.is_linear else 5 * run.method.degree
    forcing = 0
    if run.scene.forcing is not None and run.method.forcing_quadrature != "galerkin":
        points, _ = tested_rule(run.method.degree, is_graded=False)
        forcing = (1 + 2 * run.scene.dimension) * points.size
    return d * (6 + rows + unknowns) + forcing
