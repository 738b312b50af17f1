"""What the steps of a run and their memory are done with, as the engine itself decides it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import fewest
from fvi_cli.integrator.batches.plan import plan_side_by_side
from fvi_cli.integrator.blocks.convolved import Convolved
from fvi_cli.integrator.convolution.backward_differences import lag_exponentials
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.equal_steps.routes import EqualPlan, plan_equal_steps, sums_directly
from fvi_cli.integrator.equal_steps.weights import memories_of, shared_memories
from fvi_cli.integrator.members import goes_together
from fvi_cli.integrator.meshes.mesh import Mesh, graded_mesh
from fvi_cli.integrator.method import Method
from fvi_cli.integrator.run.march import MeshPlan
from fvi_cli.integrator.run.runge_kutta import plan_runge_kutta


@dataclass(frozen=True, kw_only=True)
class Machinery:
    """What the steps of a run and their memory are done with.

    Parameters
    ----------
    scene, method, n_steps, every
        The run.
    diagnosed
        Whether diagnostics are asked for.
    memories
        Number M of weights of every direction of the damping.
    members
        How many scenes of this kind are integrated together.
    plan
        What the engine will do: on the mesh of a Runge-Kutta method, or on equal steps.
    is_side_by_side
        Whether members on one mesh are stepped side by side.
    """

    scene: Scene
    method: Method
    n_steps: int
    every: int
    diagnosed: bool
    memories: tuple[int, ...]
    members: int
    plan: MeshPlan | EqualPlan
    is_side_by_side: bool = False

    @property
    def samples(self) -> int:
        """Number m of samples of a step."""
        return 1 if self.method.sampling == "nodes" else self.method.stages

    @property
    def memory(self) -> int:
        """The largest number of weights; 0 without damping."""
        return max(self.memories, default=0)

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

    @property
    def keeps_force(self) -> int:
        """1 where the damping force of every step is kept."""
        wanted = self.diagnosed or self.method.sampling == "nodes"
        return int(wanted and bool(self.memories))


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
    together = members > 1 and goes_together(scene, method, n_steps)
    plan: MeshPlan | EqualPlan
    is_side_by_side = False
    memories = memories_of(method, n_steps + 1, scene.active_damping)
    if method.is_runge_kutta:
        together = together and grading == 1.0 and members >= fewest(scene, n_steps)
        is_side_by_side = together
        if together:
            plan = plan_side_by_side(scene, method, n_steps)
        else:
            mesh: int | Mesh = n_steps
            if grading != 1.0:
                mesh = graded_mesh(scene.final_time, n_steps, grading, scene.break_points)
            plan = plan_runge_kutta(scene, method, mesh)
    else:
        plan = _equal_steps(scene, method, n_steps, memories, 1)
        if together:
            shared = shared_memories(method, n_steps + 1, scene.active_damping)
            of_all = _equal_steps(scene, method, n_steps, shared, members)
            # where the blocks of all are too large they are done one by one
            together = of_all.batch is not None
            if together:
                memories, plan = shared, of_all
    return Machinery(
        scene=scene,
        method=method,
        n_steps=n_steps,
        every=every,
        diagnosed=diagnosed,
        memories=memories,
        members=members if together else 1,
        plan=plan,
        is_side_by_side=is_side_by_side,
    )


def _equal_steps(
    scene: Scene, method: Method, n_steps: int, memories: tuple[int, ...], members: int
) -> EqualPlan:
    orders = sorted({term.order for term in scene.active_damping})
    tail = lag_exponentials(method.bdf_order, orders, n_steps + 1)
    return plan_equal_steps(
        scene,
        method.history,
        n_steps,
        Convolved(
            memories=memories,
            samples=1 if method.sampling == "nodes" else method.stages,
            coupled=scene.dimension,
            near=tail.near,
            n_rates=tail.rates.size,
        ),
        None if sums_directly(method.history, n_steps) else _decoupling(scene),
        members=members,
    )


@functools.lru_cache(maxsize=8)
def _decoupling(scene: Scene) -> Decoupling | None:
    """Made once for all runs of a scene: modes of many components take their time."""
    return linear_decoupling(scene)
