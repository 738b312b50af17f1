"""What the steps are done with where systems of one scene or of many are taken side by side."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.plan import plan_side_by_side
from fvi_cli.integrator.blocks.sizes import batch_sizes
from fvi_cli.integrator.convolution.directions import terms_by_direction
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.equal_steps.routes import Route, scene_decoupling
from fvi_cli.integrator.method import Method
from fvi_cli.planning.history_work import Shape, block_operations
from fvi_cli.planning.plan_words import history_in_words, systems_in_words


@functools.lru_cache(maxsize=8)
def systems_of(scene: Scene) -> Decoupling | None:
    """Made once for all runs of a scene: modes of many components take their time."""
    if scene.is_sparse:
        return None
    directions = [dense(direction) for direction, _ in terms_by_direction(scene.active_damping)]
    directions += [law.coefficient for law in scene.active_laws]
    return scene_decoupling(scene, directions)


def fit_together(scene: Scene, shape: Shape, n_steps: int, members: int) -> bool:
    """Whether blocks of so many scenes, side by side, are not too large."""
    decoupling = systems_of(scene)
    if decoupling is None:
        return False
    coupled = scene.dimension // decoupling.batch
    return batch_sizes(shape.samples, coupled, members * decoupling.batch, n_steps) is not None


@dataclass(frozen=True, kw_only=True)
class Machinery:
    """What the steps of a run and their memory are done with.

    Parameters
    ----------
    scene, method, n_steps, every
        The run.
    diagnosed
        Whether diagnostics are asked for.
    shape
        What is convolved, in the coordinates of the steps.
    route, steps, history
        How the steps are done, and in words they and the history.
    operations
        Multiply-adds of the memory of one member.
    members
        How many scenes of this kind are integrated together.
    n_states, n_mesh_steps, block
        Of a method on any mesh: number of exponentials, steps of its own mesh, and steps of a
        block.
    """

    scene: Scene
    method: Method
    n_steps: int
    every: int
    diagnosed: bool
    shape: Shape
    route: Route | str = ""
    steps: str = ""
    history: str = ""
    operations: int = 0
    members: int = 1
    n_states: int = 0
    n_mesh_steps: int = 0
    block: int = 0

    @property
    def components(self) -> int:
        """Degrees of freedom of all members."""
        return self.members * self.scene.dimension

    @property
    def driven(self) -> bool:
        """Whether there are moments of known forces."""
        return self.scene.forcing is not None

    @property
    def keeps_force(self) -> int:
        """1 where the damping force of every step is kept."""
        wanted = self.diagnosed or self.method.sampling == "nodes"
        return int(wanted and bool(self.shape.memories))


def linear_blocks(run: Machinery, decoupling: Decoupling, ends: int, members: int) -> Machinery:
    """Blocks of a linear scene by a method with sequences of weights, of several members also."""
    scene, n_steps, shape = run.scene, run.n_steps, run.shape
    coupled = scene.dimension // decoupling.batch
    if not fit_together(scene, shape, n_steps, members):
        # together they are too large: one by one
        members = 1
    chosen = batch_sizes(shape.samples, coupled, members * decoupling.batch, n_steps)
    if chosen is None:  # pragma: no cover - the route says so
        raise ValueError("route: these blocks are too large")
    _, sizes = chosen
    shape = replace(shape, coupled=coupled, batch=decoupling.batch)
    systems = systems_in_words(shape, has_modes=decoupling.has_modes) + (
        f", {members} members together" * (members > 1)
    )
    return replace(
        run,
        route="linear blocks",
        shape=replace(shape, batch=members * decoupling.batch),
        steps=f"blocks of {sizes.block} steps as one matrix product, {systems}",
        history=history_in_words(shape, sizes.group),
        # all members do the same
        operations=block_operations(shape, sizes, n_steps, ends),
        members=members,
    )


def members_side_by_side(run: Machinery, members: int) -> Machinery:
    """Members of a sweep on one mesh."""
    scene = run.scene
    plan = plan_side_by_side(scene, run.method, run.n_steps)
    shape = replace(run.shape, coupled=plan.coupled, batch=plan.systems)
    words = f"{plan.n_steps} steps of {members} members together"
    if not scene.is_linear:
        words += ", Newton's iteration for all at once with a linear response of each"
    history = history_in_words(shape, 1)
    if plan.n_states:
        history = f"{plan.n_states} exponentials in place of the past"
    return replace(
        run,
        route="side by side",
        shape=replace(shape, batch=members * plan.systems),
        steps=f"{words}, {systems_in_words(shape, has_modes=plan.has_modes)}",
        history=history,
        operations=plan.operations,
        n_states=plan.n_states,
        members=members,
        n_mesh_steps=plan.n_steps,
    )
