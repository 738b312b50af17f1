"""The systems of a linear scene, and whether those of many scenes are done side by side."""

from __future__ import annotations

import functools

from fvi_cli.effects.matrices import dense
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.block_sizes import batch_sizes
from fvi_cli.integrator.decoupling import Decoupling
from fvi_cli.integrator.engine import scene_decoupling
from fvi_cli.integrator.memory import terms_by_direction
from fvi_cli.planning.history_work import Shape


@functools.lru_cache(maxsize=8)
def systems_of(scene: Scene) -> Decoupling | None:
    """Made once for all runs of a scene: modes of many components take their time."""
    if scene.is_sparse:
        return None
    directions = [dense(direction) for direction, _ in terms_by_direction(scene.active_damping)]
    return scene_decoupling(scene, directions)


def fit_together(scene: Scene, shape: Shape, n_steps: int, members: int) -> bool:
    """Whether blocks of so many scenes, side by side, are not too large."""
    decoupling = systems_of(scene)
    if decoupling is None:
        return False
    coupled = scene.dimension // decoupling.batch
    return batch_sizes(shape.samples, coupled, members * decoupling.batch, n_steps) is not None
