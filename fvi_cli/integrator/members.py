"""Many scenes by one method and on one grid: those that fit together are one batch."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import kinds_of, side_by_side
from fvi_cli.integrator.batches.run import integrate_side_by_side
from fvi_cli.integrator.blocks.batch import BatchStepped, run_batch
from fvi_cli.integrator.blocks.linear import batch_problem, stepped_scene
from fvi_cli.integrator.counts import check_counts
from fvi_cli.integrator.decoupling import Decoupling, linear_decoupling
from fvi_cli.integrator.equal_steps.routes import sums_directly
from fvi_cli.integrator.equal_steps.run import Prepared, bounded, finished_trajectory, prepare
from fvi_cli.integrator.equal_steps.weights import shared_channels
from fvi_cli.integrator.growth_bound import GrowthBound, cut_at_bound
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.run.unfinished import RunKeeper
from fvi_cli.integrator.trajectory import Trajectory, thinned


def integrate_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    checkpoints: Callable[[Scene], RunKeeper | None] = lambda scene: None,
) -> list[Trajectory]:
    """Integrate every scene, those that fit together as one batch.

    Runge-Kutta methods on any mesh take scenes of one mesh, see
    :func:`fvi_cli.integrator.batches.kinds.side_by_side`, side by side, nonlinear ones of the same
    formulas too. By others linear scenes of the same number of degrees of freedom, orders of
    damping, kind of derivative and final time share all weights. What is left is integrated one by
    one.

    Parameters
    ----------
    scenes
        What is integrated.
    method, n_steps, every
        As for :func:`fvi_cli.integrator.integrate.integrate`, the same for all.
    checkpoints
        Where a scene that is integrated by itself keeps its checkpoint.

    Returns
    -------
    list of Trajectory
        One per scene, in their order: what `integrate` gives, to round-off, with a status of its
        own; times are the equal shares of those of the batch, operations those of the scene.

    Raises
    ------
    ValueError
        As `integrate` does, for the first scene that is not allowed.
    """
    check_counts(n_steps, every)
    found: dict[int, Trajectory] = {}
    for indices in _groups(scenes, method, n_steps):
        together = [scenes[index] for index in indices]
        batch: list[Trajectory] | None = None
        if len(indices) > 1 and isinstance(method, Method):
            if method.is_runge_kutta:
                batch = integrate_side_by_side(together, method, int(n_steps), every=every)
            else:
                batch = _batch_or_none(together, method, int(n_steps), every)
        if batch is None:
            batch = [
                integrate(scene, method, n_steps, every=every, checkpoints=checkpoints(scene))
                for scene in together
            ]
        found.update(zip(indices, batch, strict=True))
    return [found[index] for index in range(len(scenes))]


def companions(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> list[int]:
    """How many of the scenes `integrate_members` takes together with each of them, itself among."""
    found = [1] * len(scenes)
    for indices in _groups(scenes, method, n_steps):
        for index in indices:
            found[index] = len(indices)
    return found


def _groups(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> list[list[int]]:
    """Places of the scenes that are taken together."""
    if isinstance(method, Method) and method.is_runge_kutta:
        return kinds_of(scenes, method, n_steps)
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, scene in enumerate(scenes):
        key = _kind(scene) if goes_together(scene, method, n_steps) else (index,)
        groups.setdefault(key, []).append(index)
    return list(groups.values())


def goes_together(scene: Scene, method: AnyMethod, n_steps: int) -> bool:
    """Whether a scene may be one of a batch."""
    if isinstance(method, Method) and method.is_runge_kutta:
        return side_by_side(scene, method, n_steps) is not None
    if not isinstance(method, Method) or not scene.is_linear:
        return False
    if sums_directly(method.history, n_steps):
        return False
    return method.start != "weights" or not scene.active_damping


def _orders(scene: Scene) -> tuple[float, ...]:
    return tuple(sorted({term.order for term in scene.active_damping}))


def _kind(scene: Scene) -> tuple[object, ...]:
    return (scene.dimension, _orders(scene), scene.derivative, scene.final_time)


def _batch_or_none(
    scenes: Sequence[Scene], method: Method, n_steps: int, every: int
) -> list[Trajectory] | None:
    """A batch by a method with sequences of weights; None where its blocks do not fit."""
    # where the steps of a member have singular equations, each member for itself tells
    with contextlib.suppress(np.linalg.LinAlgError):
        batch = _integrate_batch(scenes, method, n_steps)
        if batch is not None:
            return [thinned(trajectory, every) for trajectory in batch]
    return None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ready:
    """A member before the first step."""

    prepared: Prepared
    bound: GrowthBound
    decoupling: Decoupling


def _integrate_batch(
    scenes: Sequence[Scene], method: Method, n_steps: int
) -> list[Trajectory] | None:
    """The whole trajectories of scenes that fit together; None where their blocks do not fit."""
    began = time.perf_counter()
    h = scenes[0].final_time / n_steps
    source = shared_channels(method, h, n_steps + 1, _orders(scenes[0]))
    members = []
    for scene in scenes:
        prepared, bound = bounded(prepare(scene, method, n_steps, source))
        decoupling = linear_decoupling(scene)
        if decoupling is None:
            return None
        members.append(_Ready(prepared=prepared, bound=bound, decoupling=decoupling))
    # members with modes are as many systems as they have degrees of freedom
    widths = [member.decoupling.batch for member in members]
    if len(set(widths)) > 1:
        members = [replace(m, decoupling=replace(m.decoupling, modes=None)) for m in members]
    problem = batch_problem(
        [(one.prepared.problem, one.decoupling) for one in members], stop_together=False
    )
    ready = time.perf_counter()
    finished = run_batch(problem)
    if finished is None:
        return None
    width = problem.system.batch // len(members)
    results = []
    for index, member in enumerate(members):
        part = slice(index * width, (index + 1) * width)
        own = stepped_scene(member.prepared.problem, member.decoupling, _part(finished, part))
        results.append(cut_at_bound(member.prepared.problem, own, member.bound))
    done = time.perf_counter()
    share = 1.0 / len(members)
    return [
        finished_trajectory(
            method, member.prepared, stepped, (share * (ready - began), share * (done - ready))
        )
        for member, stepped in zip(members, results, strict=True)
    ]


def _part(finished: BatchStepped, part: slice) -> BatchStepped:
    """What the steps of some of the systems gave."""
    return BatchStepped(
        position=finished.position[part],
        momentum=finished.momentum[part],
        force=None if finished.force is None else finished.force[part],
        done=finished.done[part],
        operations=finished.operations[part],
    )
