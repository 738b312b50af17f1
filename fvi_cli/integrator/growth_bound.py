"""When a run is far outside of anything that its scene can do."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from fvi_cli.effects.inertia import Inertia
from fvi_cli.effects.matrices import is_sparse
from fvi_cli.effects.scene import Scene
from fvi_cli.integrator.stability.determinant import independent_systems, is_dissipative
from fvi_cli.integrator.stability.prediction import RESOLVED, exact_growth
from fvi_cli.mathematics.arrays import Array

TOLERATED_FACTOR = 1e8
"""How far a position may go beyond what start values and forces move in the time of the run."""


FLEXIBILITY_SWEEPS = 10

PROBED_FRACTIONS = (np.arange(64) + 0.5) / 64
"""Where forces are looked at, on every part between break points."""


@dataclass(frozen=True, kw_only=True)
class GrowthBound:
    r"""The bound :math:`|x(t)| \le C e^{\sigma t}` that no sound run leaves.

    Parameters
    ----------
    size
        C: 1e8 times the sum of start position, way at the start velocity and way under the
        largest force; infinite for a scene that nothing moves.
    rate
        The growth of the exact linear scene and a quarter more; 0 for a nonlinear one.
    per_force
        What a unit of the largest force adds to C.
    """

    size: float
    rate: float
    per_force: float = 0.0

    def with_force(self, force: float) -> GrowthBound:
        """The bound where the force is found to be so large: a pulse may be missed beforehand."""
        return replace(self, size=self.size + self.per_force * force)

    def at(self, time: Array) -> Array:
        """The bound at each time."""
        with np.errstate(over="ignore"):
            return np.asarray(self.size * np.exp(self.rate * time))


NO_BOUND = GrowthBound(size=math.inf, rate=0.0)


def farthest_position(scene: Scene, n_steps: int) -> float:
    """The bound at the end of a run that starts from the scene's own data, for any method."""
    h = scene.final_time / n_steps
    force = 0.0
    if scene.forcing is not None:
        force = float(np.abs(scene.forcing(h * np.arange(n_steps + 1, dtype=float))).max())
    return float(_bound(scene, h, force).at(np.asarray(scene.final_time)))


def beyond(position: Array, limit: float, n_done: int, step_size: float) -> str:
    """Why a run ends with this position after so many steps; empty where it goes on."""
    size = float(np.abs(position).max())
    if size <= limit and math.isfinite(size):
        return ""
    return _diverged(size, n_done - 1, n_done * step_size)


def _diverged(size: float, step: int, time: float) -> str:
    return (
        f"diverged: |x| = {size:.3g} after step {step}, t = {time:.6g}, is "
        f"{TOLERATED_FACTOR:.0e} times beyond what the scene can do"
    )


def _bound(scene: Scene, step_size: float, force: float) -> GrowthBound:
    final_time = scene.final_time
    way = final_time * np.abs(scene.initial_velocity).max()
    per_force = final_time**2 * _largest_flexibility(scene.inertia)
    scale = float(np.abs(scene.initial_position).max() + way + per_force * force)
    rate = 0.0
    if scene.is_sparse or (scene.is_linear and scene.active_laws):
        # what grows is not looked for in large structures and beside laws: then there is no bound
        scale = scale if is_dissipative(scene) else math.inf
    elif scene.is_linear:
        parts = independent_systems(scene)
        # a mode may grow that much faster and still be the truth, not resolved well
        rate = max(exact_growth(part, final_time, step_size) for part in parts)
        rate *= 1.0 + RESOLVED
    size = TOLERATED_FACTOR * scale
    return GrowthBound(
        size=size if 0 < size < math.inf else math.inf,
        rate=rate,
        per_force=TOLERATED_FACTOR * per_force,
    )


def _largest_flexibility(inertia: Inertia) -> float:
    """Largest eigenvalue of the inverse mass; of a sparse one a few iterations' estimate."""
    if not is_sparse(inertia.form):
        return float(np.linalg.norm(np.linalg.inv(inertia.mass), 2))
    vector = np.random.default_rng(1).standard_normal(inertia.dimension)
    size = 0.0
    for _ in range(FLEXIBILITY_SWEEPS):
        vector = vector / np.linalg.norm(vector)
        vector = inertia.velocity(vector)
        size = float(np.linalg.norm(vector))
    return size


def first_outside(
    bound: GrowthBound, position: Array, times: Array, done: int
) -> tuple[int, str] | None:
    """The first position outside of `bound`, with the failure in words; None: all are inside.

    Parameters
    ----------
    bound
        The bound of the run.
    position, times
        Successive points, shapes ``(n, d)`` and ``(n,)``.
    done
        Number of steps before the first of them.
    """
    with np.errstate(invalid="ignore"):
        outside = np.abs(position).max(axis=1, initial=0.0) > bound.at(times)
    if not outside.any():
        return None
    index = int(outside.argmax())
    return index, _diverged(np.abs(position[index]).max(), done + index, times[index])


def scene_bound(scene: Scene, step_size: float) -> GrowthBound:
    """The bound of a run of `scene` with steps of about this size, from its own data."""
    force = 0.0
    if scene.forcing is not None:
        ends = np.array([0.0, *scene.break_points, scene.final_time])
        inside = (ends[:-1, None] + np.diff(ends)[:, None] * PROBED_FRACTIONS).ravel()
        with np.errstate(all="ignore"):
            values = np.abs(scene.forcing(inside))
        force = float(values[np.isfinite(values)].max(initial=0.0))
    return _bound(scene, step_size, force)
