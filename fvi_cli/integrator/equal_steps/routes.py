"""Which route the steps take: block by block where that pays, otherwise one after the other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.blocks.convolved import Convolved, direct_operations
from fvi_cli.integrator.blocks.history import SteppedHistory, convolved_of
from fvi_cli.integrator.blocks.linear import run_linear_blocks
from fvi_cli.integrator.blocks.newton import NewtonPlan, plan_newton, run_newton_blocks
from fvi_cli.integrator.blocks.sizes import BatchPlan, plan_batch
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.equal_steps.increments import linear_increments, nonlinear_increments
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem
from fvi_cli.integrator.equal_steps.stepping import run_steps
from fvi_cli.integrator.method import History

Array = NDArray[np.float64]
Route = Literal["direct steps", "stepped", "linear blocks", "newton blocks"]

LEAST_BLOCK_STEPS = 16
"""Fewer steps are done sooner one after the other than the matrices of a block are made."""


@dataclass(frozen=True, kw_only=True)
class EqualPlan:
    """How the steps of a run are done, and what their memory takes.

    Parameters
    ----------
    route
        One after the other, with every sum written out or older steps as exponentials, or in
        blocks.
    convolved, n_steps
        What is convolved in each system, and N.
    decoupling
        Coordinates of linear blocks; None for other routes.
    batch, newton
        The blocks, where the route has some.
    """

    route: Route
    convolved: Convolved
    n_steps: int
    decoupling: Decoupling | None = None
    batch: BatchPlan | None = None
    newton: NewtonPlan | None = None

    @property
    def systems(self) -> int:
        """Independent systems that a scene is."""
        return 1 if self.decoupling is None else self.decoupling.batch

    @property
    def has_modes(self) -> bool:
        """Whether these are modes of the scene, no components of its coordinates."""
        return self.decoupling is not None and self.decoupling.has_modes

    @property
    def block(self) -> int:
        """Most steps of a block; 1 where they are done one by one."""
        if self.batch is not None:
            return self.batch.block
        return 1 if self.newton is None else self.newton.block

    @property
    def operations(self) -> int:
        """Multiply-adds of the memory of one scene."""
        if self.batch is not None:
            return self.systems * self.batch.operations
        if self.newton is not None:
            return self.newton.operations
        if self.route == "stepped":
            return self.n_steps * self.convolved.operations_per_step
        return direct_operations(self.convolved, self.n_steps + 1)


def plan_equal_steps(
    scene: Scene,
    history: History,
    n_steps: int,
    convolved: Convolved,
    decoupling: Decoupling | None,
    *,
    members: int = 1,
) -> EqualPlan:
    """How the steps are done: the run asks here, and who tells beforehand what it will do.

    Parameters
    ----------
    scene, history, n_steps
        What is integrated, how its memory is to be summed up, and N.
    convolved
        What is convolved in the coordinates of the scene.
    decoupling
        Coordinates of a linear scene; None for others, and not asked for where every sum is
        written out.
    members
        Linear scenes of one kind that are taken together.
    """
    if sums_directly(history, n_steps):
        return EqualPlan(route="direct steps", convolved=convolved, n_steps=n_steps)
    if decoupling is not None:
        own = replace(convolved, coupled=scene.dimension // decoupling.batch)
        batch = plan_batch(own, members * decoupling.batch, n_steps)
        if batch is not None:
            return EqualPlan(
                route="linear blocks",
                convolved=own,
                n_steps=n_steps,
                decoupling=decoupling,
                batch=batch,
            )
    else:
        newton = plan_newton(scene, convolved, n_steps)
        if newton is not None:
            return EqualPlan(
                route="newton blocks", convolved=convolved, n_steps=n_steps, newton=newton
            )
    route: Route = "stepped" if convolved.memories else "direct steps"
    return EqualPlan(route=route, convolved=convolved, n_steps=n_steps)


def sums_directly(history: History, n_steps: int) -> bool:
    """Whether every sum of the memory is written out."""
    return history == "direct" or (history == "auto" and n_steps < LEAST_BLOCK_STEPS)


def run(problem: StepProblem, history: History, *, with_increments: bool = False) -> Stepped:
    """All steps by the route that `history` asks for.

    Parameters
    ----------
    problem
        Everything that the steps need.
    history
        ``direct``: one step after the other, every sum written out; ``exponentials``: block by
        block, the past as exponentials; ``auto``: the quicker one.
    with_increments
        Whether the increments of every step are wanted, and with them the damping force.

    Returns
    -------
    Stepped
        The same to round-off by every route, and to the last bit with increments or without.
    """
    scene, memory, n_steps = problem.scene, problem.memory, problem.n_steps
    problem = replace(problem, keep_force=with_increments)
    decoupling = None
    if not sums_directly(history, n_steps):
        decoupling = linear_decoupling(scene)
    convolved = convolved_of(memory.channels, memory.sample_matrix.shape[1], scene.dimension)
    plan = plan_equal_steps(scene, history, n_steps, convolved, decoupling)
    finished: Stepped | None = None
    if plan.route == "linear blocks" and decoupling is not None:
        finished = run_linear_blocks(problem, decoupling)
        if finished is not None and with_increments:
            return _kept(finished, linear_increments(problem, decoupling, finished))
    elif plan.newton is not None:
        finished = run_newton_blocks(problem, plan.newton)
        if with_increments and scene.potential is not None:
            increments = nonlinear_increments(problem, scene.potential, finished)
            finished = None if increments is None else _kept(finished, increments)
    if finished is not None:
        return finished
    sums = None
    if memory.channels and plan.route != "direct steps":
        sums = SteppedHistory(memory)
    return run_steps(problem, sums, keep_increments=with_increments)


def _kept(stepped: Stepped, increments: Array) -> Stepped:
    """What the steps gave with their increments, and no force where nothing is damped."""
    force = stepped.end_force
    if not force.shape[0]:
        force = np.zeros((stepped.position.shape[0], *force.shape[1:]))
    return replace(stepped, increments=increments, end_force=force)
