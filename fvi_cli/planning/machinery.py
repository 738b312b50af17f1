"""What the steps of a run and their memory are done with, as the engine itself decides it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.break_points import fits_break_points
from fvi_cli.integrator.damping.directions import pattern_of
from fvi_cli.integrator.loop.plan import MeshPlan
from fvi_cli.integrator.members import block_in_batch, fewest, goes_together
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh, uniform_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.on_mesh import plan_on_mesh
from fvi_cli.integrator.step_tables import StepTables, step_tables


@dataclass(frozen=True, kw_only=True)
class Machinery:
    """What the steps of a run and their memory are done with.

    Parameters
    ----------
    scene, method, n_steps, every
        The run.
    diagnosed
        Whether diagnostics are asked for.
    members
        How many scenes of this kind are integrated together.
    plan
        What the engine will do.
    n_directions, n_terms
        Matrices along which the damping acts, and orders of all; terms of one direction share
        their sums.
    is_side_by_side
        Whether members are stepped side by side.
    """

    scene: Scene
    method: Method
    n_steps: int
    every: int
    diagnosed: bool
    members: int
    plan: MeshPlan
    n_directions: int
    n_terms: int
    is_side_by_side: bool = False

    @property
    def tables(self) -> StepTables:
        """Numbers of the method."""
        return step_tables(self.method)

    @property
    def samples(self) -> int:
        """Number m of points of a step where the damping acts."""
        return self.tables.sample_points.size

    @property
    def inputs(self) -> int:
        """Number of what drives the damping in a step: velocities at the stages, or unknowns."""
        return self.tables.points.size if self.method.is_runge_kutta else self.tables.degree

    @property
    def n_sums(self) -> int:
        """Exponentials in place of the past, or of what lies behind its nearest steps."""
        if self.method.is_runge_kutta:
            return self.plan.n_states
        return self.plan.n_states // self.tables.degree - self.plan.n_lags

    @property
    def block_columns(self) -> int:
        """What a block of one system begins with: load vectors, position and momentum."""
        return (self.plan.block * (self.method.degree + 1) + 2) * self.plan.coupled

    @property
    def block_numbers(self) -> int:
        """Numbers in the matrices of a block, for the systems of one scene."""
        rows = (self.inputs + self.tables.points.size + 2) * self.plan.coupled
        return self.plan.systems * self.plan.block * rows * self.block_columns

    @property
    def systems(self) -> int:
        """Number q of systems that are stepped side by side."""
        return self.members * self.plan.systems

    @property
    def coupled(self) -> int:
        """Components e of each of them."""
        return self.scene.dimension // self.plan.systems

    @property
    def components(self) -> int:
        """Degrees of freedom of all members."""
        return self.members * self.scene.dimension


@functools.lru_cache(maxsize=256)
def machinery_of(
    scene: Scene,
    method: Method,
    n_steps: int,
    every: int = 1,
    members: int = 1,
    *,
    diagnosed: bool = False,
    grading: float = 1.0,
) -> Machinery:
    """What :func:`fvi_cli.planning.plan.plan_run` is told of, parameters as there."""
    together = members > 1 and grading == 1.0 and goes_together(scene, method, n_steps)
    # a run with a break point between two equal steps is refused when it begins, not here
    fits = method.is_runge_kutta or fits_break_points(scene, n_steps)
    together = together and fits and members >= fewest(scene, n_steps)
    mesh: int | Mesh = n_steps
    if not fits:
        mesh = uniform_mesh(scene.final_time, n_steps)
    if grading != 1.0:
        mesh = graded_mesh(scene.final_time, n_steps, grading, scene.break_points)
    most = block_in_batch(scene, method) if together else None
    plan = plan_on_mesh(scene, method, mesh, most=most)
    return Machinery(
        scene=scene,
        method=method,
        n_steps=n_steps,
        every=every,
        diagnosed=diagnosed,
        members=members if together else 1,
        plan=plan,
        n_directions=len(pattern_of(scene)),
        n_terms=len({term.order for term in scene.active_damping}),
        is_side_by_side=together,
    )
