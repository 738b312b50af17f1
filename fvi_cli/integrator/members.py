"""Many scenes by one method and on one grid: those that fit together are one batch."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.batches.kinds import kinds_of, side_by_side
from fvi_cli.integrator.batches.run import integrate_side_by_side
from fvi_cli.integrator.counts import check_counts
from fvi_cli.integrator.integrate import integrate
from fvi_cli.integrator.method import AnyMethod, Method
from fvi_cli.integrator.run.unfinished import RunKeeper
from fvi_cli.integrator.trajectory import Trajectory


def integrate_members(
    scenes: Sequence[Scene],
    method: AnyMethod,
    n_steps: int,
    *,
    every: int = 1,
    checkpoints: Callable[[Scene], RunKeeper | None] = lambda scene: None,
) -> list[Trajectory]:
    """Integrate every scene, those that fit together as one batch.

    Scenes of one mesh go side by side, see
    :func:`fvi_cli.integrator.batches.kinds.side_by_side`, nonlinear ones of the same formulas too;
    by backward differences those of the same orders of damping. What is left is integrated one by
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
        if len(indices) > 1 and isinstance(method, Method):
            batch = integrate_side_by_side(together, method, int(n_steps), every=every)
        else:
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


def goes_together(scene: Scene, method: AnyMethod, n_steps: int) -> bool:
    """Whether a scene may be one of a batch."""
    return isinstance(method, Method) and side_by_side(scene, method, n_steps) is not None


def _groups(scenes: Sequence[Scene], method: AnyMethod, n_steps: int) -> list[list[int]]:
    """Places of the scenes that are taken together."""
    if isinstance(method, Method):
        return kinds_of(scenes, method, n_steps)
    return [[place] for place in range(len(scenes))]
