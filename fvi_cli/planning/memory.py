"""Peak memory of a run, from the sizes of the arrays that exist at the same time."""

from __future__ import annotations

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.balances.damping_along import PIECE
from fvi_cli.integrator.damping.directions import pattern_of
from fvi_cli.integrator.engine.recurrence import DOUBLINGS, is_recurrence_quicker
from fvi_cli.integrator.loads.panels import tested_rule
from fvi_cli.integrator.members import MOST_TOGETHER
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.loop import chunk_steps
from fvi_cli.integrator.run.mesh_plan import MeshPlan
from fvi_cli.integrator.step_tables import step_tables

SHORT_BLOCK, SHORT_NONLINEAR = 8, 3
"""Typical steps in a block of graded steps, linear and nonlinear: traced on 30 scenes with a graded
start."""
SMALLEST = 8_000
"""Number of floats in the tables of a method, in expressions etc."""


def peak_bytes(
    scene: Scene, method: Method, plan: MeshPlan, *, n_kept: int, members: int, is_diagnosed: bool
) -> int:
    """Peak memory in bytes of a run or of a batch of members, without the program itself.

    The formulas were found by tracing. The peak is the largest of four sums: the tables of the
    blocks with the kept points and a chunk of steps; the tables with the points that are joined at
    the end; the arrays that make the tables of a recurrence; the evaluations of diagnostics.
    """
    tables = step_tables(method)
    samples, stages, degree = tables.sample_points.size, tables.points.size, tables.degree
    inputs = stages if method.is_runge_kutta else degree
    e, is_linear, is_forced = plan.coupled, scene.is_linear, scene.forcing is not None
    d, block = members * scene.dimension, max(plan.block, 1)
    systems = members * plan.systems
    together = min(systems, MOST_TOGETHER)
    chunk = min(chunk_steps(together * e), plan.n_steps)

    def of_tables(block: int) -> float:
        """Entries of the matrices of a block, for all systems that are stepped together."""
        unknowns = block * degree * e
        found = 1.0 * together * unknowns * (unknowns + block * e)
        memory = block * samples * (block * inputs + 1.5 * plan.n_states)
        found += len(pattern_of(scene)) * memory
        # remainders at the points; for general Lagrangians also those of momenta
        rests = 0 if is_linear else block * stages * e * (2 if scene.lagrangian else 1)
        return found + together * rests * (rests + unknowns) + rests * unknowns

    kept = (2 + 2 * d) * n_kept
    short = min(block, SHORT_BLOCK if is_linear else SHORT_NONLINEAR)
    every_table = of_tables(block) + (plan.n_sizes - 1) * of_tables(short)
    size, making, recurrence = (plan.n_states + 2) * e, 0.0, 0.0
    is_single = is_linear and together == 1
    if is_single and is_recurrence_quicker(size, block, chunk // block, plan.n_steps):
        loads, outputs = block * (degree + 1) * e, block * (inputs + 2) * e
        given = loads + 2 * e
        making = given * (2.0 * outputs + block * (degree + 2) * e)
        recurrence = outputs * (given + block * samples * e + size)
        recurrence += (DOUBLINGS + 1.0) * size * size + is_forced * (2 * outputs + size) * loads
    # positions of modes are transformed into a copy in the coordinates of their scenes
    # a single piece, as linear runs of one chunk are, is not copied
    per_step = d * (3 + 2 * (not is_linear or plan.systems > 1) + (plan.systems > 1))
    per_step += d * (3 * (degree + 1) * is_forced + 5 * degree * (not is_linear))
    if is_forced and method.forcing_quadrature != "galerkin":
        per_step += (1 + 2 * scene.dimension) * tested_rule(degree, is_graded=False)[0].size
    stepping = (
        kept + every_table + recurrence + chunk * min(1.0, MOST_TOGETHER / systems) * per_step
    )
    finishing = kept + max(every_table + d * n_kept, (members + 2 * scene.dimension) * n_kept)
    found = max(every_table + making, stepping, finishing)
    if is_diagnosed:
        of_steps = (8 + (7 + 5 * inputs) * d) * plan.n_steps
        pieces = min(PIECE, plan.n_steps) + 3 * SHORT_BLOCK * (plan.n_sizes - 1)
        again = (3 + (2 + inputs) * d) * plan.n_steps + 4 * plan.n_states * pieces * samples
        found = max(found, kept + every_table + max(of_steps, again))
    return int(8 * (SMALLEST + found))
