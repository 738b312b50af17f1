"""Linear scenes, block by block: no loop over steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvi_cli.effects.potential import QuadraticPotential
from fvi_cli.integrator.blocks.batch import BatchProblem, BatchStepped, run_batch
from fvi_cli.integrator.blocks.history import BatchedChannel
from fvi_cli.integrator.blocks.response import SampledSystems
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.equal_steps.problem import Stepped, StepProblem
from fvi_cli.integrator.trajectory import NewtonRecord

Array = NDArray[np.float64]


def sampled_systems(problem: StepProblem, decoupling: Decoupling) -> SampledSystems:
    """The scene of `problem` in the coordinates of `decoupling`."""
    scene, memory = problem.scene, problem.memory
    potential = scene.potential
    stiffness = potential.stiffness if isinstance(potential, QuadraticPotential) else None
    return SampledSystems(
        mass=decoupling.matrices(scene.inertia.mass),
        stiffness=None if stiffness is None else decoupling.matrices(stiffness),
        channels=tuple(
            BatchedChannel(channel=c, directions=decoupling.matrices(c.direction))
            for c in memory.channels
        ),
        tables=problem.tables,
        memory=memory,
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
    finished = run_batch(batch_problem([(problem, decoupling)], stop_together=True))
    return None if finished is None else stepped_scene(problem, decoupling, finished)


def batch_problem(
    members: Sequence[tuple[StepProblem, Decoupling]], *, stop_together: bool
) -> BatchProblem:
    """The systems of scenes that share weights and steps, one scene after the other.

    Parameters
    ----------
    members
        Each with coordinates of as many systems.
    stop_together
        As for :class:`BatchProblem`.
    """
    first, width = members[0][0], members[0][1].batch

    def moments(part: slice, begin: int, end: int) -> Array:
        found = []
        for index, (problem, own) in enumerate(members):
            some = slice(max(part.start - index * width, 0), min(part.stop - index * width, width))
            if some.start < some.stop:
                found.append(own.forces(known_moments(problem, begin, end), some))
        return np.concatenate(found)

    on_nodes = first.skip_first_kick and bool(first.memory.channels)
    return BatchProblem(
        system=_joined([sampled_systems(problem, own) for problem, own in members]),
        n_steps=first.n_steps,
        position=np.concatenate([own.positions(one.position) for one, own in members]),
        momentum=np.concatenate([own.forces(one.momentum) for one, own in members]),
        first_offset=np.concatenate(
            [own.positions(one.memory.first_offset) for one, own in members]
        ),
        moments=moments if any(has_moments(one) for one, _ in members) else None,
        with_force=on_nodes or (first.keep_force and bool(first.memory.channels)),
        with_end=on_nodes,
        limit=np.concatenate([one.stop_beyond * own.extents for one, own in members]),
        stop_together=stop_together,
    )


def _joined(systems: Sequence[SampledSystems]) -> SampledSystems:
    """One batch of all systems; no stiffness is one of zero."""
    first = systems[0]
    stiffness = None
    if any(system.stiffness is not None for system in systems):
        stiffness = np.concatenate(
            [np.zeros_like(s.mass) if s.stiffness is None else s.stiffness for s in systems]
        )
    return replace(
        first,
        mass=np.concatenate([s.mass for s in systems]),
        stiffness=stiffness,
        channels=tuple(
            BatchedChannel(
                channel=channel.channel,
                directions=np.concatenate([s.channels[index].directions for s in systems]),
            )
            for index, channel in enumerate(first.channels)
        ),
        offset=np.concatenate([s.offset for s in systems]),
    )


def has_moments(problem: StepProblem) -> bool:
    """Whether anything is known in advance that drives the steps."""
    return not (
        problem.moments is None
        and problem.memory.known_force is None
        and not (problem.skip_first_kick and np.any(problem.memory.first_offset != 0))
    )


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
