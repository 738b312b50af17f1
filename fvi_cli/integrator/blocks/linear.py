"""Linear scenes, block by block: no loop over steps."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.blocks.batch import BatchProblem, BatchStepped, run_batch
from fvi_cli.integrator.blocks.history import BatchedChannel
from fvi_cli.integrator.blocks.response import LinearSystem
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]


def linear_system(problem: StepProblem, decoupling: Decoupling) -> LinearSystem:
    """The scene of `problem` in the coordinates of `decoupling`."""
    scene, memory = problem.scene, problem.memory
    potential = scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    return LinearSystem(
        mass=decoupling.matrices(scene.inertia.mass),
        stiffness=None if stiffness is None else decoupling.matrices(stiffness),
        channels=tuple(
            BatchedChannel(channel=c, directions=decoupling.matrices(c.direction))
            for c in memory.channels
        ),
        tables=problem.tables,
        sample_matrix=memory.sample_matrix,
        carry_matrix=memory.carry_matrix,
        force_weights=memory.force_weights,
        offset=decoupling.positions(memory.offset),
        step_size=problem.step_size,
    )


def run_linear_blocks(problem: StepProblem, decoupling: Decoupling) -> Stepped | None:
    """All steps of a linear scene; None where its blocks would be too large.

    Parameters
    ----------
    problem
        Everything that the steps need.
    decoupling
        Coordinates of the steps.

    Returns
    -------
    Stepped
        As `run_steps` gives it, without the samples; with the damping force only where it is
        kept, or where the samples lie on the nodes.
    """
    on_nodes = problem.skip_first_kick and bool(problem.memory.channels)
    system = linear_system(problem, decoupling)
    moments = partial(_batch_moments, problem, decoupling) if has_moments(problem) else None
    finished = run_batch(
        BatchProblem(
            system=system,
            n_steps=problem.n_steps,
            position=decoupling.positions(problem.position),
            momentum=decoupling.forces(problem.momentum),
            first_offset=decoupling.positions(problem.memory.first_offset),
            moments=moments,
            with_force=on_nodes or (problem.keep_force and bool(system.channels)),
            with_end=on_nodes,
            limit=problem.stop_beyond * decoupling.extents,
            stop_together=True,
        )
    )
    return None if finished is None else stepped_scene(problem, decoupling, finished)


def has_moments(problem: StepProblem) -> bool:
    """Whether anything is known in advance that drives the steps."""
    return not (
        problem.moments is None
        and problem.memory.known_force is None
        and not (problem.skip_first_kick and np.any(problem.memory.first_offset != 0))
    )


def _batch_moments(
    problem: StepProblem, decoupling: Decoupling, part: slice, first: int, last: int
) -> Array:
    return decoupling.forces(known_moments(problem, first, last), part)


def stepped_scene(problem: StepProblem, decoupling: Decoupling, finished: BatchStepped) -> Stepped:
    """In the coordinates of the scene, up to the first numbers that are not finite."""
    n_steps, memory = problem.n_steps, problem.memory
    done = int(finished.done.min())
    positions, momenta = finished.position[:, : done + 1], finished.momentum[:, : done + 1]
    whole = (np.isfinite(positions) & np.isfinite(momenta)).all(axis=(0, 2))
    failure = ""
    if not whole.all():
        done = int(np.argmin(whole))
        failure = f"not finite after step {done - 1}, t = {done * problem.step_size:.6g}"
    end_force = np.zeros((0, problem.tables.sample_points.size, problem.scene.dimension))
    if finished.force is not None:
        end_force = decoupling.scene_forces(finished.force[:, : done + 1])
        if memory.known_force is not None:
            end_force = end_force + memory.known_force[: done + 1]
        # the first kick is left out; after a failure there is none at the end
        if problem.skip_first_kick:
            end_force[0] = 0.0
        if done < n_steps:
            end_force[done] = 0.0
    return Stepped(
        position=decoupling.scene_positions(positions[:, : done + 1]),
        momentum=decoupling.scene_forces(momenta[:, : done + 1]),
        samples=np.zeros((0, *end_force.shape[1:])),
        end_force=end_force,
        operations=int(finished.operations.sum()),
        newton=NewtonRecord(),
        failure=failure,
    )


def known_moments(problem: StepProblem, first: int, last: int) -> Array:
    """Moments of all that is known in advance for steps `first` to `last`, ``(n, s + 1, d)``."""
    tables, memory, h = problem.tables, problem.memory, problem.step_size
    moments = np.zeros((last - first, tables.degree + 1, problem.scene.dimension))
    if problem.moments is not None:
        moments += problem.moments[first:last]
    to_moments = h * memory.force_weights
    start = 1 if first == 0 and problem.skip_first_kick else 0
    if memory.known_force is not None:
        force = memory.known_force[first + start : last]
        moments[start:] -= np.einsum("ni,kid->knd", to_moments, force)
    if start:
        # the block counts the force of the first sample; it is taken away again
        for channel in memory.channels:
            moments[0] += to_moments @ (channel.newest(memory.first_offset) @ channel.direction)
    return moments
