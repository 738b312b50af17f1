"""Which route the steps take: block by block where that pays, otherwise one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.blocks.linear import run_linear_blocks
from fvi_cli.integrator.blocks.newton import newton_block, run_newton_blocks
from fvi_cli.integrator.blocks.sizes import batch_sizes
from fvi_cli.integrator.blocks.stepped_history import SteppedHistory
from fvi_cli.integrator.decoupling import Decoupling, decouple_forms
from fvi_cli.integrator.equal_steps.increments import linear_increments, nonlinear_increments
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem
from fvi_cli.integrator.equal_steps.stepping import run_steps
from fvi_cli.integrator.method import History

Array = NDArray[np.float64]
Route = Literal["direct steps", "stepped", "linear blocks", "newton blocks"]

LEAST_BLOCK_STEPS = 16
"""Fewer steps are done sooner one after the other than the matrices of a block are made."""


def choose_route(
    scene: Scene,
    history: History,
    n_steps: int,
    samples: int,
    decoupling: Decoupling | None,
    *,
    damped: bool,
) -> Route:
    """How the steps are done; the plan of a run asks here as well.

    Parameters
    ----------
    scene, history, n_steps
        What is integrated, how its memory is to be summed up, and N.
    samples
        Number m of samples of a step.
    decoupling
        Coordinates of a linear scene; None for others.
    damped
        Whether there is any damping.
    """
    if sums_directly(history, n_steps):
        return "direct steps"
    if decoupling is not None:
        coupled = scene.dimension // decoupling.batch
        sizes = batch_sizes(samples, coupled, decoupling.batch, n_steps)
        if sizes is None:
            return "stepped" if damped else "direct steps"
        return "linear blocks"
    if newton_block(scene, samples, n_steps) is not None:
        return "newton blocks"
    return "stepped" if damped else "direct steps"


def sums_directly(history: History, n_steps: int) -> bool:
    """Whether every sum of the memory is written out."""
    return history == "direct" or (history == "auto" and n_steps < LEAST_BLOCK_STEPS)


def scene_decoupling(scene: Scene, directions: Sequence[Array]) -> Decoupling | None:
    """Coordinates in which a linear scene falls apart; None for other scenes."""
    if not scene.is_linear:
        return None
    potential = scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    return decouple_forms(scene.inertia.mass, stiffness, directions)


def run(problem: StepProblem, history: History, *, with_increments: bool = False) -> Stepped:
    """All steps by the route that `history` asks for.

    Parameters
    ----------
    problem
        Everything that the steps need.
    history
        ``direct``: one step after the other, every sum written out; ``fft``: block by block,
        finished blocks convolved into the future by FFT; ``auto``: the quicker one.
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
        decoupling = scene_decoupling(scene, [channel.direction for channel in memory.channels])
    samples = memory.sample_matrix.shape[1]
    route = choose_route(scene, history, n_steps, samples, decoupling, damped=bool(memory.channels))
    finished: Stepped | None = None
    if route == "linear blocks" and decoupling is not None:
        finished = run_linear_blocks(problem, decoupling)
        if finished is not None and with_increments:
            return _kept(finished, linear_increments(problem, decoupling, finished))
    elif route == "newton blocks":
        finished = run_newton_blocks(problem)
        if finished is not None and with_increments and scene.potential is not None:
            increments = nonlinear_increments(problem, scene.potential, finished)
            finished = None if increments is None else _kept(finished, increments)
    if finished is not None:
        return finished
    sums = None
    if memory.channels and route != "direct steps":
        sums = SteppedHistory(memory, n_steps, scene.dimension)
    return run_steps(problem, sums, keep_increments=with_increments)


def _kept(stepped: Stepped, increments: Array) -> Stepped:
    """What the steps gave with their increments, and no force where nothing is damped."""
    force = stepped.end_force
    if not force.shape[0]:
        force = np.zeros((stepped.position.shape[0], *force.shape[1:]))
    return replace(stepped, increments=increments, end_force=force)
